//! Writer of `host.mcap`, the record of a run's machine: processes, cores, health, steps.

mod snapshots;

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::time::Instant;

use runtime::flight_clock::monotonic_ns;
use runtime::step_log::StepRecord;
use scenario::Scenario;
use shared_types::ServiceId;
use shared_types::schedule::Edge;

use crate::Outcome;
use crate::host_record::snapshots::Snapshots;
use crate::real_time::StepObserver;
use runtime::activity;

use crate::supervision::{Restart, SupervisionObserver, Supervisor};
use metrics::summary::timing::TimingReport;
use run_log::{
    CaptureFigures, HostEvent, HostLogWriter, HostSample, LinkFigures, LogError, ServiceHealth, ServiceStep,
    flight_start,
};

/// Writer of `host.mcap`. After a failed write it stops recording, and the flight continues.
pub struct HostRecord {
    log: HostLogWriter,
    started: Instant,
    /// Time of tick 0 in real time, since the start of the record, ns.
    flight_begins_ns: u64,
    has_failed: bool,
    /// First failure, until it is reported.
    failure: Option<LogError>,
    /// Number of the supervisor's exits written so far.
    ends_written: usize,
    /// Number of the supervisor's restarts written so far.
    restarts_written: usize,
    snapshots: Snapshots,
}

impl HostRecord {
    /// Creates the record of a flight.
    #[must_use]
    pub fn new(log: HostLogWriter, scenario: &Scenario) -> Self {
        Self {
            log,
            started: Instant::now(),
            flight_begins_ns: 0,
            has_failed: false,
            failure: None,
            ends_written: 0,
            restarts_written: 0,
            snapshots: Snapshots::new(scenario),
        }
    }

    /// Closes the record.
    ///
    /// # Errors
    /// The first [`LogError`], unless it was reported in flight.
    pub fn finish(self) -> Result<(), LogError> {
        match self.failure {
            Some(failure) => Err(failure),
            None if self.has_failed => Ok(()),
            None => self.log.finish().map(drop),
        }
    }

    fn time_ns(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn write<T: HostSample>(&mut self, sample: &T) {
        if !self.has_failed {
            let result = self.log.write(sample);
            self.keep_first(result);
        }
    }

    fn keep_first(&mut self, result: Result<(), LogError>) {
        if let (Err(failure), false) = (result, self.has_failed) {
            self.has_failed = true;
            self.failure = Some(failure);
        }
    }

    fn event(&mut self, service: Option<ServiceId>, kind: u32, pid: u32, text: &str) {
        let event = HostEvent::new(self.time_ns(), service, kind, pid, text);
        self.write(&event);
    }

    /// Writes the exits of processes that were not written yet.
    fn write_ends(&mut self, supervisor: &Supervisor<'_>) {
        for (service, pid, exit) in &supervisor.supervision().exits()[self.ends_written..] {
            let kind = if exit.killed {
                HostEvent::KIND_KILLED
            } else {
                HostEvent::KIND_EXITED
            };
            self.event(*service, kind, *pid, &exit.description);
        }
        self.ends_written = supervisor.supervision().exits().len();
    }
}

impl SupervisionObserver for HostRecord {
    fn ready(&mut self, supervisor: &Supervisor<'_>, core: Option<usize>) {
        let result = self.log.write_facts("host", host_facts(core));
        self.keep_first(result);
        for (service, pid) in supervisor.processes() {
            self.event(Some(service), HostEvent::KIND_READY, pid, "has made its ports");
        }
    }

    fn changed(&mut self, supervisor: &Supervisor<'_>) {
        self.write_ends(supervisor);
        for restart in &supervisor.restarts()[self.restarts_written..] {
            let Restart { service, pid, .. } = *restart;
            self.event(Some(service), HostEvent::KIND_REBORN, pid, &restart.to_string());
        }
        self.restarts_written = supervisor.restarts().len();
    }

    fn progressed(&mut self, supervisor: &Supervisor<'_>, tick: u64) {
        for checkpoint in self
            .snapshots
            .take(supervisor.checkpoints(), supervisor.schedule(), tick)
        {
            for piece in checkpoint.pieces(self.time_ns()) {
                self.write(&piece);
            }
        }
    }

