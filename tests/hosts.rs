//! Promises of the step logic that only all services together can show.

#[path = "../tests/common/allocations.rs"]
mod allocations;
mod common;

use std::convert::Infallible;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use common::laboratory::serial_line;
use common::ports::free_port;
use flight::interrupt::Interrupt;
use motion_capture::conventions::{Calibration, WorldPose};
use motion_capture::natnet::Version;
use motion_capture::protocol::{self, Plan, SentFrame};
use motion_capture::server::Server;
use nalgebra::Vector3;
use run_log::{CaptureFigures, LinkFigures};
use shared_types::digest::ExperimentDigest;
use shared_types::rotation::exp;

use flight::{Outcome, in_process};
use host::in_process::{InProcess, TickSink};
use host::step::Timetable;
use proptest::prelude::*;
use runtime::flight_clock::monotonic_ns;
use runtime::input_queue::InputQueue;
use runtime::ports::{PortError, Receiver};
use runtime::shared_page::SharedPage;
use runtime::step_log::{StepLog, StepRecord};
use scenario::{CaptureSystem, Scenario};
use serde_json::{Value, from_value, to_value};
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Now, Schedule, ServiceId, Topic};
use zerocopy::{FromBytes, FromZeros, IntoBytes};

fn host(scenario: &Scenario) -> InProcess {
    InProcess::new(
        scenario.schedule().unwrap(),
        registry::build_all(scenario).unwrap(),
    )
}

fn short_fig1() -> Scenario {
    let sets = [
        "duration=2.0".to_owned(),
        "vehicle.change=[{at = 1.0, mass = 0.245}]".to_owned(),
    ];
    scenario_file::load(&common::scenario("fig1"), &sets, None).unwrap()
}

fn short_rig() -> Scenario {
    let mut sets = vec!["duration=1.0".to_owned()];
    sets.extend(common::ALL_OF_THE_RIG.map(str::to_owned));
    scenario_file::load(&common::scenario("fig3_6"), &sets, None).unwrap()
}

/// Policies that go through all stages and back while services are lost.
fn short_losses() -> Scenario {
    let sets = [
        "duration=2.0",
        "safety.\"vehicle/state -> controller\"={max_age=0.05, level=0.1, descend=0.2, failsafe=0.4, jump=0.2}",
        "safety.\"control/command -> rc_output\"={max_age=0.044, failsafe=0.1}",
        "fault=[{at=0.5, service=\"estimator\", kind=\"off\", for=0.6}, \
         {at=1.3, service=\"path_generator\", kind=\"off\", for=0.6}, \
         {at=1.4, service=\"controller\", kind=\"off\", for=0.2}, \
         {at=1.7, service=\"estimator\", kind=\"off\", state=\"cold\", for=0.1}]",
    ];
    let sets = sets.map(str::to_owned);
    scenario_file::load(&common::scenario("fault_isolation"), &sets, None).unwrap()
}

/// Digests what is published and stops after every tick.
#[derive(Default)]
struct Stopping(ExperimentDigest);

impl TickSink for Stopping {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.0.update(topic, bytes);
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Break(()))
    }
}

/// Flies tick by tick, doing something between ticks, to the digest of what was published.
fn digest(scenario: &Scenario, mut between: impl FnMut(&mut InProcess)) -> String {
    let mut host = host(scenario);
    let mut sink = Stopping::default();
    for _ in 0..=host.schedule().last_tick() {
        host.fly(&mut sink).unwrap();
        between(&mut host);
    }
    sink.0.finish()
}

/// A service keeps nothing beside what it saves: made again after every tick, all fly on with the same bytes.
#[test]
fn services_have_no_hidden_state() {
    for scenario in [short_fig1(), short_rig(), short_losses()] {
        let undisturbed = digest(&scenario, |_| {});
        let restarted = digest(&scenario, |host| {
            for service in ServiceId::ALL {
                let mut state = vec![0; host.service_mut(service).state_size()];
                host.service_mut(service).save(&mut state);
                // Its state now is that of a cold start.
                host.replace(registry::build(service, &scenario).unwrap());
                host.service_mut(service).restore(&state);
            }
        });
        assert_eq!(undisturbed, restarted);
    }
}

/// A flight with phases and an envelope.
fn short_take_off() -> Scenario {
    let sets = [
        "duration=5.0",
        "flight={arm_at = 0.3, land_at = 3.0, spool_up = 0.1, takeoff_height = 0.4, takeoff_speed = 2.0, \
         transition_time = 0.5, landing_speed = 0.8}",
        "path.curve={hover = {position = [0.3, 0.2, -0.6]}}",
    ];
    let sets = sets.map(str::to_owned);
    scenario_file::load(&common::scenario("takeoff_and_land"), &sets, None).unwrap()
}

