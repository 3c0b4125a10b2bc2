//! `gerono new`: a scenario for a vehicle that was weighed, but not measured.

use std::fmt::Write as _;
use std::io::{BufRead, IsTerminal, Write, stderr, stdin};
use std::path::Path;

use command_line::failure::Failure;
use command_line::output::{not_written, note, print};
use result_file::ResultFile;
use scenario::{CaptureSystem, RadioProtocol};
use scenario_file::printable::printable;
use scenario_file::values::{ValueError, between, count};

use crate::arguments::New;
use crate::estimates::Estimates;
use crate::{Airframe, CELLS, MASS, PROPELLER, SIZE, Surroundings, text};

/// Word for neither a radio link nor a motion-capture system.
const SIMULATED: &str = "simulated";

/// `gerono new`.
///
/// # Errors
/// [`Failure`] if an answer is missing without a terminal, no vehicle has the stated properties, or the file exists.
pub fn new(arguments: &New) -> Result<(), Failure> {
    let path = &arguments.file;
    // Before the questions.
    let file = ResultFile::create_new(path).map_err(|error| not_written(path, &error))?;
    let is_terminal = stdin().is_terminal() && stderr().is_terminal();
    let (airframe, surroundings) = if is_terminal {
        answers(arguments, &mut Dialogue::new(stdin().lock(), stderr().lock()))?
    } else {
        stated(arguments)?
    };
    let shown = path.display().to_string();
    let text = text(&airframe, surroundings, &printable(&shown)).map_err(Failure::bad_input)?;
    let estimates = Estimates::within(&airframe, surroundings).map_err(Failure::bad_input)?;
    write(path, file, &text)?;
    if let Some(doubt) = estimates.doubt() {
        note(doubt);
    }
    print(next_steps(&shown, surroundings));
    Ok(())
}

fn write(path: &Path, mut file: ResultFile, text: &str) -> Result<(), Failure> {
    let written = file.write_all(text.as_bytes()).and_then(|()| file.finish());
    written.map_err(|error| not_written(path, &error))
}

fn next_steps(file: &str, surroundings: Surroundings) -> String {
    let then = match surroundings {
        Surroundings::Simulated => format!("gerono run {file}"),
        Surroundings::Laboratory { .. } => {
            "its first lines say how to fly it in simulated time first, and then in a laboratory".to_owned()
        }
    };
    format!("{file}\nestimates are marked in the file; check it: gerono check {file}\nthen: {then}\n")
}

/// Returns the answers of the arguments alone.
fn stated(arguments: &New) -> Result<(Airframe, Surroundings), Failure> {
    let New {
        mass,
        size,
        propeller,
        cells,
        radio,
        cameras,
        simulated,
        ..
    } = *arguments;
    let surroundings = match (radio, cameras) {
        _ if simulated => Some(Surroundings::Simulated),
        (Some(radio), Some(cameras)) => Some(Surroundings::Laboratory { cameras, radio }),
        _ => None,
    };
    if let (Some(mass), Some(size), Some(propeller), Some(cells), Some(surroundings)) =
        (mass, size, propeller, cells, surroundings)
    {
        let airframe = Airframe {
            mass,
            size,
            propeller,
            cells,
        };
        return Ok((airframe, surroundings));
    }
    let of_the_laboratory = match (radio, cameras) {
        (Some(_), None) => "--cameras",
        (None, Some(_)) => "--radio",
        _ => "--simulated, or --radio and --cameras",
    };
    let options = [
        (mass.is_none(), "--mass"),
        (size.is_none(), "--size"),
        (propeller.is_none(), "--propeller"),
        (cells.is_none(), "--cells"),
        (surroundings.is_none(), of_the_laboratory),
    ];
    let missing: Vec<_> = options
        .iter()
        .filter(|(missing, _)| *missing)
        .map(|(_, name)| *name)
        .collect();
    Err(Failure::bad_input(format!(
        "there is no terminal to ask at, and these are missing: {}; for example `gerono new x500.toml --mass 2.0 --size 0.5 \
         --propeller 10 --cells 4 --simulated`",
        missing.join(", ")
    )))
}