    fn health(&mut self, supervisor: &Supervisor<'_>) {
        for (service, pid) in supervisor.processes() {
            let cell = &supervisor.page().control_block().cells[service.index()];
            let ticks = cell.steps_until.load(Ordering::Relaxed);
            let sample = ServiceHealth {
                time_ns: self.time_ns(),
                service: u32::try_from(service.index()).expect("few services"),
                pid,
                tick: ticks.saturating_sub(1),
                steps: cell.steps.load(Ordering::Relaxed),
                waits_by_yield: cell.yields.load(Ordering::Relaxed),
                waits_by_blocking: cell.blocks.load(Ordering::Relaxed),
                cpu_time_ns: activity::read(pid).map_or(0, |activity| activity.cpu_time_ns),
            };
            self.write(&sample);
        }
    }

    fn ended(&mut self, supervisor: &Supervisor<'_>, outcome: &Outcome) {
        self.write_ends(supervisor);
        self.event(None, HostEvent::KIND_FINISHED, 0, &outcome.to_string());
    }
}

impl StepObserver for HostRecord {
    fn flight_begins_at(&mut self, start_ns: u64) {
        // Wrapping: after a take-over, tick 0 lies before the start of this record.
        let in_ns = start_ns.wrapping_sub(monotonic_ns());
        self.flight_begins_ns = self.time_ns().wrapping_add(in_ns);
        let result = flight_start::write(&mut self.log, start_ns);
        self.keep_first(result);
    }

    fn step(&mut self, service: ServiceId, record: &StepRecord, inputs: &[Edge]) {
        let seen = std::array::from_fn(|input| {
            let tick = record.consumed_tick(input);
            tick.map_or(0, |tick| 1 + inputs[input].sequence_number(tick))
        });
        self.write(&ServiceStep {
            time_ns: self.flight_begins_ns.wrapping_add(record.began_ns),
            began_ns: record.began_ns,
            published_ns: record.published_ns,
            tick: record.tick,
            previous: record.previous,
            consumed: ServiceStep::packed(seen),
            service: u32::try_from(service.index()).expect("few services"),
            missed: u32::try_from(record.missed).unwrap_or(u32::MAX),
            late_inputs: record.late_inputs as u32,
            fresh_inputs: record.fresh_inputs as u32,
            operator: record.operator as u32,
            pad0: 0,
        });
    }

    fn failure(&mut self) -> Option<LogError> {
        self.failure.take()
    }

    fn note(&mut self, text: &str) {
        self.event(None, HostEvent::KIND_NOTE, 0, text);
    }

    fn hung(&mut self, service: ServiceId) {
        let text = "has not stepped for too long and is replaced";
        self.event(Some(service), HostEvent::KIND_HUNG, 0, text);
    }

    fn capture(&mut self, figures: &CaptureFigures) {
        self.write(&CaptureFigures {
            time_ns: self.time_ns(),
            ..*figures
        });
    }

    fn link(&mut self, figures: &LinkFigures) {
        self.write(&LinkFigures {
            time_ns: self.time_ns(),
            ..*figures
        });
    }

    fn timing(&mut self, report: &TimingReport) {
        let rows = report.services.iter();
        let facts = rows.map(|timing| {
            let text = serde_json::to_string(timing).unwrap_or_default();
            (timing.service.to_owned(), text)
        });
        let chain = serde_json::to_string(&report.capture_to_frame).unwrap_or_default();
        let facts = facts.chain([("capture to frame".to_owned(), chain)]).collect();
        let result = self.log.write_facts("timing", facts);
        self.keep_first(result);
    }
}

/// Returns facts about the machine and its use by the run.
fn host_facts(core: Option<usize>) -> BTreeMap<String, String> {
    let system = rustix::system::uname();
    let text = |part: &std::ffi::CStr| part.to_string_lossy().into_owned();
    BTreeMap::from([
        (
            "kernel".to_owned(),
            format!("{} {}", text(system.sysname()), text(system.release())),
        ),
        ("machine".to_owned(), text(system.machine())),
        ("gerono".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        (
            "services' core".to_owned(),
            core.map_or_else(|| "any".to_owned(), |core| core.to_string()),
        ),
    ])
}
