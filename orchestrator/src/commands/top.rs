//! `gerono top`: a live run in a terminal.

use std::io::IsTerminal;

use command_line::exit::Exit;
use command_line::interrupt;
use run_client::{Answer, LiveRun, PATIENCE, Question, Snapshot};

use top::{ViewEnd, once, watch};

use super::{Failure, print};
use crate::cli::Top;

/// Columns of the printed view.
const COLUMNS: u16 = 80;

/// Shows a live run until the user quits or it ends, or prints its state once.
///
/// # Errors
/// [`Failure`] if there is no such run, or no terminal.
pub fn top(arguments: &Top) -> Result<Exit, Failure> {
    let is_terminal = std::io::stdin().is_terminal() && std::io::stdout().is_terminal();
    if !is_terminal && !arguments.once {
        let reason = "`gerono top` needs a terminal for its input and output; `gerono top --once` prints the state of the run, \
             and `--once --json` does so for other programs";
        return Err(Failure::trouble(reason));
    }
    let run = LiveRun::find(arguments.run.as_deref(), "top").map_err(Failure::trouble)?;
    if arguments.once {
        return print_once(arguments, &run);
    }
    let interrupt = interrupt::install_in_terminal().map_err(Failure::trouble)?;
    match watch(&run, arguments.allow_faults, &interrupt).map_err(Failure::trouble)? {
        ViewEnd::Quit => Ok(Exit::Success),
        ViewEnd::Signal(signal) => Ok(Exit::Signal(signal)),
        ViewEnd::Ended(last) => {
            print(ending(run.name(), last.as_deref()));
            Ok(Exit::Success)
        }
    }
}

fn print_once(arguments: &Top, run: &LiveRun) -> Result<Exit, Failure> {
    let snapshot = match run.ask(&Question::Look, PATIENCE).map_err(Failure::trouble)? {
        Answer::Snapshot(snapshot) => snapshot,
        Answer::Done(text) | Answer::Refused(text) | Answer::Closed(text) => {
            return Err(Failure::trouble(text));
        }
        Answer::Description(_) | Answer::Newest(_) | Answer::Values(_) => {
            return Err(Failure::trouble("the run gave an unexpected answer"));
        }
    };
    if arguments.json {
        let text = serde_json::to_string_pretty(&snapshot).map_err(Failure::trouble)?;
        print(text + "\n");
    } else {
        print(once(run.name(), &snapshot, COLUMNS));
    }
    Ok(Exit::Success)
}

fn ending(run: &str, last: Option<&Snapshot>) -> String {
    let state = last.map(|last| format!("; last state at {:.1} s of {:.1} s", last.time, last.duration));
    format!("the run `{run}` has ended{}\n", state.unwrap_or_default())
}