/// A laboratory's scenario, as it is tried without a laboratory.
fn short_laboratory() -> Scenario {
    let sets = [
        "duration=4.0",
        "motion_capture.source=simulated",
        "flight.arm_at=0.5",
        "vehicle.fan.on_at=3.0",
    ];
    let sets = sets.map(str::to_owned);
    scenario_file::load(&common::scenario("laboratory"), &sets, None).unwrap()
}

/// Makes other numbers of all that are in a section, and turns all that is true or false.
fn falsify(section: &mut Value, draws: &mut impl Iterator<Item = f64>) {
    match section {
        Value::Number(_) => *section = draws.next().expect("draws never end").into(),
        Value::Bool(is_so) => *is_so = !*is_so,
        Value::Array(elements) => elements.iter_mut().for_each(|element| falsify(element, draws)),
        Value::Object(members) => members.values_mut().for_each(|member| falsify(member, draws)),
        Value::Null | Value::String(_) => {}
    }
}

/// The scenario with another vehicle, other air, other cameras and another seed: everything that is true of the world.
fn falsified(truth: &Scenario, numbers: &[f64], seed: u64) -> Scenario {
    let mut draws = numbers.iter().copied().cycle();
    let mut lie = truth.clone();
    lie.seed = seed;
    // Zeros are not written, and could not be falsified.
    (lie.vehicle.drag, lie.vehicle.center_of_mass) = ([1.0; 3], [1.0; 3]);
    lie.vehicle.actuators.get_or_insert_default();
    lie.cameras.get_or_insert_default();
    let mut falsify = |section: Value| {
        let mut section = section;
        falsify(&mut section, &mut draws);
        section
    };
    lie.vehicle = from_value(falsify(to_value(&lie.vehicle).unwrap())).unwrap();
    lie.cameras = from_value(falsify(to_value(&lie.cameras).unwrap())).unwrap();
    lie
}

/// Digest of a flight of which the plant is that of one scenario and all other services are of another.
fn digest_of(plant: &Scenario, others: &Scenario) -> String {
    let services = ServiceId::ALL.map(|service| {
        let scenario = if service == ServiceId::Plant {
            plant
        } else {
            others
        };
        registry::build(service, scenario).unwrap()
    });
    let host = InProcess::new(plant.schedule().unwrap(), services.into());
    let (digest, _, ending) = flown_until(host, u64::MAX);
    if ending == "Ok(())" {
        digest
    } else {
        "ended early".to_owned()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(12) })]

    /// Estimator, path generator, controller and radio link know nothing of the world but what its samples tell them: with
    /// torque, with body rates, with phases and an envelope, and with the scenario of a laboratory.
    #[test]
    fn no_service_but_the_plant_knows_what_is_true_of_vehicle_cameras_and_seed(
        hundredths in proptest::collection::vec(2..700i32, 12..60), seed in 2u64..1_000_000,
    ) {
        // Times among them are whole ticks.
        let numbers: Vec<_> = hundredths.into_iter().map(|number| f64::from(number) / 100.0).collect();
        for truth in [short_fig1(), short_rig(), short_losses(), short_take_off(), short_laboratory()] {
            let lie = falsified(&truth, &numbers, seed);
            prop_assert_eq!(digest_of(&truth, &truth), digest_of(&truth, &lie), "{}", truth.description);
            prop_assert_ne!(digest_of(&truth, &truth), digest_of(&lie, &truth), "{}: nothing was falsified", truth.description);
        }
    }
}

/// Digests what is published up to a tick, and counts the ticks.
struct Until {
    digest: ExperimentDigest,
    ticks: Vec<u64>,
    last: u64,
}

impl TickSink for Until {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.digest.update(topic, bytes);
        Ok(())
    }

    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, Infallible> {
        self.ticks.push(tick);
        Ok(if tick == self.last {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        })
    }
}

/// The digest of a flight up to a tick, its ticks, and what it ended with.
fn flown_until(mut host: InProcess, last: u64) -> (String, Vec<u64>, String) {
    let mut sink = Until {
        digest: ExperimentDigest::default(),
        ticks: Vec::new(),
        last,
    };
    let ending = host.fly(&mut sink);
    assert_eq!(host.next_tick(), sink.ticks.len() as u64);
    (sink.digest.finish(), sink.ticks, format!("{ending:?}"))
}