/// Asks for what the arguments do not state.
fn answers(
    arguments: &New,
    dialogue: &mut Dialogue<impl BufRead, impl Write>,
) -> Result<(Airframe, Surroundings), Failure> {
    let number = |[least, most]: [f64; 2], unit| between(least, most, unit);
    let airframe = Airframe {
        mass: dialogue.unless(arguments.mass, "mass with battery, kg", number(MASS, "kg"))?,
        size: dialogue.unless(
            arguments.size,
            "diagonal from motor to motor, m",
            number(SIZE, "m"),
        )?,
        propeller: dialogue.unless(
            arguments.propeller,
            "diameter of a propeller, inch",
            number(PROPELLER, "inch"),
        )?,
        cells: dialogue.unless(
            arguments.cells,
            "cells of the battery in series",
            count(CELLS[0], CELLS[1], "cells"),
        )?,
    };
    let is_of_a_laboratory = arguments.radio.is_some() || arguments.cameras.is_some();
    if arguments.simulated {
        return Ok((airframe, Surroundings::Simulated));
    }
    let links = RadioProtocol::ALL.map(|link| (link.name(), link));
    let radio = match arguments.radio {
        Some(radio) => Some(radio),
        None => dialogue.choice("radio link", &links, !is_of_a_laboratory)?,
    };
    let Some(radio) = radio else {
        return Ok((airframe, Surroundings::Simulated));
    };
    let systems = CaptureSystem::ALL.map(|system| (system.name(), system));
    let cameras = match arguments.cameras {
        Some(cameras) => cameras,
        None => dialogue
            .choice("motion-capture system", &systems, false)?
            .expect("without the word for none a choice is one of the systems"),
    };
    Ok((airframe, Surroundings::Laboratory { cameras, radio }))
}

/// Questions and answers, a line each.
struct Dialogue<R, W> {
    answers: R,
    questions: W,
}

impl<R: BufRead, W: Write> Dialogue<R, W> {
    fn new(answers: R, questions: W) -> Self {
        Self { answers, questions }
    }

    /// Returns the stated value, or asks for it.
    fn unless<T>(
        &mut self,
        stated: Option<T>,
        question: &str,
        parse: impl Fn(&str) -> Result<T, ValueError>,
    ) -> Result<T, Failure> {
        match stated {
            Some(value) => Ok(value),
            None => self.ask(question, parse),
        }
    }

