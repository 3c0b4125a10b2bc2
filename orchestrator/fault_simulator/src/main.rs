//! Searches histories in which the supervisor's decisions violate a property. For developers.

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use fault_simulator::campaign::{self, Results};
use fault_simulator::flights::Flights;
use fault_simulator::properties::Property;
use fault_simulator::{FaultKind, History, course_of, shortest};

const HELP: &str = "\
Searches histories of faults in which the supervisor's decisions violate a property.

Usage: fault_simulator [--minutes M] [--first N] [--threads T]
       fault_simulator --seed N [--faults I,J,…]

  --minutes M   Search for M minutes (default: 1)
  --first N     First seed (default: 1)
  --threads T   Number of threads (default: number of cores)
  --seed N      Fly one history, and print everything that happens in it
  --faults I,J  Only these faults of it, counted from 0
  --help        Print this

Exit code 1 if a property is violated; the shortest history is printed, also as the literal of a test.
";

struct Arguments {
    minutes: f64,
    first: u64,
    threads: usize,
    seed: Option<u64>,
    faults: Option<Vec<usize>>,
}

fn main() -> ExitCode {
    let arguments = match parse(std::env::args().skip(1)) {
        Ok(Some(arguments)) => arguments,
        Ok(None) => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(problem) => {
            eprint!("{problem}\n\n{HELP}");
            return ExitCode::from(2);
        }
    };
    let is_fine = match arguments.seed {
        Some(seed) => fly_one(seed, arguments.faults.as_deref()),
        None => search(&arguments),
    };
    match is_fine {
        true => ExitCode::SUCCESS,
        false => ExitCode::from(1),
    }
}

fn parse(mut given: impl Iterator<Item = String>) -> Result<Option<Arguments>, String> {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let mut arguments = Arguments {
        minutes: 1.0,
        first: 1,
        threads: cores,
        seed: None,
        faults: None,
    };
    while let Some(name) = given.next() {
        if name == "--help" {
            return Ok(None);
        }
        let value = given.next().ok_or_else(|| format!("`{name}` needs a value"))?;
        let unfit = || format!("`{value}` does not fit `{name}`");
        match name.as_str() {
            "--minutes" => arguments.minutes = value.parse().map_err(|_| unfit())?,
            "--first" => arguments.first = value.parse().map_err(|_| unfit())?,
            "--threads" => arguments.threads = value.parse().map_err(|_| unfit())?,
            "--seed" => arguments.seed = Some(value.parse().map_err(|_| unfit())?),
            "--faults" => {
                let indices = value.split(',').map(str::parse);
                arguments.faults = Some(indices.collect::<Result<_, _>>().map_err(|_| unfit())?);
            }
            _ => return Err(format!("there is no `{name}`")),
        }
    }
    Ok(Some(arguments))
}

/// Flies one history and prints it. Returns whether all properties hold.
fn fly_one(seed: u64, faults: Option<&[usize]>) -> bool {
    let mut history = History::of_seed(seed);
    if let Some(indices) = faults {
        let kept = indices.iter().filter_map(|&index| history.faults.get(index));
        history.faults = kept.copied().collect();
    }
    println!("{history}");
    let course = course_of(&history, &mut Flights::default(), true);
    for line in &course.trace {
        println!("{line}");
    }
    match &course.violation {
        None => {
            println!("\nall properties hold");
            true
        }
        Some(violation) => {
            println!("\n{violation}");
            print_shortest(&history);
            false
        }
    }
}

fn print_shortest(history: &History) {
    if let Some(shortest) = shortest(history) {
        println!("shortest history: {shortest}{}\n", shortest.as_rust());
    }
}

/// Searches for a time. Returns whether all properties hold.
fn search(arguments: &Arguments) -> bool {
    let begin = Instant::now();
    let limit = Duration::from_secs_f64(arguments.minutes.max(0.0) * 60.0);
    let is_enough = AtomicBool::new(false);
    let said_at = AtomicU64::new(0);
    let progress = |histories: u64, faults: u64| {
        let elapsed = begin.elapsed();
        // Relaxed: a flag and a number on which nothing else depends.
        if elapsed >= limit {
            is_enough.store(true, Ordering::Relaxed);
        }
        let seconds = elapsed.as_secs();
        if said_at.fetch_max(seconds, Ordering::Relaxed) < seconds {
            let a_minute = faults as f64 / elapsed.as_secs_f64() * 60.0;
            eprint!("\r{seconds} s, {histories} histories, {faults} faults, {a_minute:.3e} a minute ");
        }
    };
    let results = campaign::fly(
        arguments.first..u64::MAX,
        arguments.threads,
        &is_enough,
        &progress,
    );
    eprintln!();
    print(&results, begin.elapsed());
    for (history, violation) in results.first.values() {
        println!("\nseed {}: {violation}", history.seed);
        print_shortest(history);
    }
    results.first.is_empty()
}

fn print(results: &Results, elapsed: Duration) {
    let minutes = elapsed.as_secs_f64() / 60.0;
    println!(
        "{} histories, {} of them with a vehicle in the air, with {} faults and {} restarts in {:.1} s: {:.3e} faults a minute, \
         {:.0} simulated hours, {:.3e} turns of the loop",
        results.histories,
        results.flown,
        results.faults,
        results.restarts,
        elapsed.as_secs_f64(),
        results.faults as f64 / minutes,
        results.simulated_ns as f64 / 3.6e12,
        results.turns as f64,
    );
    for kind in FaultKind::all() {
        let name = format!("{kind:?}");
        let faults = results.by_kind.get(&kind).copied().unwrap_or_default();
        print!("{name:18} {faults:9}");
        for property in Property::ALL {
            if let Some(count) = results.violations.get(&(kind, property)) {
                print!("  {property:?} {count}");
            }
        }
        println!();
    }
}