/// At one rate and at several, with planned faults and without, ended within a batch and at its end.
#[test]
fn a_flight_in_batches_is_the_flight_tick_by_tick() {
    for scenario in [short_fig1(), short_rig(), short_losses()] {
        for last in [799, 802, u64::MAX] {
            let [one_by_one, in_batches] = [host(&scenario), host(&scenario).in_batches()];
            assert_eq!(flown_until(one_by_one, last), flown_until(in_batches, last));
        }
    }
}

/// The estimator of the inertia runs away.
#[test]
fn a_number_that_is_not_finite_ends_a_flight_in_batches_at_its_tick() {
    let sets = [
        "duration=5.0",
        "vehicle.change=[]",
        "controller.lambda_inertia=1e9",
    ]
    .map(str::to_owned);
    let scenario = scenario_file::load(&common::scenario("fig1"), &sets, None).unwrap();
    let [one_by_one, in_batches] = [host(&scenario), host(&scenario).in_batches()];
    let flown = flown_until(one_by_one, u64::MAX);
    assert!(flown.2.contains("NonFinite"), "{flown:?}");
    assert_eq!(flown, flown_until(in_batches, u64::MAX));
}

struct Nowhere;

impl TickSink for Nowhere {
    type Error = Infallible;

    fn sample(&mut self, _topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        std::hint::black_box(bytes);
        Ok(())
    }
}

#[test]
fn a_flight_allocates_nothing_in_any_step() {
    for scenario in [short_fig1(), short_rig()] {
        for mut host in [host(&scenario), host(&scenario).in_batches()] {
            let count = allocations::allocations_during(|| host.fly(&mut Nowhere).unwrap());
            assert_eq!(count, 0);
        }
    }
}

/// A motion-capture system that sees a vehicle which moves a little, because what does not is frozen.
struct CaptureServer {
    server: Server,
    calibration: Calibration,
    number: u32,
}

impl CaptureServer {
    fn open(system: CaptureSystem, port: u16) -> Self {
        let at = |port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
        let has_one_port = protocol::for_system(system).frame_port(port) == port;
        let data_port = if has_one_port { port } else { free_port() };
        let plan = Plan {
            system,
            at: at(port),
            to: at(data_port),
            version: Version { major: 4, minor: 1 },
        };
        Self {
            server: Server::open(&plan).unwrap(),
            calibration: Calibration::new(system, None, None),
            number: 0,
        }
    }

    fn send(&mut self) {
        self.number += 1;
        let pose = WorldPose {
            position_world: Vector3::new(0.0, 0.0, -1e-9 * f64::from(self.number)),
            world_from_body: exp(&Vector3::new(1e-7 * f64::from(self.number), 0.0, 0.0)),
        };
        self.server.serve(&["quad"]);
        let now_ns = monotonic_ns();
        let bodies = [("quad", Some(self.calibration.capture_pose(&pose)))];
        let frame = SentFrame {
            number: self.number,
            exposed_ns: now_ns,
            computed_ns: now_ns,
            sent_ns: now_ns,
        };
        self.server.send(&frame, &bodies);
    }
}

fn laboratory_of(system: &str, port: u16, device: &str) -> Scenario {
    let sets = [
        format!(
            "motion_capture={{source = \"{system}\", server = \"127.0.0.1\", port = {port}, object = \"quad\", rate = [20.0, 500.0]}}"
        ),
        format!("rc_output.transmitter={{device = \"{device}\", arming_channel = 5}}"),
        // Cameras are believed by their time, and ticks without a clock come as fast as the machine makes them.
        "duration=3600.0".to_owned(),
    ];
    scenario_file::load(&common::scenario("laboratory"), &sets, None).unwrap()
}

/// Neither do those of the services that cameras and a radio are connected to, once they are.
#[test]
fn a_step_in_a_laboratory_allocates_nothing() {
    for system in CaptureSystem::ALL {
        let name = system.name();
        let port = free_port();
        let (_line, device) = serial_line();
        let scenario = laboratory_of(name, port, &device);
        let mut cameras = CaptureServer::open(system, port);
        let page = Arc::new(SharedPage::create().unwrap());
        let mut host = host(&scenario);
        for service in [ServiceId::Plant, ServiceId::RcOutput] {
            let plain = registry::build(service, &scenario).unwrap();
            host.replace(registry::connect(plain, &scenario, &page).unwrap());
        }
        page.control_block()
            .start_ns
            .store(monotonic_ns(), Ordering::Release);
        let mut allocations = 0;
        let mut figures = CaptureFigures::new_zeroed();
        for _ in 0..=host.schedule().last_tick() {
            cameras.send();
            let count = allocations::allocations_during(|| host.fly(&mut Stopping::default()).unwrap());
            if figures.believed > 0 {
                allocations += count;
            }
            figures = page.control_block().cameras_status.read();
            if figures.believed > 1000 {
                break;
            }
        }
        assert!(figures.believed > 1000, "{name}: {figures:?}");
        assert_eq!(allocations, 0, "{name}");
        let link: LinkFigures = page.control_block().link_status.read();
        assert!(link.sent > 0);
    }
}

