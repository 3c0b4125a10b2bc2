//! Timing of the steps of a flight in real time: lateness, duration, missed inputs, and the time from a capture to the
//! frame based on it.

use hdrhistogram::Histogram;
use runtime::step_log::{StepLog, StepReader, StepRecord};
use shared_types::schedule::Edge;
use shared_types::service::seconds;
use shared_types::{Schedule, ServiceId, Topic};

use metrics::summary::timing::{Distribution, Quantiles, ServiceTiming, TimingReport, histogram};
use run_client::snapshot::{InputSnapshot, ServiceSnapshot};

/// Number of recent steps of each service that are stored by tick.
const HISTORY: u64 = 4096;

/// Chain from a capture to a frame: the services, last first, each with the input on the chain.
const CHAIN: [(ServiceId, Topic); 4] = [
    (ServiceId::RcOutput, Topic::ControlCommand),
    (ServiceId::Controller, Topic::PathReference),
    (ServiceId::PathGenerator, Topic::VehicleState),
    (ServiceId::Estimator, Topic::MocapPose),
];

/// Collector of step records and their statistics.
pub struct Monitor {
    tracks: Vec<Track>,
    /// Steps whose publishers may not have recorded theirs yet.
    unsettled: Vec<(ServiceId, StepRecord)>,
    capture_to_frame: Histogram<u64>,
    chain_window: Histogram<u64>,
    last_chain_window: Histogram<u64>,
}

/// Records and statistics of one service.
struct Track {
    service: ServiceId,
    /// Process name.
    name: &'static str,
    edges: Vec<Edge>,
    /// Whether any step reads each input: an unconnected one has no age.
    is_read: Vec<bool>,
    tick_ns: u64,
    reader: StepReader,
    recent: Vec<Option<StepRecord>>,
    missed: u64,
    /// Steps repeated by the successor of a process that died after them.
    repeated: u64,
    late_inputs: u64,
    stale_inputs: u64,
    timing: Timing,
    /// Statistics of the current second, and of the one before.
    window: Timing,
    last_window: Timing,
    last: Option<StepRecord>,
}

/// Lateness and duration of steps.
struct Timing {
    steps: u64,
    wake: Histogram<u64>,
    duration: Histogram<u64>,
}

impl Timing {
    fn new() -> Self {
        Self {
            steps: 0,
            wake: histogram(),
            duration: histogram(),
        }
    }

    fn clear(&mut self) {
        self.steps = 0;
        self.wake.reset();
        self.duration.reset();
    }
}

impl Monitor {
    /// Creates the monitor; `name_of` returns the process name of a service.
    #[must_use]
    pub fn new(schedule: &Schedule, name_of: impl Fn(ServiceId) -> &'static str) -> Self {
        let track = |service| Track::new(service, name_of(service), schedule);
        Self {
            tracks: ServiceId::ALL.map(track).into(),
            unsettled: Vec::new(),
            capture_to_frame: histogram(),
            chain_window: histogram(),
            last_chain_window: histogram(),
        }
    }

    /// Skips the records written before now.
    pub fn begin_now(&mut self, log: &StepLog) {
        for track in &mut self.tracks {
            track.reader = StepReader::from_now(track.service, log);
        }
    }

    /// Reads the new records, and passes each to `sink`.
    pub fn collect(&mut self, log: &StepLog, mut sink: impl FnMut(ServiceId, &StepRecord, &[Edge])) {
        let mut come = Vec::new();
        for track in &mut self.tracks {
            while let Some(record) = track.reader.next(log) {
                track.keep(record);
                sink(track.service, &record, &track.edges);
                come.push((track.service, record));
            }
        }
        // Records of the previous call: by now their publishers have recorded the consumed samples.
        for (service, record) in std::mem::replace(&mut self.unsettled, come) {
            self.settle(service, &record);
        }
    }

    /// Ends a second: its statistics are the ones that clients get from now on.
    pub fn end_window(&mut self) {
        for track in &mut self.tracks {
            std::mem::swap(&mut track.window, &mut track.last_window);
            track.window.clear();
        }
        std::mem::swap(&mut self.chain_window, &mut self.last_chain_window);
        self.chain_window.reset();
    }

    /// Returns the state of the services in the last second; the supervisor adds its own fields.
    #[must_use]
    pub fn services(&self) -> Vec<ServiceSnapshot> {
        self.tracks.iter().map(Track::snapshot).collect()
    }

    /// Returns the time from a capture to the frame based on it, in the last second.
    #[must_use]
    pub fn capture_to_frame(&self) -> Option<Quantiles> {
        Quantiles::of(&self.last_chain_window)
    }

