//! Take-over of a flight without an orchestrator: its whole state comes from its services.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::flight_clock::FlightClock;
use runtime::orchestrator_watchdog::SILENCE_NS;
use runtime::take_over::{InheritedDescriptors, TakeOverListener};
use rustix::fs::{FlockOperation, flock};
use scenario::Scenario;
use shared_types::{Schedule, ServiceId};

use crate::RunFailure;
use crate::run_context::RunContext;
use crate::supervision::{OrphanedService, Shared};

/// Timeout for services: an orphaned one looks for an orchestrator once in [`SILENCE_NS`].
const SERVICE_TIMEOUT: Duration = Duration::from_nanos(3 * SILENCE_NS);

/// Flight that is ready to be taken over.
pub struct TakeOver {
    /// Lock that excludes other orchestrators until the run ends.
    pub(super) take_over_lock: File,
    pub(super) context: RunContext,
    pub(super) shared: Shared,
    pub(super) survivors: [Option<OrphanedService>; ServiceId::ALL.len()],
    /// Folder of the run.
    pub(super) folder: PathBuf,
    pub(super) clock: FlightClock,
    /// First tick that will be recorded.
    pub(super) first_tick: u64,
}

impl TakeOver {
    /// Waits for the services of the run, under an exclusive lock.
    ///
    /// # Errors
    /// [`RunFailure::setup`] if no service connects, one is of another build, or another take-over is under way.
    pub fn prepare(folder: &Path) -> Result<Self, RunFailure> {
        let take_over_lock = take_over_lock(folder)?;
        let listener = TakeOverListener::listen(folder).map_err(RunFailure::setup)?;
        let mut survivors = [const { None }; ServiceId::ALL.len()];
        let mut first: Option<InheritedDescriptors> = None;
        let deadline = Instant::now() + SERVICE_TIMEOUT;
        while survivors.iter().any(Option::is_none) {
            let left = deadline.saturating_duration_since(Instant::now());
            let Some(inheritance) = listener.accept(left).map_err(RunFailure::setup)? else {
                break;
            };
            let InheritedDescriptors {
                hello,
                pid,
                channel,
                files,
            } = inheritance;
            let line = channel.try_clone().map_err(RunFailure::setup)?;
            survivors[hello.service.index()] = Some((pid, channel));
            first.get_or_insert(InheritedDescriptors {
                hello,
                pid,
                channel: line,
                files,
            });
        }
        let first = first.ok_or_else(|| {
            let limit = SERVICE_TIMEOUT.as_secs_f64();
            RunFailure::setup(format!(
                "none of the run's services has connected within {limit} s: they have ended, their orchestrator lives, or \
                 signals have stopped them, which `gerono clean` ends"
            ))
        })?;
        let [page, checkpoints, step_log, lock] = first.files;
        let context = RunContext::take_over(&first.hello.start, lock)?;
        let shared = Shared::inherit(page, checkpoints, step_log).map_err(RunFailure::setup)?;
        if shared.page().control_block().stopping.load(Ordering::Acquire) != 0 {
            return Err(RunFailure::setup(
                "the vehicle has landed, and its services are about to end: `gerono recover` reads what was recorded",
            ));
        }
        let clock = FlightClock {
            start_ns: shared.page().control_block().start_ns.load(Ordering::Acquire),
            tick_ns: context.schedule.tick_ns(),
        };
        Ok(Self {
            take_over_lock,
            first_tick: clock.tick().min(context.schedule.last_tick()),
            context,
            shared,
            survivors,
            folder: folder.to_owned(),
            clock,
        })
    }

    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.context.scenario
    }

    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        &self.context.schedule
    }

    #[must_use]
    pub fn first_tick(&self) -> u64 {
        self.first_tick
    }
}

/// Kills the services of the run that have not connected: they are stopped or hung, and their successors need their
/// ports. Returns their PIDs.
pub(super) fn kill_unconnected(
    folder: &Path,
    survivors: &[Option<OrphanedService>],
) -> Result<Vec<u32>, RunFailure> {
    let connected = survivors.iter().flatten();
    let connected: Vec<u32> = connected
        .map(|(pid, _)| pid.as_raw_pid().cast_unsigned())
        .collect();
    run_client::runs::end_services_except(folder, &connected).map_err(RunFailure::setup)
}

/// Acquires the lock against other take-overs, which is on the run's folder.
fn take_over_lock(folder: &Path) -> Result<File, RunFailure> {
    let folder = File::open(folder).map_err(RunFailure::setup)?;
    flock(&folder, FlockOperation::NonBlockingLockExclusive)
        .map_err(|_| RunFailure::setup("another `gerono attach` takes this run over"))?;
    Ok(folder)
}