/// Law of a caller's that asks for the largest thrust there is.
struct Absurd;

impl ErasedService for Absurd {
    fn id(&self) -> ServiceId {
        ServiceId::Controller
    }

    fn step(&mut self, _now: &Now, _inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        if let Some(bytes) = outputs[0].bytes.as_deref_mut() {
            let command = ControlCommand::mut_from_bytes(bytes).unwrap();
            (command.thrust, command.mode) = (f64::MAX, ControlCommand::MODE_TORQUE);
        }
    }

    fn state_size(&self) -> usize {
        0
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        keep(&[]);
    }

    fn restore(&mut self, _bytes: &[u8]) {}
}

/// Its command is finite, and the plant's numbers are not after it.
#[test]
fn a_number_that_is_not_finite_names_the_law_of_others_beside_the_service_that_computed_it() {
    let law = Some(Box::new(Absurd) as Box<dyn ErasedService>);
    let flown = in_process::fly_with(&short_fig1(), law, &mut Nowhere, &Interrupt::never());
    let Outcome::Failed(failure) = flown.unwrap().outcome else {
        panic!("it has flown");
    };
    assert!(failure.not_finite_at().is_some());
    let said = failure.to_string();
    assert!(
        said.contains("`plant` computed") && said.contains("in place of `controller`"),
        "{said}"
    );
}

/// Port of which nothing has come yet.
struct NoPort;

impl Receiver for NoPort {
    fn receive(&mut self) -> Result<bool, PortError> {
        Ok(false)
    }

    fn held(&self) -> Option<&[u8]> {
        None
    }

    fn id(&self) -> u128 {
        0
    }

    fn connect(&mut self) -> Result<(), PortError> {
        Ok(())
    }
}

/// The number of the estimator's input of frames.
fn input_of_frames() -> usize {
    let inputs = ServiceId::Estimator.inputs().iter();
    let mut topics = inputs.map(|input| input.topic);
    topics.position(|topic| topic == Topic::RcFrame).unwrap()
}

/// At its step at tick 10 the frame of tick 9 was due, had not come, and that of tick 8 was seen again.
#[test]
fn a_frame_that_came_too_late_for_the_last_step_of_an_estimator_is_given_to_the_next_one() {
    let (schedule, log) = (Schedule::ideal(1_000_000, 1000), StepLog::create().unwrap());
    let (estimator, frames) = (ServiceId::Estimator, input_of_frames());
    let edge = schedule.edge(estimator, frames);
    assert_eq!(edge.due_sample(10), Some(9));
    // The step at tick 11 is in the log and in no checkpoint: the process died in between.
    for (tick, seen) in [(9, 8), (10, 8), (11, 10)] {
        let mut record = StepRecord {
            tick,
            ..StepRecord::default()
        };
        record.consumed[frames] = 1 + seen;
        log.begin(estimator, record);
        log.finish(estimator, 1);
    }
    let last = log.last_before(estimator, 11).unwrap();
    assert_eq!(last.tick, 10);
    let timetable = Timetable::new(&schedule, estimator);
    let first = timetable.first_needed(&edge, 11, last.consumed_tick(frames));
    assert_eq!(first, Some(9));
    assert_eq!(log.last_before(estimator, 9), None);
}

/// Frames at 1 kHz that were sent while an estimator was dead: each of its late steps sees its own.
#[test]
fn a_restarted_estimator_takes_in_every_frame_of_a_gap_of_seven_tenths_of_a_second() {
    const GAP: u64 = 700;
    let schedule = Schedule::ideal(1_000_000, 10_000);
    let port = Box::new(NoPort);
    let mut queue = InputQueue::new(
        &schedule,
        ServiceId::Estimator,
        input_of_frames(),
        ServiceId::RcOutput,
        port,
    );
    let frames: Vec<RcFrame> = (1..=GAP)
        .map(|tick| RcFrame {
            header: schedule.header(Topic::RcFrame, tick),
            ..RcFrame::new_zeroed()
        })
        .collect();
    // In messages of 16, as they are given.
    for some in frames.chunks(16) {
        queue.take_missed(some.as_bytes());
    }
    for tick in 2..=GAP + 1 {
        let delivery = queue.deliver(tick).unwrap();
        assert_eq!((delivery.tick, delivery.view.fresh), (tick - 1, true));
    }
}
