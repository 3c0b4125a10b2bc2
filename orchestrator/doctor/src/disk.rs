//! The disk of the results: whether a flight's log fits, and whether it can be written fast enough.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::check::{Check, bytes};
use super::host::{HostFacts, Space};
use super::needs::Needs;

/// Bytes written by the measurement.
const PROBE_BYTES: u64 = 64 << 20;

/// The measurement uses at most 1 / `PROBE_SHARE` of the free space.
const PROBE_SHARE: u64 = 10;

/// Time limit of the measurement, without its last write.
const TIME_LIMIT: Duration = Duration::from_secs(2);

/// Number of flights that must fit for a green verdict.
const GREEN_FLIGHTS: u64 = 10;

/// Ratio of the disk's speed to the log's growth for a green verdict: other programs write as well.
const GREEN_SPEED_RATIO: f64 = 4.0;

/// Returns the folder `runs`, or its nearest ancestor that exists.
#[must_use]
pub fn nearest_folder(runs: &Path) -> PathBuf {
    let here = || PathBuf::from(".");
    runs.ancestors()
        .find(|folder| folder.is_dir())
        .map_or_else(here, Path::to_owned)
}

/// Checks whether a flight's log fits on the disk.
#[must_use]
pub fn space(host: &HostFacts, folder: &Path, needs: &Needs) -> Check {
    const NAME: &str = "disk space";
    let fix = "remove old runs, or name a folder on another disk with `--out` (and here with `--runs`)";
    let Space { free, .. } = match host.space(folder) {
        Ok(space) => space,
        Err(error) => return Check::red(NAME, format!("{}: {error}", folder.display()), fix),
    };
    let figure = format!(
        "{} free for {}, {} of {} s writes {}",
        bytes(free),
        folder.display(),
        flight(needs),
        needs.duration,
        bytes(needs.log_bytes)
    );
    if free < needs.log_bytes {
        Check::red(NAME, figure, fix)
    } else if free / GREEN_FLIGHTS < needs.log_bytes {
        Check::yellow(NAME, figure, fix)
    } else {
        Check::green(NAME, figure)
    }
}

/// Returns why the log of a flight does not fit into a folder, with the fix. `None` also if the free space is unknown: the flight
/// is allowed to try.
#[must_use]
pub fn shortage(host: &HostFacts, folder: &Path, needs: &Needs) -> Option<String> {
    let Space { total, free } = host.space(folder).ok()?;
    (total > 0 && free < needs.log_bytes).then(|| {
        format!(
            "the log of {} s needs {}, and {} are free for {}; remove old runs, name a folder on another disk with `--out`, \
             compress (`--compression lz4`), record less (`record.every`, `record.leave_out`), or state a shorter `duration`",
            needs.duration,
            bytes(needs.log_bytes),
            bytes(free),
            folder.display()
        )
    })
}

/// Checks whether the log of a flight in real time can be written as fast as it grows.
#[must_use]
pub fn speed(measured: &io::Result<f64>, needs: &Needs) -> Check {
    const NAME: &str = "disk speed";
    let fix = "name a folder on a faster disk with `--out`, or a compression with `--compression`";
    let speed = match measured {
        Ok(speed) => *speed,
        Err(error) => {
            let figure = format!("nothing can be written: {error}");
            return Check::red(
                NAME,
                figure,
                "name a folder that can be written with `--out` (and here with `--runs`)",
            );
        }
    };
    let rate = needs.log_rate();
    let figure = format!(
        "{}/s, {} writes {}/s in real time",
        bytes(speed as u64),
        flight(needs),
        bytes(rate as u64)
    );
    if speed < rate {
        Check::red(NAME, figure, fix)
    } else if speed < GREEN_SPEED_RATIO * rate {
        Check::yellow(NAME, figure, fix)
    } else {
        Check::green(NAME, figure)
    }
}

fn flight(needs: &Needs) -> &'static str {
    if needs.has_scenario {
        "this flight"
    } else {
        "a flight at 1 kHz"
    }
}

