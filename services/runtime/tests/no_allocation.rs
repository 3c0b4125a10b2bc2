//! A tick of a service in real time allocates nothing: sleeping, receiving, stepping, publishing, waking, writing the
//! checkpoint and the step record. One exception lies outside of this code: iceoryx2 0.10 makes the handle of every
//! loaned sample on the heap.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

#[path = "../../../tests/common/allocations.rs"]
mod allocations;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use runtime::checkpoints::Checkpoints;
use runtime::control::{Channel, Host, Start};
use runtime::crash::CrashPoint;
use runtime::deployment::Scheduler;
use runtime::doorbell::Doorbell;
use runtime::flight_clock::{FlightClock, monotonic_ns};
use runtime::orchestrator_watchdog::OrchestratorWatchdog;
use runtime::ports::{Delivery, RunNode, Topics};
use runtime::real_time::{RealTimePorts, ServiceContext, fly};
use runtime::shared_page::SharedPage;
use runtime::step_log::{StepLog, StepReader};
use runtime::take_over::{FILES, HandOver, Hello};
use runtime::tuning::TuningReader;
use scenario::{Curve, Hover, Path, Scenario, Vehicle};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Gains, Now, Schedule, ServiceId};
use std::os::fd::AsFd;

/// Plant that publishes zeros and counts how often its gains change.
#[derive(Default)]
struct Still {
    tuned: u64,
}

impl ErasedService for Still {
    fn id(&self) -> ServiceId {
        ServiceId::Plant
    }

    fn step(&mut self, _now: &Now, _inputs: &[InputView<'_>], _outputs: &mut [OutputSlot<'_>]) {}

    fn tune(&mut self, gains: Option<&Gains>) {
        self.tuned += u64::from(gains.is_some());
    }

    fn state_size(&self) -> usize {
        8
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        keep(&[1; 8]);
    }

    fn restore(&mut self, _bytes: &[u8]) {}
}

/// Hand-over that no orchestrator takes here.
fn hand_over(scenario: &Scenario) -> HandOver {
    let hello = Hello {
        service: ServiceId::Plant,
        start: Start {
            scenario: scenario.clone(),
            iceoryx2_configuration: "nowhere/iceoryx2.toml".into(),
            core: None,
            scheduler: Scheduler::Fair,
            role: None,
            host: Host::RealTime,
        },
    };
    let file = std::io::stdin();
    HandOver::new(hello.start.place(), &hello, [file.as_fd(); FILES]).unwrap()
}

/// Changes of gains in each flight, one a tick from the first on.
const CHANGES: u64 = 4;

/// Returns the allocations of a flight of so many ticks of a millisecond, and the steps that it recorded.
fn allocations_of(node: &RunNode, ticks: u64) -> (u64, usize) {
    let schedule = Schedule::ideal(1_000_000, ticks - 1);
    let topics = Topics::open(node, ServiceId::Plant, &schedule).unwrap();
    let page = Arc::new(SharedPage::create().unwrap());
    let ports = RealTimePorts::open(&topics, ServiceId::Plant, &schedule, Default::default(), &page).unwrap();
    page.control_block()
        .orchestrator_alive_ns
        .store(monotonic_ns(), Ordering::Relaxed);
    for change in 1..=CHANGES {
        page.control_block().tuning.change(change, &Gains::default());
    }
    let (_orchestrator, line) = Channel::pair().unwrap();
    let hover = Curve::Hover(Hover {
        position: [0.0, 0.0, -1.0],
    });
    let scenario = Scenario::new(1.0, Vehicle::new(0.2, [1e-3; 3]), Path::new(hover));
    let step_log = StepLog::create().unwrap();
    let mut context = ServiceContext {
        ports,
        page,
        doorbells: ServiceId::ALL.map(|_| Doorbell::create().unwrap()).into(),
        external_services: scenario.external_services(),
        checkpoints: &Checkpoints::create().unwrap(),
        step_log: &step_log,
        clock: FlightClock::starting_in(Duration::from_millis(2), schedule.tick_ns()),
        grace_ns: 0,
        orchestrator_watchdog: OrchestratorWatchdog::new(
            &scenario,
            Channel::inherited(line),
            hand_over(&scenario),
        ),
        tuning: TuningReader::default(),
        crash: CrashPoint::default(),
    };
    let mut flown = Ok(());
    let mut service = Still::default();
    let count = allocations::allocations_during(|| flown = fly(&mut service, &schedule, None, &mut context));
    flown.unwrap();
    assert!(
        (1..=CHANGES).contains(&service.tuned),
        "{} changes of gains",
        service.tuned
    );
    let mut reader = StepReader::new(ServiceId::Plant);
    let steps = std::iter::from_fn(|| reader.next(&step_log)).count();
    (count, steps)
}

#[test]
fn a_hundred_more_ticks_allocate_no_more_than_the_handles_of_their_samples() {
    let folder = tempfile::tempdir().unwrap();
    let configuration = folder.path().join("iceoryx2.toml");
    let prefix = format!("gerono_allocations_{}_", std::process::id());
    let root = folder.path().join("root");
    let text = format!("[global]\nroot-path = {root:?}\nprefix = {prefix:?}\n");
    std::fs::write(&configuration, text).unwrap();
    let node = RunNode::join(&configuration, "allocations").unwrap();
    let schedule = Schedule::ideal(1_000_000, 0);
    let outputs = schedule.outputs(ServiceId::Plant).map(|output| output.topic);
    let inputs = ServiceId::Plant.inputs().iter().map(|input| input.topic);
    let topics: Vec<_> = outputs
        .chain(inputs)
        .map(|topic| node.create_topic(topic, &schedule, Delivery::NewestWins).unwrap())
        .collect();

    // One-time allocations happen here.
    allocations_of(&node, 5);
    let (few, few_steps) = allocations_of(&node, 20);
    let (many, many_steps) = allocations_of(&node, 120);
    drop((topics, node));
    sweep(&prefix);
    assert_eq!((few_steps, many_steps), (20, 120));
    let handles = 100 * schedule.outputs(ServiceId::Plant).count() as u64;
    assert_eq!(many - few, handles);
}

/// Removes the one file of a run that iceoryx2 leaves in shared memory.
fn sweep(prefix: &str) {
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        if entry.file_name().to_string_lossy().starts_with(prefix) {
            std::fs::remove_file(entry.path()).unwrap();
        }
    }
}
