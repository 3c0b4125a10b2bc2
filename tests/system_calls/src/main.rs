//! `system_calls kill|fail|order GERONO [--every N] [--seed SEED] [--only ROLE] [--calls FROM-TO] [-- FLIGHT…]`
//!
//! * `kill`: kills each service at each of its system calls, one flight each; the log has the bytes of an undisturbed one,
//!   or the flight has not begun and the program says why.
//! * `fail`: lets each system call of each process fail. The log has the same bytes, or the program says what failed and
//!   the log is a beginning of the undisturbed one.
//! * `order`: lets one thread run at a time, chosen by a seeded generator at each system call.

mod tracer;

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use tracer::{Act, Life, Outcome, Plan, Scope};

/// Longer than every limit of the program on a busy machine.
const LIMIT: Duration = Duration::from_secs(90);

struct Options {
    mode: String,
    gerono: String,
    every: u64,
    seed: u64,
    only: Option<String>,
    calls: std::ops::RangeInclusive<u64>,
    flight: Vec<String>,
}

fn options() -> Option<Options> {
    let mut words = std::env::args().skip(1);
    let mut options = Options {
        mode: words.next()?,
        gerono: words.next()?,
        every: 1,
        seed: 1,
        only: None,
        calls: 1..=u64::MAX,
        flight: Vec::new(),
    };
    while let Some(word) = words.next() {
        match word.as_str() {
            "--every" => options.every = words.next()?.parse().ok()?,
            "--seed" => options.seed = words.next()?.parse().ok()?,
            "--only" => options.only = Some(words.next()?),
            "--calls" => {
                let range = words.next()?;
                let (from, to) = range.split_once('-')?;
                options.calls = from.parse().ok()?..=to.parse().ok()?;
            }
            "--" => options.flight = words.by_ref().collect(),
            _ => return None,
        }
    }
    Some(options)
}

/// Flights of one scenario, in a folder of their own.
struct Flights {
    gerono: String,
    arguments: Vec<String>,
    folder: PathBuf,
    reference: Vec<u8>,
    /// Messages of the reference, one a line.
    messages: String,
    is_real_time: bool,
}

/// What one disturbed flight came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Verdict {
    /// The log has the bytes of the reference.
    Same,
    /// The program said why it ended.
    Refused,
    /// The process made fewer calls this time.
    NotReached,
}

impl Flights {
    fn fly(&self, plan: &Plan, scope: Scope) -> (Outcome, PathBuf) {
        let out = self.folder.join("flight");
        let _ = fs::remove_dir_all(&out);
        #[expect(clippy::disallowed_methods, reason = "it is no result")]
        let said = fs::File::create(self.folder.join("said")).expect("the folder can be written");
        let mut command = tracer::wrapped(&self.gerono);
        command.args(&self.arguments).arg("--out").arg(&out);
        command.stdout(Stdio::null()).stderr(said);
        // Flights of others must not suffer from what fails here.
        command.env("XDG_RUNTIME_DIR", &self.folder);
        (tracer::run(&mut command, plan, scope, LIMIT), out)
    }

    fn said(&self) -> String {
        fs::read_to_string(self.folder.join("said")).unwrap_or_default()
    }

