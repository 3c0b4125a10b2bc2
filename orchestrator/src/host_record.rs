//! What the machine did during a run, written to `host.mcap`: which processes, on which core, how they fared.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Instant;

use shared_types::ServiceId;

use crate::flight::Outcome;
use crate::flight::crew::{Crew, Rebirth};
use crate::flight::lock_step::CrewObserver;
use crate::log::{Compression, HostEvent, HostLogWriter, HostSample, LogError, ServiceHealth};

/// Keeps `host.mcap`. A write that fails is reported when the record is finished; the flight goes on.
pub struct HostRecord {
    log: HostLogWriter,
    started: Instant,
    failure: Option<LogError>,
    /// How many of the crew's ends have been written.
    ends_written: usize,
    /// How many of its rebirths have been written.
    rebirths_written: usize,
}

impl HostRecord {
    /// Begins a record.
    ///
    /// # Errors
    /// [`LogError`].
    pub fn create(path: &Path, compression: Compression) -> Result<Self, LogError> {
        Ok(Self {
            log: HostLogWriter::create(path, compression)?,
            started: Instant::now(),
            failure: None,
            ends_written: 0,
            rebirths_written: 0,
        })
    }

    /// Closes the record.
    ///
    /// # Errors
    /// The first [`LogError`] that came up.
    pub fn finish(self) -> Result<(), LogError> {
        match self.failure {
            Some(failure) => Err(failure),
            None => self.log.finish().map(drop),
        }
    }

    fn time_ns(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn write<T: HostSample>(&mut self, sample: &T) {
        let result = self.log.write(sample);
        self.keep_first(result);
    }

    fn keep_first(&mut self, result: Result<(), LogError>) {
        if let (Err(failure), None) = (result, &self.failure) {
            self.failure = Some(failure);
        }
    }

    fn event(&mut self, service: Option<ServiceId>, kind: u32, pid: u32, text: &str) {
        let event = HostEvent::new(self.time_ns(), service, kind, pid, text);
        self.write(&event);
    }

    /// Writes how processes ended, as far as that is not written yet.
    fn write_ends(&mut self, crew: &Crew<'_>) {
        for (service, pid, exit) in &crew.exits()[self.ends_written..] {
            let kind = if exit.killed {
                HostEvent::KIND_KILLED
            } else {
                HostEvent::KIND_EXITED
            };
            self.event(*service, kind, *pid, &exit.description);
        }
        self.ends_written = crew.exits().len();
    }
}

impl CrewObserver for HostRecord {
    fn ready(&mut self, crew: &Crew<'_>, core: Option<usize>) {
        let result = self.log.write_facts("host", host_facts(core));
        self.keep_first(result);
        for (service, pid) in crew.processes() {
            self.event(Some(service), HostEvent::KIND_READY, pid, "has made its ports");
        }
    }

    fn changed(&mut self, crew: &Crew<'_>) {
        self.write_ends(crew);
        for rebirth in &crew.rebirths()[self.rebirths_written..] {
            let Rebirth { service, pid, .. } = *rebirth;
            self.event(Some(service), HostEvent::KIND_REBORN, pid, &rebirth.to_string());
        }
        self.rebirths_written = crew.rebirths().len();
    }

    fn health(&mut self, crew: &Crew<'_>) {
        for (service, pid) in crew.processes() {
            let cell = &crew.page().words().cells[service.index()];
            let ticks = cell.steps_until.load(Ordering::Relaxed);
            let sample = ServiceHealth {
                time_ns: self.time_ns(),
                service: u32::try_from(service.index()).expect("few services"),
                pid,
                tick: ticks.saturating_sub(1),
                steps: cell.steps.load(Ordering::Relaxed),
                waits_by_yield: cell.yields.load(Ordering::Relaxed),
                waits_by_blocking: cell.blocks.load(Ordering::Relaxed),
                cpu_time_ns: cpu_time_ns(pid),
            };
            self.write(&sample);
        }
    }

    fn ended(&mut self, crew: &Crew<'_>, outcome: &Outcome) {
        self.write_ends(crew);
        let text = match outcome {
            Outcome::Completed => "completed".to_owned(),
            Outcome::Interrupted { signal } => format!("interrupted by signal {signal}"),
            Outcome::Failed(failure) => failure.to_string(),
        };
        self.event(None, HostEvent::KIND_FINISHED, 0, &text);
    }
}

/// The machine and how the run uses it.
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

/// Time that a process has been on a core, ns; 0 if the system does not tell.
fn cpu_time_ns(pid: u32) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/schedstat")).unwrap_or_default();
    text.split_whitespace()
        .next()
        .and_then(|word| word.parse().ok())
        .unwrap_or(0)
}
