//! Arguments of `gerono new`.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use scenario::{CaptureSystem, RadioProtocol};
use scenario_file::values::{between, count};

use crate::{CELLS, MASS, PROPELLER, SIZE};

/// Arguments of `gerono new`.
#[derive(Debug, Args)]
pub struct New {
    /// The scenario file to write; it must not exist.
    pub file: PathBuf,
    /// Mass with battery, kg.
    #[arg(long, value_name = "KG", value_parser = between(MASS[0], MASS[1], "kg"))]
    pub mass: Option<f64>,
    /// Diagonal from motor to motor, m.
    #[arg(long, value_name = "M", value_parser = between(SIZE[0], SIZE[1], "m"))]
    pub size: Option<f64>,
    /// Diameter of a propeller, inch.
    #[arg(long, value_name = "INCH", value_parser = between(PROPELLER[0], PROPELLER[1], "inch"))]
    pub propeller: Option<f64>,
    /// Cells of the battery in series: 4 for a battery that is sold as 4S.
    #[arg(long, value_name = "N", value_parser = count(CELLS[0], CELLS[1], "cells"))]
    pub cells: Option<u32>,
    /// Radio link of the laboratory.
    #[arg(long, value_parser = radio_link())]
    pub radio: Option<RadioProtocol>,
    /// Motion-capture system of the laboratory.
    #[arg(long, value_parser = capture_system())]
    pub cameras: Option<CaptureSystem>,
    /// Simulate radio and cameras: a first scenario without a laboratory.
    #[arg(long, conflicts_with_all = ["radio", "cameras"])]
    pub simulated: bool,
}

impl New {
    /// The end of `gerono new --help`.
    pub const EXAMPLES: &str = "Examples:\n  \
        gerono new mine.toml\n  \
        gerono new x500.toml --mass 2.0 --size 0.5 --propeller 10 --cells 4 --simulated\n  \
        gerono new lab.toml --mass 0.2 --size 0.2 --propeller 5.5 --cells 2 --radio crsf --cameras natnet\n\n\
        Then `gerono check x500.toml` and `gerono run x500.toml`; the first lines of a file for a laboratory say how to fly it in \
        simulated time, against `gerono world`, and with the vehicle.\n\n\
        Exit codes: 0 the file was written; 2 an answer is missing, or the numbers contradict each other; 4 the file exists, or \
        cannot be written.";
}

/// Returns the parser of the name of a radio link.
fn radio_link() -> impl TypedValueParser<Value = RadioProtocol> {
    /// The link whose packets an ExpressLRS transmitter takes, by the names of that.
    const OF_CRSF: [&str; 2] = ["elrs", "expresslrs"];
    let words = RadioProtocol::ALL.map(|link| {
        let word = PossibleValue::new(link.name());
        if link == RadioProtocol::Crsf {
            word.aliases(OF_CRSF)
        } else {
            word
        }
    });
    PossibleValuesParser::new(words).map(|word| {
        let mut links = RadioProtocol::ALL.into_iter();
        let is_meant = |link: &RadioProtocol| {
            link.name() == word || (*link == RadioProtocol::Crsf && OF_CRSF.contains(&word.as_str()))
        };
        links.find(is_meant).expect("the parser accepts no other words")
    })
}

/// Returns the parser of a motion-capture system's name.
#[must_use]
pub fn capture_system() -> impl TypedValueParser<Value = CaptureSystem> {
    let words = CaptureSystem::ALL.map(|system| {
        let properties = system.properties();
        let word = PossibleValue::new(properties.name).help(properties.title);
        word.aliases(properties.aliases)
    });
    PossibleValuesParser::new(words).map(|word| {
        let mut systems = CaptureSystem::ALL.into_iter();
        let named = systems.find(|system| {
            let properties = system.properties();
            properties.name == word || properties.aliases.contains(&word.as_str())
        });
        named.expect("the parser accepts no other words")
    })
}
