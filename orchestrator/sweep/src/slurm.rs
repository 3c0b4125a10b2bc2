//! The script that flies a sweep on a cluster.

/// Quotes a text as one word of a shell.
#[must_use]
pub fn quoted(text: &str) -> String {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-._/".contains(letter);
    if text.chars().all(is_plain) && !text.is_empty() {
        return text.to_owned();
    }
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// Returns the script: a job array of shards that may be requeued, and a merge once all are complete. `sweep` is a quoted word.
#[must_use]
pub fn script(sweep: &str, shards: u64, cpus: u64) -> String {
    let last = shards - 1;
    format!(
        "#!/bin/sh\n\
         # Flies $SWEEP as a Slurm job array of {shards} shards, and merges them once all are complete.\n\
         # A task that is killed and requeued resumes; results are in $OUT, on a file system that all nodes share.\n\
         # If a task fails, the merge is cancelled: run this script again; complete shards are not repeated.\n\
         set -eu\n\
         # $OUT must hold shards of this sweep only: others are refused.\n\
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