    #[must_use]
    pub fn finish(mut self) -> TimingReport {
        for (service, record) in std::mem::take(&mut self.unsettled) {
            self.settle(service, &record);
        }
        TimingReport {
            services: self.tracks.iter().map(Track::report).collect(),
            capture_to_frame: Distribution::of(&self.capture_to_frame),
            unrecorded: Vec::new(),
        }
    }

    /// Returns the number of ticks at which a service has stepped, including overwritten records.
    #[must_use]
    pub fn steps(&self, service: ServiceId) -> u64 {
        let track = &self.tracks[service.index()];
        track.timing.steps + track.reader.overwritten() - track.repeated
    }

    fn settle(&mut self, service: ServiceId, record: &StepRecord) {
        let track = &self.tracks[service.index()];
        let waited_for = track.edges.iter().enumerate().filter_map(|(input, edge)| {
            let is_awaited = edge.due_sample(record.tick) == Some(record.tick);
            let publisher = edge.topic.publisher().filter(|_| is_awaited)?;
            let of_publisher = self.tracks[publisher.index()].at(record.consumed_tick(input)?)?;
            Some(of_publisher.published_ns)
        });
        let could_begin = waited_for.fold(track.tick_ns * record.tick, u64::max);
        let is_late = record.late_inputs != 0;
        let track = &mut self.tracks[service.index()];
        if !is_late {
            let wake = record.began_ns.saturating_sub(could_begin);
            track.timing.wake.saturating_record(wake);
            track.window.wake.saturating_record(wake);
        }
        if let Some(elapsed) = self.since_capture(service, record) {
            self.capture_to_frame.saturating_record(elapsed);
            self.chain_window.saturating_record(elapsed);
        }
    }

    /// Returns the time from the publication of a capture to that of the frame based on it, ns.
    fn since_capture(&self, service: ServiceId, record: &StepRecord) -> Option<u64> {
        if service != ServiceId::RcOutput || record.late_inputs != 0 {
            return None;
        }
        let mut at = *record;
        for (consumer, topic) in CHAIN {
            let input = consumer.inputs().iter().position(|input| input.topic == topic)?;
            at = *self.tracks[topic.publisher()?.index()].at(at.consumed_tick(input)?)?;
        }
        // The publication time of a step in which a process died is unknown.
        (record.is_finished() && at.is_finished())
            .then(|| record.published_ns.saturating_sub(at.published_ns))
    }
}

impl Track {
    fn new(service: ServiceId, name: &'static str, schedule: &Schedule) -> Self {
        let inputs = 0..service.inputs().len();
        Self {
            service,
            name,
            is_read: inputs
                .clone()
                .map(|input| schedule.reads(service, input))
                .collect(),
            edges: inputs.map(|input| schedule.edge(service, input)).collect(),
            tick_ns: schedule.tick_ns(),
            reader: StepReader::new(service),
            recent: vec![None; usize::try_from(HISTORY).expect("a few thousand")],
            missed: 0,
            repeated: 0,
            late_inputs: 0,
            stale_inputs: 0,
            timing: Timing::new(),
            window: Timing::new(),
            last_window: Timing::new(),
            last: None,
        }
    }

    fn keep(&mut self, record: StepRecord) {
        self.missed += record.missed;
        let is_repeated = self
            .last
            .is_some_and(|last| last.is_finished() && last.tick >= record.tick);
        self.repeated += u64::from(is_repeated);
        self.late_inputs += u64::from(record.late_inputs.count_ones());
        for (input, edge) in self.edges.iter().enumerate() {
            let is_stale = edge.due_sample(record.tick) != record.consumed_tick(input);
            self.stale_inputs += u64::from(is_stale);
        }
        if record.is_finished() {
            let duration = record.published_ns.saturating_sub(record.began_ns);
            for timing in [&mut self.timing, &mut self.window] {
                timing.steps += 1;
                timing.duration.saturating_record(duration);
            }
        }
        self.last = Some(record);
        self.recent[slot_of(record.tick)] = Some(record);
    }

    fn at(&self, tick: u64) -> Option<&StepRecord> {
        self.recent[slot_of(tick)]
            .as_ref()
            .filter(|record| record.tick == tick)
    }