    /// Asks for one of the words; `None` for [`SIMULATED`] where that is a choice.
    fn choice<T: Copy>(
        &mut self,
        question: &'static str,
        words: &[(&'static str, T)],
        or_simulated: bool,
    ) -> Result<Option<T>, Failure> {
        let mut known: Vec<_> = words.iter().map(|(word, _)| *word).collect();
        if or_simulated {
            known.insert(0, SIMULATED);
        }
        self.ask(&format!("{question} ({})", known.join(", ")), |answer| {
            if or_simulated && answer == SIMULATED {
                return Ok(None);
            }
            let found = words.iter().find(|(word, _)| *word == answer);
            found
                .map(|(_, value)| Some(*value))
                .ok_or_else(|| ValueError::Unknown {
                    what: question,
                    there_is: scenario::suggest::known_names(answer, &known),
                })
        })
    }

    /// Asks until the answer is valid.
    fn ask<T>(
        &mut self,
        question: &str,
        parse: impl Fn(&str) -> Result<T, ValueError>,
    ) -> Result<T, Failure> {
        loop {
            let mut prompt = String::new();
            // Writing to a string does not fail.
            let _ = write!(prompt, "{question}: ");
            let mut answer = String::new();
            let read = self
                .questions
                .write_all(prompt.as_bytes())
                .and_then(|()| self.questions.flush())
                .and_then(|()| self.answers.read_line(&mut answer));
            match read {
                Ok(0) => return Err(Failure::bad_input(format!("no answer: {question}"))),
                Ok(_) => {}
                Err(error) => return Err(Failure::trouble(error)),
            }
            match parse(answer.trim()) {
                Ok(value) => return Ok(value),
                // The next question shows a terminal that is gone.
                Err(error) => drop(writeln!(self.questions, "  {}", printable(&error.to_string()))),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    /// The command line of `gerono new`.
    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        new: New,
    }

    fn arguments(options: &[&str]) -> New {
        Line::try_parse_from([&["new", "mine.toml"], options].concat())
            .unwrap()
            .new
    }

    fn asked(options: &[&str], typed: &str) -> (Result<(Airframe, Surroundings), Failure>, String) {
        let mut questions = Vec::new();
        let answers = answers(
            &arguments(options),
            &mut Dialogue::new(typed.as_bytes(), &mut questions),
        );
        (answers, String::from_utf8(questions).unwrap())
    }

    #[test]
    fn what_is_not_stated_is_asked_until_the_answer_is_valid() {
        let (answers, questions) = asked(
            &["--size", "0.5"],
            "0,9\n900\n0.9\n10\n4.5\n4\nelrs\ncrsf\nnatnet\n",
        );
        let (airframe, surroundings) = answers.unwrap();
        assert_eq!(
            airframe,
            Airframe {
                mass: 0.9,
                size: 0.5,
                propeller: 10.0,
                cells: 4
            }
        );
        let (cameras, radio) = (CaptureSystem::Natnet, RadioProtocol::Crsf);
        assert_eq!(surroundings, Surroundings::Laboratory { cameras, radio });
        assert_eq!(
            questions,
            "mass with battery, kg:   the decimal sign is a point: write 0.9\n\
             mass with battery, kg:   give 0.02 to 10 kg\n\
             mass with battery, kg: diameter of a propeller, inch: cells of the battery in series:   give a whole number of \
             cells from 1 to 12\n\
             cells of the battery in series: radio link (simulated, crsf, sbus, multi, msp, mavlink, crazyflie):   there is no such radio link; known are: `simulated`, `crsf`, `sbus`, `multi`, `msp`, `mavlink`, `crazyflie`\n\
             radio link (simulated, crsf, sbus, multi, msp, mavlink, crazyflie): motion-capture system (vicon_udp, vrpn, natnet): "
        );
    }

    #[test]
    fn an_expresslrs_transmitter_takes_packets_of_crsf() {
        let (answers, _) = asked(&["--radio", "elrs"], "0.9\n0.5\n10\n4\nnatnet\n");
        let (cameras, radio) = (CaptureSystem::Natnet, RadioProtocol::Crsf);
        assert_eq!(answers.unwrap().1, Surroundings::Laboratory { cameras, radio });
    }

    #[test]
    fn a_simulation_needs_no_more_answers_and_an_end_of_the_answers_is_an_error() {
        let (answers, _) = asked(&[], "0.9\n0.5\n10\n4\nsimulated\n");
        assert_eq!(answers.unwrap().1, Surroundings::Simulated);
        let (answers, _) = asked(&["--mass", "0.9"], "0.5\n");
        let failure = format!("{:?}", answers.unwrap_err().report);
        assert!(
            failure.contains("no answer: diameter of a propeller, inch"),
            "{failure}"
        );
    }

    #[test]
    fn without_a_terminal_everything_that_is_missing_is_named() {
        for (options, missing) in [
            (
                &["--mass", "0.9", "--cells", "4"][..],
                "missing: --size, --propeller, --simulated, or --radio and --cameras;",
            ),
            (
                &[
                    "--mass",
                    "0.9",
                    "--size",
                    "0.5",
                    "--propeller",
                    "10",
                    "--cells",
                    "4",
                    "--radio",
                    "crsf",
                ],
                "missing: --cameras;",
            ),
        ] {
            let failure = stated(&arguments(options)).unwrap_err();
            let text = format!("{:?}", failure.report)
                .split_whitespace()
                .filter(|word| *word != "│")
                .collect::<Vec<_>>()
                .join(" ");
            assert!(text.contains(missing), "{text}");
        }
    }
}
