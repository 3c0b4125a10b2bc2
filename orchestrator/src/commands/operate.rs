//! `gerono arm`, `disarm`, `kill`, `stop`: requests of the operator to a flight in real time.

use std::io::{IsTerminal, stderr, stdin};
use std::time::Duration;

use runtime::shared_page::Request;

use super::{Failure, note, print};
use crate::cli::Operate;
use command_line::exit::Exit;
use run_client::runs::{MachineRun, User};
use run_client::{Answer, LiveError, LiveRun, PATIENCE, Question};
use scenario_file::printable::printable;

/// Timeout for an orchestrator's answer to a kill. The services have received the kill directly before.
const KILL_TIMEOUT: Duration = Duration::from_secs(1);

/// Sends a request to a live run for a command and prints the answer.
///
/// # Errors
/// [`Failure`] if there is no such run, or if it refuses.
pub fn operate(arguments: &Operate, command: &'static str, question: &Question) -> Result<(), Failure> {
    let run = LiveRun::find(arguments.run.as_deref(), command).map_err(Failure::trouble)?;
    show(run.ask(question, PATIENCE).map_err(Failure::trouble)?)
}

/// `gerono arm`: permits the motors to turn. Without `--run`, arming the run of another login requires confirmation.
///
/// # Errors
/// [`Failure`] if there is no such run, if it refuses, or if it is not confirmed.
pub fn arm(arguments: &Operate) -> Result<(), Failure> {
    let found = run_client::find(arguments.run.as_deref(), "arm").map_err(Failure::trouble)?;
    let run = LiveRun::connect(&found, PATIENCE).map_err(Failure::trouble)?;
    let (starter, caller) = (found.starter(), User::at_the_keyboard());
    if arguments.run.is_none() && starter != caller {
        let named = format!("{}, started by {starter}", identity(&run)?);
        if !is_confirmed(&format!(
            "You are {caller}. Arm {named}? The motors may turn. [y/N] "
        )) {
            let name = run.name();
            let reason =
                format!("not armed: {named}, and you are {caller}; if you mean it: gerono arm --run {name}");
            return Err(Failure::trouble(reason));
        }
    }
    show(run.arm().map_err(Failure::trouble)?)
}

/// `gerono get`: prints keys, and the run's identity on standard error.
///
/// # Errors
/// [`Failure`] if there is no such run, or if it refuses.
pub fn get(arguments: &Operate, keys: Vec<String>) -> Result<(), Failure> {
    let run = LiveRun::find(arguments.run.as_deref(), "get").map_err(Failure::trouble)?;
    let answer = run
        .ask(&Question::Get(keys), PATIENCE)
        .map_err(Failure::trouble)?;
    note(identity(&run)?);
    show(answer)
}

/// Returns the name of a run, its scenario and its link as text.
fn identity(run: &LiveRun) -> Result<String, Failure> {
    match run.ask(&Question::Describe, PATIENCE).map_err(Failure::trouble)? {
        Answer::Description(description) => Ok(run_client::identity(run.name(), &description.scenario)),
        // A run of another build may give another answer.
        _ => Ok(format!("run {}", run.name())),
    }
}

/// Asks for confirmation at the terminal. Returns `false` without a terminal.
fn is_confirmed(prompt: &str) -> bool {
    if !stdin().is_terminal() || !stderr().is_terminal() {
        return false;
    }
    eprint!("{}", printable(prompt));
    let mut answer = String::new();
    let is_read = stdin().read_line(&mut answer).is_ok();
    is_read && matches!(answer.trim(), "y" | "Y" | "yes")
}

/// `gerono kill`: stops the motors, even without the run's orchestrator.
///
/// # Errors
/// [`Failure`] if there is no such run, or if neither its orchestrator nor its services can be reached.
pub fn kill(arguments: &Operate) -> Result<(), Failure> {
    let run = run_client::find_to_kill(arguments.run.as_deref()).map_err(Failure::trouble)?;
    // First: the services obey at their next step, even if the orchestrator is stopped or dead.
    let directly = run.ask_directly(Request::Kill);
    let answered = LiveRun::connect(&run, KILL_TIMEOUT)
        .and_then(|live| live.ask(&Question::Operate(Request::Kill), KILL_TIMEOUT));
    match (answered, directly) {
        // An orchestrator in a container with a separate user namespace may refuse a user that the system permits.
        (Ok(Answer::Refused(reason) | Answer::Closed(reason)), Ok(())) => show(killed_directly(
            &run,
            &format!("its orchestrator refused: {reason}"),
        )),
        (Ok(answer), _) => show(answer),
        (Err(reason), Ok(())) => show(killed_directly(&run, &orchestrator_state(&reason))),
        (Err(reason), Err(error)) => Err(Failure::trouble(not_killed(&run, &reason, &error))),
    }
}

fn orchestrator_state(reason: &LiveError) -> String {
    match reason {
        LiveError::Abandoned(_) => "its orchestrator has died".to_owned(),
        LiveError::Silent(_) => "its orchestrator does not answer".to_owned(),
        reason => reason.to_string(),
    }
}

fn killed_directly(run: &MachineRun, orchestrator: &str) -> Answer {
    Answer::Done(format!(
        "killed: the motors of the run `{}` are stopped until its end; {orchestrator}, so the kill was sent to its services directly",
        run.name()
    ))
}

fn not_killed(run: &MachineRun, reason: &LiveError, error: &std::io::Error) -> String {
    let pids: Vec<_> = run.pids().map(|pid| pid.to_string()).collect();
    format!(
        "NOT killed: {reason}; the services cannot be reached directly either ({error}); cut the power, or end the run's \
         processes (`kill -KILL {}`): then no frames are sent, and the receiver's failsafe acts",
        pids.join(" ")
    )
}

fn show(answer: Answer) -> Result<(), Failure> {
    match answer {
        Answer::Done(text) => {
            print(format!("{text}\n"));
            Ok(())
        }
        Answer::Values(values) => {
            print(format!("{}\n", values.join("\n")));
            Ok(())
        }
        Answer::Refused(reason) => Err(Failure::new(Exit::Refused, reason)),
        Answer::Closed(reason) => Err(Failure::trouble(reason)),
        Answer::Snapshot(_) | Answer::Description(_) | Answer::Newest(_) => Ok(()),
    }
}
