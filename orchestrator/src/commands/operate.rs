//! `gerono arm`, `disarm`, `kill`, `stop`: what the operator asks of a flight in real time.

use super::{Failure, print};
use crate::cli::Operate;
use crate::exit::Exit;
use crate::live::{Answer, LiveRun, Question};

/// Asks a live run and says what it answered.
///
/// # Errors
/// [`Failure`] if there is no such run, or if it refuses.
pub fn operate(arguments: &Operate, question: &Question) -> Result<(), Failure> {
    let trouble = |error| Failure::new(Exit::Trouble, error);
    let run = LiveRun::find(arguments.run.as_deref()).map_err(trouble)?;
    match run.ask(question).map_err(trouble)? {
        Answer::Done(text) => {
            print(format!("{text}\n"));
            Ok(())
        }
        Answer::Refused(reason) => Err(Failure::new(Exit::Refused, reason)),
        Answer::Snapshot(_) => Ok(()),
    }
}