/// Measures the speed at which data reach the disk, bytes/s; `None` if it was stopped.
///
/// The file is unlinked before it is written: nothing is left, however this process ends.
///
/// # Errors
/// If the folder is not writable.
pub fn measure(folder: &Path, free: u64, stopped: impl Fn() -> bool) -> io::Result<Option<f64>> {
    let mut file = unlinked_file(folder)?;
    // Zeros would not be stored by some file systems.
    let block: Vec<u8> = (0..1 << 20_u32)
        .map(|index: u32| (index.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    let most = PROBE_BYTES.min(free / PROBE_SHARE).max(block.len() as u64);
    let started = Instant::now();
    let mut written = 0;
    while written < most && started.elapsed() < TIME_LIMIT {
        if stopped() {
            return Ok(None);
        }
        file.write_all(&block)?;
        file.sync_data()?;
        written += block.len() as u64;
    }
    Ok(Some(written as f64 / started.elapsed().as_secs_f64()))
}

#[expect(clippy::disallowed_methods, reason = "the file loses its name at once")]
fn unlinked_file(folder: &Path) -> io::Result<File> {
    let path = folder.join(format!(".gerono-doctor-{}", std::process::id()));
    let file = OpenOptions::new().write(true).create_new(true).open(&path)?;
    fs::remove_file(&path)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::super::CheckOutcome::{Green, Red, Yellow};
    use super::super::host::fake;
    use super::*;

    #[test]
    fn space_is_judged_by_what_a_flight_writes() {
        let needs = Needs::ordinary();
        let one = needs.log_bytes;
        for (free, verdict) in [
            (one - 1, Red),
            (one, Yellow),
            (10 * one - 1, Yellow),
            (10 * one, Green),
        ] {
            let (_folder, host) = fake(
                &[],
                Some(Space {
                    total: 20 * one,
                    free,
                }),
            );
            let check = space(&host, Path::new("runs"), &needs);
            assert_eq!(check.verdict, verdict, "{check:?}");
            assert_eq!(check.fix.is_none(), verdict == Green);
        }
        let (_folder, host) = fake(&[], None);
        assert_eq!(space(&host, Path::new("runs"), &needs).verdict, Red);
    }

    #[test]
    fn a_log_that_does_not_fit_is_refused_with_the_numbers() {
        let needs = Needs::ordinary();
        let with = |total, free| {
            let (_folder, host) = fake(&[], Some(Space { total, free }));
            shortage(&host, Path::new("runs"), &needs)
        };
        assert_eq!(with(1 << 40, needs.log_bytes), None);
        assert_eq!(with(0, 0), None, "a file system that does not tell");
        assert_eq!(shortage(&fake(&[], None).1, Path::new("runs"), &needs), None);
        let told = with(1 << 40, 3 << 20).unwrap();
        for piece in [
            "of 60 s needs ",
            " MiB, and 3.0 MiB are free for runs; ",
            "`--out`",
        ] {
            assert!(told.contains(piece), "no `{piece}` in {told}");
        }
    }

    #[test]
    fn speed_is_judged_by_how_fast_the_log_grows() {
        let needs = Needs::ordinary();
        let rate = needs.log_rate();
        for (share, verdict) in [(0.99, Red), (1.01, Yellow), (3.99, Yellow), (4.01, Green)] {
            let check = speed(&Ok(share * rate), &needs);
            assert_eq!(check.verdict, verdict, "{check:?}");
            assert_eq!(check.fix.is_none(), verdict == Green);
        }
        let refused = Err(io::Error::from(io::ErrorKind::PermissionDenied));
        assert_eq!(speed(&refused, &needs).verdict, Red);
    }

    #[test]
    fn measuring_leaves_nothing_and_ends_when_it_is_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let speed = measure(folder.path(), 0, || false).unwrap();
        assert!(speed.unwrap() > 0.0);
        assert_eq!(measure(folder.path(), 0, || true).unwrap(), None);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(measure(&folder.path().join("nowhere"), 0, || false).is_err());
    }

    #[test]
    fn results_go_to_the_nearest_folder_that_is_there() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(nearest_folder(&folder.path().join("runs/deep")), folder.path());
        assert_eq!(nearest_folder(folder.path()), folder.path());
        assert_eq!(nearest_folder(Path::new("no-such-folder")), Path::new("."));
    }
}
