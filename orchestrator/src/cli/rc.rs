//! The radio link, without a flight and from a log.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use identification::link::FrameSource;

use super::flight::ScenarioArguments;
use scenario_file::values::{ValueError, between};

/// The commands of `gerono rc`.
#[derive(Debug, Subcommand)]
pub enum RcCommand {
    /// Move one stick after another, slowly and disarmed, and say what the receiver should show.
    ///
    /// Uses the link of a scenario's `[rc_output]` (docs/radio_links.md). Take the propellers off all the same. Where no
    /// arming switch is stated the thrust stick is left alone, because it might let the motors turn.
    Probe(RcProbe),
    /// Fit the calibration of the link that a log was flown with: thrust and body rates against the travel of the sticks.
    ///
    /// With 95 % intervals and residuals. Rates are fitted by least squares; the thrust by the thrust that the path asks for,
    /// because a controller moves its stick against gusts. Of a stick that explains little of what was measured the part of a
    /// scenario that is printed keeps what was stated.
    Identify(RcIdentify),
}

/// Arguments of `gerono rc probe`.
#[derive(Debug, Args)]
pub struct RcProbe {
    /// Whose link.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Time that a stick takes from the middle to both ends and back, s.
    #[arg(long, default_value_t = 8.0, value_name = "S", value_parser = between(0.1, 600.0, "s"))]
    pub seconds: f64,
    /// Move the thrust stick too although nothing keeps the vehicle disarmed: its propellers are off.
    #[arg(long)]
    pub propellers_off: bool,
}

/// Arguments of `gerono rc identify`.
#[derive(Debug, Args)]
pub struct RcIdentify {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
    /// The measure of thrust and rates.
    #[arg(long, value_enum, default_value_t)]
    pub from: Measure,
    /// Mass of the vehicle, kg [default: the scenario's].
    #[arg(long, value_name = "KG", value_parser = mass)]
    pub mass: Option<f64>,
    /// Print JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

/// The measure of thrust and rates.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum Measure {
    /// The poses that the cameras captured.
    #[default]
    Poses,
    /// The simulated truth.
    Truth,
}

impl From<Measure> for FrameSource {
    fn from(measure: Measure) -> Self {
        match measure {
            Measure::Poses => Self::Poses,
            Measure::Truth => Self::Truth,
        }
    }
}

fn mass(text: &str) -> Result<f64, ValueError> {
    let mass: f64 = text.parse().map_err(|_| ValueError::unfit("give a mass in kg"))?;
    if mass > 0.0 && mass.is_finite() {
        Ok(mass)
    } else {
        Err(ValueError::unfit("give a mass above 0 kg"))
    }
}
