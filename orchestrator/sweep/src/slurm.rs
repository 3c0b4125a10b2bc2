//! `gerono sweep plan`: what would be flown, and the script that flies it on a cluster.

use std::time::Instant;

use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::{print, print_as_it_is};

use crate::arguments::Plan as Arguments;
use crate::definition::Source;
use crate::flight;
use crate::prepared::Prepared;
use crate::row::Outcome;

/// Flights that are flown to know how long one takes.
const TRIED: u64 = 4;

/// `gerono sweep plan`.
///
/// # Errors
/// [`Failure`] if the sweep cannot be flown.
pub(crate) fn plan(arguments: &Arguments) -> Result<(), Failure> {
    let prepared = Prepared::new(Source::read(&arguments.sweep)?)?;
    let plan = &prepared.plan;
    prepared.plan.check_flyable()?;
    let sweep = quoted(&arguments.sweep.display().to_string());
    if arguments.slurm {
        print_as_it_is(script(&sweep, arguments.shards, arguments.cpus));
        return Ok(());
    }
    let flights = plan.samples * plan.entries.len() as u64;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let begun = Instant::now();
    let (mut tried, mut refused) = (0, 0);
    for index in (0..plan.samples).take(usize::try_from(TRIED).expect("a few")) {
        for entry in &plan.entries {
            match flight::fly(plan, &plan.sample(index), entry, &interrupt)? {
                None => return Ok(()),
                Some(flown) if flown.outcome == Outcome::Refused => refused += 1,
                Some(_) => tried += 1,
            }
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "for a person")]
    let seconds = begun.elapsed().as_secs_f64() / f64::from(tried.max(1)) * flights as f64;
    let names: Vec<_> = plan.entries.iter().map(|entry| entry.name.as_str()).collect();
    print(format!(
        "{} samples of {}, each flown with {}: {flights} flights, about {} on one core\n{}\n",
        plan.samples,
        plan.source.scenario_path.display(),
        names.join(", "),
        duration(seconds),
        if refused > 0 {
            format!(
                "{refused} of the first {} flights are refused: their samples cannot be flown\n",
                tried + refused
            )
        } else {
            String::new()
        }
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
        "\nfly it here:            gerono sweep run {sweep}\nfly it on a cluster:    gerono sweep plan {sweep} --slurm > sweep.sh; sh sweep.sh\n"
    ));
    Ok(())
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

/// A text as one word of a shell, whatever it contains.
fn quoted(text: &str) -> String {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-._/".contains(letter);
    if text.chars().all(is_plain) && !text.is_empty() {
        return text.to_owned();
    }
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// The script: an array of shards that may be requeued, and a merge once all are complete. `sweep` is a word of a shell.
#[must_use]
pub fn script(sweep: &str, shards: u64, cpus: u64) -> String {
    let last = shards - 1;
    format!(
        "#!/bin/sh\n\
         # Flies $SWEEP as a Slurm job array of {shards} shards, and merges them once all are complete.\n\
         # A task that is killed and requeued goes on where it was; results are in $OUT, on a file system that all nodes share.\n\
         # If a task fails, the merge is cancelled: run this script again, and shards that are complete are not repeated.\n\
         set -eu\n\
         # What $OUT holds must be of this sweep: shards of another one are refused.\n\
         SWEEP={sweep}\n\
         OUT=${{OUT:-results}}\n\
         export SWEEP OUT\n\
         array=$(sbatch --parsable --export=ALL --requeue --open-mode=append --array=0-{last} --cpus-per-task={cpus} --job-name=gerono \\\n    \
             --wrap 'exec gerono sweep run \"$SWEEP\" --shard $SLURM_ARRAY_TASK_ID/{shards} --jobs $SLURM_CPUS_PER_TASK --out \"$OUT\"')\n\
         merge=$(sbatch --parsable --export=ALL --dependency=afterok:\"$array\" --kill-on-invalid-dep=yes --job-name=gerono-merge \\\n    \
             --wrap 'exec gerono sweep merge \"$OUT\"')\n\
         echo \"array $array, merge $merge\"\n"
    )
}
