//! `gerono arm`, `disarm`, `kill`, `stop`: what the operator asks of a flight in real time.

use std::io::{IsTerminal, stderr, stdin};
use std::time::Duration;

use runtime::shared_page::Request;

use super::{Failure, note, print};
use crate::cli::Operate;
use command_line::exit::Exit;
use run_client::runs::{MachineRun, User};
use run_client::{Answer, LiveError, LiveRun, PATIENCE, Question};
use scenario_file::printable::printable;

/// Time for which an orchestrator may take to answer a kill, which has been carried out by then if it can be without it.
const KILL_PATIENCE: Duration = Duration::from_secs(1);

/// Asks a live run, by the command of this name, and says what it answered.
///
/// # Errors
/// [`Failure`] if there is no such run, or if it refuses.
pub fn operate(arguments: &Operate, command: &'static str, question: &Question) -> Result<(), Failure> {
    let run = LiveRun::find(arguments.run.as_deref(), command).map_err(Failure::trouble)?;
    show(run.ask(question, PATIENCE).map_err(Failure::trouble)?)
}

/// `gerono arm`: lets the motors turn. Without `--run`, the run of another login is armed only if that is confirmed.
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
    show(
        run.ask(&Question::Operate(Request::Arm), PATIENCE)
            .map_err(Failure::trouble)?,
    )
}

/// `gerono get`: prints keys, and on standard error of which run.
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

/// Which run it is, what it flies and by which link, in words.
fn identity(run: &LiveRun) -> Result<String, Failure> {
    match run.ask(&Question::Describe, PATIENCE).map_err(Failure::trouble)? {
        Answer::Description(description) => Ok(run_client::identity(run.name(), &description.scenario)),
        // A run of another build describes itself in another way.
        _ => Ok(format!("run {}", run.name())),
    }
}

/// Asks for confirmation at the terminal. Without a terminal there is none.
fn is_confirmed(prompt: &str) -> bool {
    if !stdin().is_terminal() || !stderr().is_terminal() {
        return false;
    }
    eprint!("{}", printable(prompt));
    let mut answer = String::new();
    let is_read = stdin().read_line(&mut answer).is_ok();
    is_read && matches!(answer.trim(), "y" | "Y" | "yes")
}

/// `gerono kill`: lets the motors rest, whatever has become of the run's orchestrator.
///
/// # Errors
/// [`Failure`] if there is no such run, or if neither its orchestrator nor its services can be reached.
pub fn kill(arguments: &Operate) -> Result<(), Failure> {
    let run = run_client::find(arguments.run.as_deref(), "kill").map_err(Failure::trouble)?;
    // First: the services obey at their next step, even while the orchestrator is stopped or is nowhere.
    let directly = run.ask_directly(Request::Kill);
    let told = LiveRun::connect(&run, KILL_PATIENCE)
        .and_then(|live| live.ask(&Question::Operate(Request::Kill), KILL_PATIENCE));
    match (told, directly) {
        // An orchestrator in a container with users of its own may refuse whom the system does not.
        (Ok(Answer::Refused(reason) | Answer::Closed(reason)), Ok(())) => {
            show(killed_alone(&run, &format!("its orchestrator says: {reason}")))
        }
        (Ok(answer), _) => show(answer),
        (Err(reason), Ok(())) => show(killed_alone(&run, &silence_of(&reason))),
        (Err(reason), Err(error)) => Err(Failure::trouble(not_killed(&run, &reason, &error))),
    }
}

fn silence_of(reason: &LiveError) -> String {
    match reason {
        LiveError::Abandoned(_) => "its orchestrator has died".to_owned(),
        LiveError::Silent(_) => "its orchestrator does not answer".to_owned(),
        reason => reason.to_string(),
    }
}

fn killed_alone(run: &MachineRun, orchestrator: &str) -> Answer {
    Answer::Done(format!(
        "killed: the motors of the run `{}` rest until its end; {orchestrator}, so its services were told directly",
        run.name()
    ))
}

fn not_killed(run: &MachineRun, reason: &LiveError, error: &std::io::Error) -> String {
    let pids: Vec<_> = run.pids().map(|pid| pid.to_string()).collect();
    format!(
        "NOT killed: {reason}; the services cannot be told directly either ({error}); cut the power, or end the run's \
         processes (`kill -KILL {}`): then no frames leave, and the receiver's failsafe decides",
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
