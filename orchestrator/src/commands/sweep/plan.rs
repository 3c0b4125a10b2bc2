//! `gerono sweep plan`: shows the samples and the estimated time, and prints the script for a cluster.

use std::time::Instant;

use command_line::exit::Exit;
use command_line::interrupt;
use command_line::output::print_as_it_is;
use sweep::flight::fly;
use sweep::row::Outcome;
use sweep::shard::Shard;
use sweep::slurm::{quoted, script};

use super::failure;
use crate::cli::SweepPlan;
use crate::commands::{Failure, ended, print};

/// Number of samples flown to estimate the time of a flight.
const TRIED: u64 = 4;

/// `gerono sweep plan`.
///
/// # Errors
/// [`Failure`] if the sweep cannot be flown.
pub(super) fn plan(arguments: &SweepPlan) -> Result<Exit, Failure> {
    let prepared = super::prepared(&arguments.sweep)?;
    let plan = &prepared.plan;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    super::check_flyable(&prepared, Shard::WHOLE, &interrupt)?;
    let sweep = quoted(&arguments.sweep.display().to_string());
    if arguments.slurm {
        print_as_it_is(script(&sweep, arguments.shards, arguments.cpus));
        return Ok(Exit::Success);
    }
    let flights = plan.samples * plan.entries.len() as u64;
    let begun = Instant::now();
    let mut tried = 0;
    for index in (0..plan.samples).take(usize::try_from(TRIED).expect("a few")) {
        for entry in &plan.entries {
            match fly(plan, &plan.sample(index), entry, &interrupt).map_err(failure)? {
                None => return Ok(ended(&interrupt)),
                Some(flown) => tried += u32::from(flown.outcome != Outcome::Refused),
            }
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "for a person")]
    let seconds = begun.elapsed().as_secs_f64() / f64::from(tried.max(1)) * flights as f64;
    let names: Vec<_> = plan.entries.iter().map(|entry| entry.name.as_str()).collect();
    print(format!(
        "{} samples of {}, each flown with {}: {flights} flights, about {} on one core\n\n",
        plan.samples,
        plan.source.scenario_path.display(),
        names.join(", "),
        duration(seconds)
    ));
    let columns: Vec<_> = plan.columns().collect();
    for index in 0..plan.samples.min(5) {
        let sample = plan.sample(index);
        print(format!("sample {index}, seed {}\n", sample.seed));
        for (column, value) in columns.iter().zip(&sample.values) {
            print(format!("  {column} = {value}\n"));
        }
    }
    print(format!(
        "\non this machine:        gerono sweep run {sweep}\non a cluster:           gerono sweep plan {sweep} --slurm > sweep.sh; sh sweep.sh\n"
    ));
    Ok(Exit::Success)
}

fn duration(seconds: f64) -> String {
    if seconds < 120.0 {
        format!("{seconds:.1} s")
    } else if seconds < 7200.0 {
        format!("{:.0} min", seconds / 60.0)
    } else {
        format!("{:.1} h", seconds / 3600.0)
    }
}