    fn snapshot(&self) -> ServiceSnapshot {
        let age = |input| {
            let last = self.last.as_ref()?;
            let ticks = last.tick.saturating_sub(last.consumed_tick(input)?);
            Some(seconds(ticks * self.tick_ns))
        };
        let input = |(input, edge): (usize, &Edge)| {
            self.is_read[input].then(|| InputSnapshot {
                topic: edge.topic.name().to_owned(),
                age: age(input),
            })
        };
        ServiceSnapshot {
            name: self.name.to_owned(),
            rate: self.last_window.steps,
            wake: Quantiles::of(&self.last_window.wake),
            step: Quantiles::of(&self.last_window.duration),
            missed_steps: self.missed,
            late_inputs: self.late_inputs,
            inputs: self.edges.iter().enumerate().filter_map(input).collect(),
            ..ServiceSnapshot::default()
        }
    }

    fn report(&self) -> ServiceTiming {
        ServiceTiming {
            service: self.name,
            steps: self.timing.steps,
            missed_steps: self.missed,
            late_inputs: self.late_inputs,
            stale_inputs: self.stale_inputs,
            records_overwritten: self.reader.overwritten(),
            wake: Distribution::of(&self.timing.wake),
            step: Distribution::of(&self.timing.duration),
        }
    }
}

fn slot_of(tick: u64) -> usize {
    usize::try_from(tick % HISTORY).expect("below the depth")
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::schedule::MAX_PORTS;

    const TICK_NS: u64 = 1_000_000;

    /// A step of the ideal profile that sees what is due, `hop` ns after the one before it in the ring.
    fn step(schedule: &Schedule, service: ServiceId, tick: u64, hop: u64) -> StepRecord {
        let place = schedule
            .order()
            .iter()
            .position(|&other| other == service)
            .unwrap() as u64;
        let mut record = StepRecord {
            tick,
            began_ns: tick * TICK_NS + 2 * place * hop,
            published_ns: tick * TICK_NS + (2 * place + 1) * hop,
            ..StepRecord::default()
        };
        for input in 0..service.inputs().len() {
            let due = schedule.edge(service, input).due_sample(tick);
            record.consumed[input] = due.map_or(0, |due| due + 1);
        }
        record
    }

    fn flown(ticks: u64, change: impl Fn(ServiceId, &mut StepRecord)) -> TimingReport {
        let schedule = Schedule::ideal(TICK_NS, 1000);
        let log = StepLog::create().unwrap();
        let mut monitor = Monitor::new(&schedule, ServiceId::name);
        for tick in 0..ticks {
            for service in ServiceId::ALL {
                let mut record = step(&schedule, service, tick, 10_000);
                change(service, &mut record);
                log.begin(service, record);
                log.finish(service, record.published_ns);
            }
            monitor.collect(&log, |_, _, _| {});
        }
        monitor.finish()
    }

    #[test]
    fn hops_steps_and_the_whole_chain_are_measured() {
        let report = flown(100, |_, _| {});
        for timing in &report.services {
            assert_eq!(
                (timing.steps, timing.missed_steps, timing.late_inputs),
                (100, 0, 0)
            );
            assert_eq!(timing.stale_inputs, 0, "{}", timing.service);
            let step = timing.step.as_ref().unwrap();
            assert!((step.quantiles.p50 / 10e-6 - 1.0).abs() < 0.01, "{step:?}");
        }
        let chain = report.capture_to_frame.unwrap();
        // Four hops and four steps after the capture is published.
        assert_eq!(chain.quantiles.count, 100);
        assert!((chain.quantiles.p50 / 80e-6 - 1.0).abs() < 0.01, "{chain:?}");
    }

    #[test]
    fn an_input_that_is_not_connected_has_no_age() {
        let mut unread = [[false; MAX_PORTS]; ServiceId::ALL.len()];
        let inputs = ServiceId::Estimator.inputs();
        for (unread, input) in unread[ServiceId::Estimator.index()].iter_mut().zip(inputs) {
            *unread = input.topic != Topic::MocapPose;
        }
        let schedule = Schedule::ideal(TICK_NS, 1000).with_unread_inputs(unread);
        let snapshots = Monitor::new(&schedule, ServiceId::name).services();
        let topics: Vec<_> = snapshots[ServiceId::Estimator.index()]
            .inputs
            .iter()
            .map(|input| input.topic.as_str())
            .collect();
        assert_eq!(topics, [Topic::MocapPose.name()]);
    }

    #[test]
    fn what_is_missed_late_or_stale_is_counted() {
        let report = flown(100, |service, record| {
            if service == ServiceId::Controller && record.tick == 50 {
                record.missed = 3;
                record.late_inputs = 0b10;
                record.consumed[1] = 47;
            }
        });
        let controller = &report.services[ServiceId::Controller.index()];
        assert_eq!(
            (
                controller.missed_steps,
                controller.late_inputs,
                controller.stale_inputs
            ),
            (3, 1, 1)
        );
        assert_eq!(controller.wake.as_ref().unwrap().quantiles.count, 99);
    }
}
