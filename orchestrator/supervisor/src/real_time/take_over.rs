//! Taking over a flight whose orchestrator is gone: everything of it is learned from its services.

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

/// Longest wait for services: an orphaned one looks for an orchestrator once in [`SILENCE_NS`].
const PATIENCE: Duration = Duration::from_nanos(3 * SILENCE_NS);

/// A flight that is ready to be taken over.
pub struct TakeOver {
    /// Held until the run ends.
    pub(super) only_one: File,
    pub(super) context: RunContext,
    pub(super) shared: Shared,
    pub(super) survivors: [Option<OrphanedService>; ServiceId::ALL.len()],
    /// Place of the run.
    pub(super) place: PathBuf,
    pub(super) clock: FlightClock,
    /// The first tick that will be recorded.
    pub(super) first_tick: u64,
}

impl TakeOver {
    /// Waits at the place of a run for its services, alone: a second one is refused.
    ///
    /// # Errors
    /// [`RunFailure::setup`] if none comes, or if one is of another build.
    pub fn prepare(place: &Path) -> Result<Self, RunFailure> {
        let only_one = only_one(place)?;
        let listener = TakeOverListener::listen(place).map_err(RunFailure::setup)?;
        let mut survivors = [const { None }; ServiceId::ALL.len()];
        let mut first: Option<InheritedDescriptors> = None;
        let deadline = Instant::now() + PATIENCE;
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
            let limit = PATIENCE.as_secs_f64();
            RunFailure::setup(format!(
                "none of the run's services has come within {limit} s: they have ended, their orchestrator lives, or \
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
            only_one,
            first_tick: clock.tick().min(context.schedule.last_tick()),
            context,
            shared,
            survivors,
            place: place.to_owned(),
            clock,
        })
    }

    /// The curve that is flown.
    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.context.scenario
    }

    /// Returns when everybody steps.
    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        &self.context.schedule
    }

    /// The first tick that will be recorded.
    #[must_use]
    pub fn first_tick(&self) -> u64 {
        self.first_tick
    }
}

/// Kills the services of the run at a place that have not come: they are stopped or hang, and whatever takes their place needs
/// their ports. Returns the numbers of their processes.
pub(super) fn end_the_others(
    place: &Path,
    survivors: &[Option<OrphanedService>],
) -> Result<Vec<u32>, RunFailure> {
    let came = survivors.iter().flatten();
    let came: Vec<u32> = came.map(|(pid, _)| pid.as_raw_pid().cast_unsigned()).collect();
    run_client::runs::end_services_except(place, &came).map_err(RunFailure::setup)
}

/// Takes the lock of those that take a run over, which is one on its folder.
fn only_one(place: &Path) -> Result<File, RunFailure> {
    let folder = File::open(place).map_err(RunFailure::setup)?;
    flock(&folder, FlockOperation::NonBlockingLockExclusive)
        .map_err(|_| RunFailure::setup("another `gerono attach` takes this run over"))?;
    Ok(folder)
}