    /// Judges a flight. `Err` says what is wrong with it.
    fn judge(&self, outcome: &Outcome, out: &Path, is_acted: bool) -> Result<Verdict, String> {
        let said = self.said();
        if outcome.hung {
            let last: Vec<_> = outcome
                .calls
                .iter()
                .map(|(life, made)| (life, made.len(), made.iter().rev().take(12).collect::<Vec<_>>()))
                .collect();
            return Err(format!(
                "did not end within {} s; last calls {last:?}: {said}",
                LIMIT.as_secs()
            ));
        }
        let code = outcome
            .code
            .ok_or_else(|| format!("was ended by a signal: {said}"))?;
        if said.contains("panicked") {
            return Err(format!("panicked: {said}"));
        }
        let mut left = self.leftovers(outcome.pid, Duration::from_secs(3));
        if !left.is_empty() && outcome.failed.is_some() {
            // The program could not remove it, but the next run can.
            let mut clean = Command::new(&self.gerono);
            clean.arg("clean").env("XDG_RUNTIME_DIR", &self.folder);
            clean.output().expect("the program starts");
            left = self.leftovers(outcome.pid, Duration::ZERO);
        }
        if !left.is_empty() {
            return Err(format!("exit code {code}, and left {left:?}: {said}"));
        }
        let log = out.join("run.mcap");
        if code == 0 {
            if !self.is_real_time && fs::read(&log).ok().as_ref() != Some(&self.reference) {
                return Err("exit code 0, and another log".to_owned());
            }
            return Ok(if is_acted {
                Verdict::Same
            } else {
                Verdict::NotReached
            });
        }
        if said.trim().is_empty() {
            return Err(format!("exit code {code}, and no message"));
        }
        let partial = out.join("run.mcap.partial");
        let found = [&log, &partial].into_iter().find(|file| file.exists());
        if let (false, Some(file)) = (self.is_real_time, found) {
            let messages = messages(&self.gerono, file);
            if !self.messages.starts_with(&messages) {
                return Err(format!(
                    "exit code {code}, and a log that is no beginning of the reference: {said}"
                ));
            }
        }
        Ok(Verdict::Refused)
    }

    /// What a run has left in shared memory, after its last process had time to end.
    fn leftovers(&self, pid: i32, limit: Duration) -> Vec<String> {
        let since = Instant::now();
        let runs = self.folder.join(format!("gerono-{}", nix::unistd::geteuid()));
        loop {
            let folders = [Path::new("/dev/shm"), &runs];
            let entries = folders.iter().filter_map(|folder| fs::read_dir(folder).ok());
            let names = entries
                .flatten()
                .flatten()
                .map(|entry| entry.file_name().to_string_lossy().into_owned());
            let marks = [format!("{pid}-"), format!("gerono_{pid}-")];
            let found: Vec<_> = names
                .filter(|name| marks.iter().any(|mark| name.starts_with(mark)))
                .collect();
            if found.is_empty() || since.elapsed() >= limit {
                return found;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

fn messages(gerono: &str, log: &Path) -> String {
    let found = Command::new(gerono)
        .arg("export")
        .arg(log)
        .output()
        .expect("the program starts");
    String::from_utf8_lossy(&found.stdout).into_owned()
}

fn main() -> ExitCode {
    let Some(options) = options() else {
        eprintln!(
            "system_calls kill|fail|order GERONO [--every N] [--seed SEED] [--only ROLE] [--calls FROM-TO] -- FLIGHT…"
        );
        return ExitCode::from(2);
    };
    // In memory: the bookkeeping of iceoryx2 waits for the disk.
    let folder = PathBuf::from(format!("/dev/shm/system_calls-{}", std::process::id()));
    fs::DirBuilder::new()
        .mode(0o700)
        .create(&folder)
        .expect("shared memory can be written");
    let mut arguments = vec!["run".to_owned(), "--quiet".to_owned()];
    arguments.extend(options.flight.iter().cloned());
    let mut flights = Flights {
        gerono: options.gerono.clone(),
        is_real_time: arguments.iter().any(|word| word == "realtime"),
        arguments,
        folder: folder.clone(),
        reference: Vec::new(),
        messages: String::new(),
    };
    let (undisturbed, out) = flights.fly(&Plan::new(), Scope::All);
    assert_eq!(
        undisturbed.code,
        Some(0),
        "the undisturbed flight: {}",
        flights.said()
    );
    flights.reference = fs::read(out.join("run.mcap")).expect("a log");
    flights.messages = messages(&flights.gerono, &out.join("run.mcap"));
    let trials = trials(&options, &calls_alone(&flights, undisturbed.calls));
    let mut tallies: BTreeMap<(String, Verdict), u64> = BTreeMap::new();
    let (began, mut wrong) = (Instant::now(), 0);
    for (name, plan, scope) in &trials {
        let (outcome, out) = flights.fly(plan, *scope);
        let is_acted = plan.is_empty() || !outcome.acted.is_empty();
        match flights.judge(&outcome, &out, is_acted) {
            Ok(verdict) => {
                if verdict == Verdict::Refused && options.mode != "order" {
                    let said = flights.said();
                    println!(
                        "said    {name} {plan:?} {:?}: {}",
                        outcome.failed,
                        said.split_whitespace().collect::<Vec<_>>().join(" ")
                    );
                }
                *tallies.entry((name.clone(), verdict)).or_default() += 1;
            }
            Err(what) => {
                wrong += 1;
                println!("WRONG   {name} {plan:?} {scope:?} {:?}: {what}", outcome.failed);
            }
        }
    }
    for ((name, verdict), count) in tallies {
        println!("{name:32} {verdict:?}: {count}");
    }
    println!("{} flights in {} s", trials.len(), began.elapsed().as_secs());
    println!("{} passed, {wrong} failed", trials.len() as u64 - wrong);
    let _ = fs::remove_dir_all(folder);
    ExitCode::from(u8::from(wrong > 0))
}

/// Calls of each process while no other one is traced: tracing slows a process down, so that others sleep more often.
fn calls_alone(flights: &Flights, all: BTreeMap<Life, Vec<u64>>) -> BTreeMap<Life, Vec<u64>> {
    let mut alone = BTreeMap::new();
    for (life, made) in all {
        let plan = Plan::from([(life.clone(), (u64::MAX, Act::Kill))]);
        let (outcome, _) = flights.fly(&plan, Scope::Planned);
        let found = outcome.calls.get(&life).cloned().unwrap_or_default();
        alone.insert(life, if found.len() > made.len() / 4 { found } else { made });
    }
    alone
}

type Trial = (String, Plan, Scope);

fn trials(options: &Options, calls: &BTreeMap<Life, Vec<u64>>) -> Vec<Trial> {
    if options.mode == "order" {
        let count = if *options.calls.end() == u64::MAX {
            20
        } else {
            *options.calls.end()
        };
        let seeds = options.seed..options.seed + count;
        return seeds
            .map(|seed| ("order".to_owned(), Plan::new(), Scope::Scheduled(seed)))
            .collect();
    }
    let sleeps = |made: &Vec<u64>| {
        let numbers = (1..)
            .zip(made)
            .filter(|&(_, &call)| call == nix::libc::SYS_ppoll.cast_unsigned());
        let numbers: Vec<u64> = numbers.map(|(number, _)| number).collect();
        numbers.get(numbers.len() / 2).copied()
    };
    let in_flight = calls
        .get(&("controller".to_owned(), 0))
        .and_then(sleeps)
        .unwrap_or(1);
    let mut trials = Vec::new();
    for (life, made) in calls {
        let (role, _) = life;
        let is_service = role != "run";
        if options.only.as_ref().is_some_and(|only| only != role) || (options.mode == "kill" && !is_service) {
            continue;
        }
        // Before, the dynamic linker is at work.
        let own = made
            .iter()
            .take(100)
            .rposition(|&call| call == nix::libc::SYS_sigaltstack.cast_unsigned());
        let own = own.filter(|_| options.mode == "fail").unwrap_or(0);
        let numbers = (1..)
            .zip(made)
            .skip(own)
            .skip((options.seed % options.every) as usize);
        for (number, _) in numbers.step_by(options.every as usize) {
            if !options.calls.contains(&number) {
                continue;
            }
            let mut plan = Plan::new();
            let name = if options.mode == "kill" {
                plan.insert(life.clone(), (number, Act::Kill));
                if role == "spare" {
                    // It has a role only after another process has died in flight.
                    plan.insert(("controller".to_owned(), 0), (in_flight, Act::Kill));
                }
                role.clone()
            } else {
                plan.insert(life.clone(), (number, Act::Fail(number + options.seed)));
                role.clone()
            };
            trials.push((name, plan, Scope::Planned));
        }
    }
    trials
}
