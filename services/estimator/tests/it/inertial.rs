//! Inertial navigation as hosts see it: alignment, validation, restarts, jumps.

use estimator::InertialEstimatorService;
use scenario::Scenario;
use sensor_models::{
    Barometer, BarometerParameters, Gnss, GnssParameters, Imu, ImuParameters, Magnetometer,
    MagnetometerParameters, TrueMotion, barometer::Surroundings,
};
use shared_types::Now;
use shared_types::geodesy::LocalFrame;
use shared_types::gnss::FixKind;
use shared_types::noise::{Noise, Stream};
use shared_types::rotation::{exp, to_row_major};
use shared_types::samples::{
    BaroAltitude, BaselineInnovations, GnssBaseline, GnssFix, ImuSample, MagField, MocapPose,
    NavigationInnovations, PoseInnovations, RcFrame, VehicleState,
};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

use crate::allocations;

/// Length of a step, ns.
const STEP_NS: u64 = 4_000_000;
/// Latency of a fix, steps.
const FIX_LATE: u64 = 25;

/// Place of the second antenna from the first in {B}, m.
const BASELINE: [f64; 3] = [0.0, 1.0, 0.0];

const OUTDOORS: &str = "duration = 100.0\n\
    vehicle = { mass = 0.5, inertia = [2e-3, 2e-3, 4e-3] }\n\
    path.curve.hover.position = [0.0, 0.0, -1.0]\n\
    flight = { position_sigma_max = 0.05 }\n\
    sensors = {}\n\
    navigation = {}\n\
    datum.azimuth = 0.7\n\
    [schedule]\n\
    tick = 0.004";

fn scenario() -> Scenario {
    toml::from_str(OUTDOORS).unwrap()
}

fn service() -> InertialEstimatorService {
    InertialEstimatorService::new(&scenario()).unwrap()
}

/// The same with cameras.
fn seen() -> InertialEstimatorService {
    let mut scenario = scenario();
    scenario.navigation.as_mut().unwrap().poses = Some(scenario::Poses::default());
    InertialEstimatorService::new(&scenario).unwrap()
}

/// The same with two antennas.
fn with_two_antennas() -> InertialEstimatorService {
    let mut scenario = scenario();
    scenario.navigation.as_mut().unwrap().baseline = Some(BASELINE);
    InertialEstimatorService::new(&scenario).unwrap()
}

/// Samples of a vehicle at rest at a step, with their errors.
struct World {
    imu: Imu,
    gnss: Gnss,
    barometer: Barometer,
    magnetometer: Magnetometer,
    frame: LocalFrame,
    /// Added to the positions of fixes in {I}, m.
    shift: [f64; 3],
    kind: FixKind,
    /// `true` while no fix arrives.
    is_silent: bool,
    /// `true` while no pose arrives.
    is_hidden: bool,
    poses: Noise,
    /// Step from which on the motors could carry the vehicle.
    motors_from: u64,
    /// N.
    weight: f64,
    /// Fixes that are under way.
    late: Vec<(u64, GnssFix)>,
}

/// Samples that arrive at a step.
#[derive(Clone, Copy, Default)]
struct Arrived {
    imu: Option<ImuSample>,
    fix: Option<GnssFix>,
    altitude: Option<BaroAltitude>,
    field: Option<MagField>,
    frame: Option<RcFrame>,
    pose: Option<MocapPose>,
    baseline: Option<GnssBaseline>,
}

impl World {
    fn new(seed: u64) -> Self {
        let datum = scenario().datum_or_default();
        let magnetometer = MagnetometerParameters {
            field_world: datum.field_world().into(),
            ..MagnetometerParameters::default()
        };
        let gnss = GnssParameters {
            latency: [0.0; 2],
            baseline_body: Some(BASELINE.into()),
            ..GnssParameters::default()
        };
        Self {
            imu: Imu::new(&ImuParameters::default(), seed, 0.004),
            gnss: Gnss::new(&gnss, seed, 0.1),
            barometer: Barometer::new(&BarometerParameters::default(), seed, 0.04),
            magnetometer: Magnetometer::new(&magnetometer, seed),
            frame: datum.frame(),
            shift: [0.0; 3],
            kind: FixKind::RtkFixed,
            is_silent: false,
            is_hidden: false,
            poses: Noise::new(seed, Stream::CameraNoise),
            motors_from: u64::MAX,
            weight: scenario().model.unwrap_or_default().mass * scenario::GRAVITY,
            late: Vec::new(),
        }
    }

    fn step(&mut self, step: u64) -> Arrived {
        let motion = TrueMotion::AT_REST;
        let time_ns = step * STEP_NS;
        let mut arrived = Arrived::default();
        let measured = self.imu.sample(step, &motion, 0.0);
        arrived.imu = Some(ImuSample {
            measured_ns: time_ns,
            angular_velocity_body: measured.angular_velocity_body.into(),
            specific_force_body: measured.specific_force_body.into(),
            measured: true.into(),
            ..ImuSample::new_zeroed()
        });
        if step.is_multiple_of(25) {
            let fix = self.gnss.sample(step, &motion, self.kind);
            let place = self
                .frame
                .to_geodetic(&(fix.position_world + nalgebra::Vector3::from(self.shift)));
            let sample = GnssFix {
                valid_ns: time_ns,
                latitude: place.latitude,
                longitude: place.longitude,
                height: place.height,
                velocity_ned: self.frame.world_from_ned().tr_mul(&fix.velocity_world).into(),
                horizontal_accuracy: fix.horizontal_accuracy,
                vertical_accuracy: fix.vertical_accuracy,
                speed_accuracy: fix.speed_accuracy,
                kind: self.kind as u8,
                measured: true.into(),
                ..GnssFix::new_zeroed()
            };
            self.late.push((step + FIX_LATE, sample));
            if let Some(baseline) = self.gnss.baseline(step, &motion, self.kind) {
                arrived.baseline = Some(GnssBaseline {
                    valid_ns: time_ns,
                    baseline_ned: self
                        .frame
                        .world_from_ned()
                        .tr_mul(&baseline.baseline_world)
                        .into(),
                    accuracies_ned: baseline.accuracies.into(),
                    fixed: baseline.is_fixed.into(),
                    measured: true.into(),
                    ..GnssBaseline::new_zeroed()
                });
            }
        }
        if self.late.first().is_some_and(|(at, _)| *at <= step) {
            let (_, fix) = self.late.remove(0);
            arrived.fix = Some(fix).filter(|_| !self.is_silent);
        }
        if step.is_multiple_of(10) {
            let surroundings = Surroundings {
                altitude: 0.0,
                above_ground: 0.0,
                airspeed: 0.0,
                rotors_turn: false,
            };
            arrived.altitude = Some(BaroAltitude {
                measured_ns: time_ns,
                altitude: self.barometer.sample(step, &surroundings),
                measured: true.into(),
                ..BaroAltitude::new_zeroed()
            });
        }
        if step.is_multiple_of(5) {
            let field = self.magnetometer.sample(step, &motion.world_from_body, 0.0);
            arrived.field = Some(MagField {
                measured_ns: time_ns,
                field_body: field.into(),
                measured: true.into(),
                ..MagField::new_zeroed()
            });
        }
        if step.is_multiple_of(3) && step > 1 && !self.is_hidden {
            let mut draws = self.poses.at(step);
            let mut pose = MocapPose::new_zeroed();
            pose.capture_time_ns = time_ns - 2 * STEP_NS;
            pose.position_world = (draws.normal3() * 3e-4).into();
            pose.world_from_body = to_row_major(&exp(&(draws.normal3() * 2e-3)));
            pose.tracked = true.into();
            arrived.pose = Some(pose);
        }
        if step > 0 {
            let mut frame = RcFrame::new_zeroed();
            frame.header.stamp_ns = time_ns - STEP_NS;
            frame.failsafe = (step < self.motors_from).into();
            frame.thrust = if step < self.motors_from { 0.0 } else { self.weight };
            frame.mode = RcFrame::MODE_RATES;
            arrived.frame = Some(frame);
        }
        arrived
    }
}

fn view<T: IntoBytes + zerocopy::Immutable>(sample: &Option<T>) -> InputView<'_> {
    InputView {
        bytes: sample.as_ref().map(IntoBytes::as_bytes),
        fresh: sample.is_some(),
    }
}

fn step(service: &mut InertialEstimatorService, number: u64, arrived: &Arrived) -> VehicleState {
    published(service, number, arrived).0
}

/// Makes a step. Returns all that it publishes.
fn published(
    service: &mut InertialEstimatorService,
    step: u64,
    arrived: &Arrived,
) -> (
    VehicleState,
    NavigationInnovations,
    PoseInnovations,
    BaselineInnovations,
) {
    let now = Now {
        tick: step,
        time_ns: step * STEP_NS,
        elapsed_ns: step.min(1) * STEP_NS,
        operator: shared_types::Operator::FLYING,
    };
    let mut state = VehicleState::new_zeroed();
    let mut innovations = NavigationInnovations::new_zeroed();
    let mut poses = PoseInnovations::new_zeroed();
    let mut baselines = BaselineInnovations::new_zeroed();
    let mut outputs = [
        OutputSlot {
            bytes: Some(state.as_mut_bytes()),
        },
        OutputSlot {
            bytes: Some(innovations.as_mut_bytes()),
        },
        OutputSlot {
            bytes: Some(poses.as_mut_bytes()),
        },
        OutputSlot {
            bytes: Some(baselines.as_mut_bytes()),
        },
    ];
    let inputs = [
        view(&arrived.pose),
        view(&arrived.frame),
        view(&arrived.imu),
        view(&arrived.fix),
        view(&arrived.altitude),
        view(&arrived.field),
        view(&arrived.baseline),
    ];
    ErasedService::step(service, &now, &inputs, &mut outputs);
    (state, innovations, poses, baselines)
}

fn saved(service: &InertialEstimatorService) -> Vec<u8> {
    let mut state = vec![0; service.state_size()];
    ErasedService::save(service, &mut state);
    state
}

#[test]
fn a_vehicle_at_rest_is_tracked_after_ten_seconds_with_fixes_and_not_before() {
    let (mut service, mut world) = (service(), World::new(3));
    let mut tracked_from = None;
    let mut state = VehicleState::new_zeroed();
    for number in 0..5000 {
        state = step(&mut service, number, &world.step(number));
        if state.tracked.is_set() && tracked_from.is_none() {
            tracked_from = Some(number);
        }
    }
    // Aligned after 1 s; the first fix after that is fused when the horizon of 0.12 s reaches it.
    let from = tracked_from.unwrap() as f64 * 0.004;
    assert!((11.0..11.5).contains(&from), "{from}");
    assert!(
        !state.coasting.is_set() && state.captures_refused < 20,
        "{state:?}"
    );
    assert!(state.position_sigma < 0.02, "{}", state.position_sigma);
    assert!(nalgebra::Vector3::from(state.position_world).norm() < 0.03);
    assert!(nalgebra::Vector3::from(state.velocity_body).norm() < 0.01);
    assert!(nalgebra::Vector3::from(state.angular_velocity_body).norm() < 0.01);
}

#[test]
fn times_with_which_the_vehicle_is_never_tracked_are_refused_with_the_key() {
    type Change = fn(&mut Scenario);
    fn time(table: &mut std::collections::BTreeMap<String, f64>, name: &str, seconds: f64) {
        table.insert(name.to_owned(), seconds);
    }
    let changes: [(Change, &str); 9] = [
        (
            |scenario| time(&mut scenario.schedule.latency, "imu/sample -> estimator", 0.1),
            "schedule.latency.\"imu/sample -> estimator\"",
        ),
        (
            |scenario| time(&mut scenario.schedule.period, "gnss/fix", 0.88),
            "schedule.period.\"gnss/fix\"",
        ),
        // In a hall it is the poses that come seldom, and on the field the fixes.
        (
            |scenario| {
                scenario.navigation.as_mut().unwrap().poses = Some(scenario::Poses::default());
                time(&mut scenario.schedule.period, "mocap/pose", 0.88);
            },
            "schedule.period.\"mocap/pose\"",
        ),
        (
            |scenario| scenario.navigation.as_mut().unwrap().coast = 0.1,
            "navigation.coast",
        ),
        (
            |scenario| scenario.model.get_or_insert_default().radio_latency = 0.3,
            "model.radio_latency",
        ),
        (
            |scenario| {
                scenario.navigation.as_mut().unwrap().baseline = Some(BASELINE);
                time(&mut scenario.schedule.period, "gnss/baseline", 0.9);
            },
            "schedule.period.\"gnss/baseline\"",
        ),
        // The field points down in the north.
        (
            |scenario| scenario.datum.as_mut().unwrap().field[2] *= -1.0,
            "datum.field",
        ),
        (|scenario| scenario.datum.as_mut().unwrap().latitude = 20.0, ""),
        (|_| (), ""),
    ];
    for (change, key) in changes {
        let mut scenario = scenario();
        change(&mut scenario);
        let refused = InertialEstimatorService::new(&scenario).err();
        let found = refused.map_or(String::new(), |problem| problem.key.to_string());
        assert_eq!(found, key);
    }
}

#[test]
fn restored_at_any_step_it_continues_with_the_same_bytes() {
    for new in [service, seen, with_two_antennas] {
        let (mut service, mut world) = (new(), World::new(4));
        for number in 0..4000 {
            // A jump of the fixes, which is accepted after 7 s, and cameras that see nothing for a while.
            world.shift[0] = if number > 2200 { 2.0 } else { 0.0 };
            world.is_hidden = (3000..3960).contains(&number);
            let before = saved(&service);
            let arrived = world.step(number);
            let expected = published(&mut service, number, &arrived);
            if number % 61 == 0 || (3950..3990).contains(&number) {
                let mut restarted = new();
                ErasedService::restore(&mut restarted, &before);
                let got = published(&mut restarted, number, &arrived);
                assert_eq!(got.0.as_bytes(), expected.0.as_bytes(), "at step {number}");
                assert_eq!(got.1.as_bytes(), expected.1.as_bytes(), "at step {number}");
                assert_eq!(got.2.as_bytes(), expected.2.as_bytes(), "at step {number}");
                assert_eq!(got.3.as_bytes(), expected.3.as_bytes(), "at step {number}");
                assert_eq!(saved(&restarted), saved(&service), "at step {number}");
            }
        }
    }
}

#[test]
fn a_jump_of_the_estimate_is_no_step_of_the_published_position() {
    let (mut service, mut world) = (service(), World::new(5));
    let mut last: Option<VehicleState> = None;
    let mut largest: f64 = 0.0;
    let mut end = 0.0;
    for number in 0..5600 {
        world.shift[0] = if number > 3000 { 3.0 } else { 0.0 };
        let state = step(&mut service, number, &world.step(number));
        if let Some(last) = last.filter(|last| last.tracked.is_set()) {
            let moved =
                nalgebra::Vector3::from(state.position_world) - nalgebra::Vector3::from(last.position_world);
            largest = largest.max(moved.norm());
        }
        end = state.position_world[0];
        last = Some(state);
    }
    assert!((end - 3.0).abs() < 0.05, "{end}");
    // 3 m at 1 m/s in steps of 4 ms, and small corrections.
    assert!(largest < 0.025, "{largest}");
}

#[test]
fn innovations_are_published_and_those_beyond_the_gate_refused() {
    let (mut service, mut world) = (service(), World::new(11));
    let mut last = NavigationInnovations::new_zeroed();
    for number in 0..3000 {
        let mut arrived = world.step(number);
        if let Some(altitude) = arrived.altitude.as_mut().filter(|_| number >= 2500) {
            altitude.altitude += 5.0;
        }
        let (_, now, ..) = published(&mut service, number, &arrived);
        assert_eq!(now.unusable, [0; 6]);
        for source in 0..6 {
            let [fused, refused] = [(now.fused, last.fused), (now.refused, last.refused)]
                .map(|(now, last): ([u32; 6], [u32; 6])| now[source] - last[source]);
            assert_eq!(now.valid_ns[source] > last.valid_ns[source], fused + refused > 0);
            if fused + refused > 0 {
                assert_eq!(now.accepted[source].is_set(), fused > 0);
                let three = 3 * source..3 * source + 3;
                let bound: f64 = now.innovations[three.clone()]
                    .iter()
                    .zip(&now.variances[three])
                    .map(|(innovation, variance)| innovation * innovation / variance.max(f64::MIN_POSITIVE))
                    .fold(0.0, f64::max);
                // The square of a component alone is never above that of all together.
                assert!(bound <= now.normalised_squares[source] * (1.0 + 1e-9), "{now:?}");
            }
        }
        last = now;
    }
    // 11 s of fixes at 10 Hz, altitudes at 25 Hz and fields at 50 Hz, and rests at 10 Hz; 2 s of altitudes are wrong.
    let expected = [109, 109, 544, 222, 108, 108];
    for (fused, expected) in last.fused.into_iter().zip(expected) {
        assert!(fused.abs_diff(expected) <= 3, "{last:?}");
    }
    let refused_altitudes = 47;
    assert!(
        last.refused[3].abs_diff(refused_altitudes) <= 2 && last.refused[2] <= 3,
        "{last:?}"
    );
}

/// Largest steps of the published position (m) and velocity (m/s) from `from` on while the state is tracked.
fn largest_steps(
    mut service: InertialEstimatorService,
    world: &mut World,
    [steps, from]: [u64; 2],
    change: impl Fn(&mut World, u64),
) -> [f64; 2] {
    let (mut last, mut largest) = (None::<VehicleState>, [0.0_f64; 2]);
    let (mut settles, mut coasted) = (None, false);
    for number in 0..steps {
        change(world, number);
        let state = step(&mut service, number, &world.step(number));
        if let Some(last) = last.filter(|last| number > from && last.tracked.is_set()) {
            let place = nalgebra::Vector3::from(state.position_world);
            let moved = (place - nalgebra::Vector3::from(last.position_world)).norm();
            let velocity = |state: &VehicleState| state.velocity_world();
            let hurried = (velocity(&state) - velocity(&last)).norm();
            largest = [largest[0].max(moved), largest[1].max(hurried)];
            coasted |= state.coasting.is_set();
            if last.coasting.is_set() && !state.coasting.is_set() {
                settles = Some(place.norm());
            }
        }
        last = Some(state);
    }
    let settled = settles.unwrap();
    assert!(
        coasted && settled < 0.15,
        "still {settled} m away when it ceases to coast"
    );
    assert!(last.is_some_and(|last| last.tracked.is_set() && !last.coasting.is_set()));
    largest
}

#[test]
fn a_better_kind_of_fixes_is_no_step_of_the_published_position() {
    let mut world = World::new(9);
    world.kind = FixKind::SinglePoint;
    // 60 s of single point.
    let [moved, hurried] = largest_steps(service(), &mut world, [18_000, 14_900], |world, number| {
        if number == 15_000 {
            world.kind = FixKind::RtkFixed;
        }
    });
    assert!(moved < 0.054 && hurried < 0.104, "{moved} m, {hurried} m/s");
}

#[test]
fn the_first_fix_after_a_silence_is_no_step_of_the_published_position() {
    // With motors that turn, so that nothing shows the filter that the vehicle rests.
    let mut world = World::new(10);
    world.motors_from = 3900;
    let [moved, hurried] = largest_steps(service(), &mut world, [8000, 4000], |world, number| {
        world.is_silent = (4000..6000).contains(&number);
    });
    assert!(moved < 0.054 && hurried < 0.104, "{moved} m, {hurried} m/s");
}

#[test]
fn poses_after_a_silence_are_no_step_of_the_published_position() {
    // Indoors: no fix ever arrives.
    let mut world = World::new(12);
    (world.motors_from, world.is_silent) = (3900, true);
    let [moved, hurried] = largest_steps(seen(), &mut world, [8000, 4000], |world, number| {
        world.is_hidden = (4000..6000).contains(&number);
    });
    assert!(moved < 0.054 && hurried < 0.104, "{moved} m, {hurried} m/s");
}

#[test]
fn between_poses_and_fixes_the_published_position_takes_no_step() {
    let (mut service, mut world) = (seen(), World::new(13));
    world.motors_from = 3900;
    let (mut last, mut largest) = (None::<VehicleState>, 0.0_f64);
    for number in 0..9000 {
        // In the building, outdoors, and in it again.
        world.is_silent = !(4500..7500).contains(&number);
        world.is_hidden = (5000..7000).contains(&number);
        let (state, _, poses, _) = published(&mut service, number, &world.step(number));
        if let Some(last) = last.filter(|_| number > 3000) {
            let place = |state: &VehicleState| nalgebra::Vector3::from(state.position_world);
            largest = largest.max((place(&state) - place(&last)).norm());
            assert!(state.tracked.is_set() && !state.coasting.is_set(), "at {number}");
            assert!(place(&state).norm() < 0.06, "at {number}: {state:?}");
        }
        if number == 8999 {
            assert!(
                poses.accepted.iter().all(|accepted| accepted.is_set()),
                "{poses:?}"
            );
            assert!(poses.refused.iter().all(|refused| *refused < 20), "{poses:?}");
        }
        last = Some(state);
    }
    assert!(largest < 0.054, "{largest} m");
}

#[test]
fn of_a_pose_whose_attitude_is_none_the_position_is_fused() {
    let (mut service, mut world) = (seen(), World::new(14));
    let mut poses = PoseInnovations::new_zeroed();
    for number in 0..3000 {
        let mut arrived = world.step(number);
        if let Some(pose) = arrived.pose.as_mut().filter(|_| number >= 2000) {
            pose.set_parts(true, false);
            pose.world_from_body = [0.0; 9];
        }
        poses = published(&mut service, number, &arrived).2;
    }
    let [position, attitude] = poses.fused;
    // 11 s and 7 s at 83 Hz.
    assert!(
        position.abs_diff(906) <= 10 && attitude.abs_diff(573) <= 10,
        "{poses:?}"
    );
}

/// What is wrong with a sample, by its name.
type Spoilt = (&'static str, fn(&mut Arrived));

#[test]
fn impossible_samples_change_nothing_and_are_counted() {
    let spoilt: [Spoilt; 15] = [
        ("baseline", |arrived| {
            arrived.baseline.as_mut().unwrap().baseline_ned[1] = f64::NAN;
        }),
        ("accuracy of a baseline", |arrived| {
            arrived.baseline.as_mut().unwrap().accuracies_ned[2] = -1.0;
        }),
        ("baseline from the future", |arrived| {
            arrived.baseline.as_mut().unwrap().valid_ns += 1_000_000_000;
        }),
        ("attitude", |arrived| {
            let pose = arrived.pose.as_mut().unwrap();
            (pose.world_from_body[0], pose.position_world[0]) = (0.5, 2e9);
        }),
        ("pose from the future", |arrived| {
            arrived.pose.as_mut().unwrap().capture_time_ns += 1_000_000_000;
        }),
        ("pose of an earlier time", |arrived| {
            arrived.pose.as_mut().unwrap().capture_time_ns -= 100_000_000;
        }),
        ("rate", |arrived| {
            arrived.imu.as_mut().unwrap().angular_velocity_body[1] = 1e3;
        }),
        ("force", |arrived| {
            arrived.imu.as_mut().unwrap().specific_force_body[1] = f64::NAN;
        }),
        ("imu from the future", |arrived| {
            arrived.imu.as_mut().unwrap().measured_ns += 1_000_000_000;
        }),
        ("latitude", |arrived| {
            arrived.fix.as_mut().unwrap().latitude = 90.1;
        }),
        ("kind", |arrived| arrived.fix.as_mut().unwrap().kind = 3),
        ("accuracy", |arrived| {
            arrived.fix.as_mut().unwrap().horizontal_accuracy = -1.0;
        }),
        ("fix from the future", |arrived| {
            arrived.fix.as_mut().unwrap().valid_ns = u64::MAX;
        }),
        ("altitude", |arrived| {
            arrived.altitude.as_mut().unwrap().altitude = f64::INFINITY;
        }),
        ("field", |arrived| {
            arrived.field.as_mut().unwrap().field_body[2] = 1e3;
        }),
    ];
    let (mut service, mut world) = (seen(), World::new(6));
    // A step at which all sensors are due.
    let last = 3000;
    for number in 0..last {
        step(&mut service, number, &world.step(number));
    }
    let before = saved(&service);
    let arrived = world.step(last);
    let whole = step(&mut service, last, &arrived);
    for (name, spoil) in spoilt {
        let mut spoilt = arrived;
        spoil(&mut spoilt);
        let mut other = seen();
        ErasedService::restore(&mut other, &before);
        let state = step(&mut other, last, &spoilt);
        assert_eq!(state.captures_refused, whole.captures_refused + 1, "{name}");
        let distance =
            nalgebra::Vector3::from(state.position_world) - nalgebra::Vector3::from(whole.position_world);
        assert!(distance.norm() < 1e-3, "{name}");
    }
}

#[test]
fn samples_of_ticks_at_which_nothing_was_measured_are_no_samples() {
    let (mut service, mut world) = (seen(), World::new(7));
    for number in 0..3000 {
        step(&mut service, number, &world.step(number));
    }
    let mut other = seen();
    ErasedService::restore(&mut other, &saved(&service));
    let imu = world.step(3000).imu;
    let nothing = Arrived {
        imu,
        fix: Some(GnssFix::new_zeroed()),
        altitude: Some(BaroAltitude::new_zeroed()),
        field: Some(MagField::new_zeroed()),
        frame: None,
        pose: Some(MocapPose::new_zeroed()),
        baseline: Some(GnssBaseline::new_zeroed()),
    };
    let none = Arrived {
        imu,
        ..Arrived::default()
    };
    let with = step(&mut service, 3000, &nothing);
    let without = step(&mut other, 3000, &none);
    assert_eq!(with.as_bytes(), without.as_bytes());
}

#[test]
fn a_step_does_not_allocate() {
    let (mut service, mut world) = (seen(), World::new(8));
    let all: Vec<_> = (0..600).map(|number| world.step(number)).collect();
    let mut state = vec![0; service.state_size()];
    let count = allocations::allocations_during(|| {
        for (number, arrived) in all.iter().enumerate() {
            step(&mut service, number as u64, arrived);
            ErasedService::save(&service, &mut state);
            ErasedService::restore(&mut service, &state);
        }
    });
    assert_eq!(count, 0);
}

/// Poses agree for the alignment and then have another heading: either may be wrong. After 7 s it is that of the poses, and healthy
/// for 10 s from then on.
#[test]
fn while_attitudes_of_poses_are_refused_the_vehicle_is_not_tracked() {
    let (mut service, mut world) = (seen(), World::new(15));
    let turn = to_row_major(&exp(&nalgebra::Vector3::new(0.0, 0.0, 1.0)));
    let mut tracked_from = None;
    let mut state = VehicleState::new_zeroed();
    for number in 0..6000 {
        let mut arrived = world.step(number);
        if let Some(pose) = arrived.pose.as_mut().filter(|_| number <= 300) {
            pose.world_from_body = turn;
        }
        state = step(&mut service, number, &arrived);
        if state.tracked.is_set() {
            tracked_from.get_or_insert(number);
        }
    }
    let from = tracked_from.unwrap() as f64 * 0.004;
    assert!((18.0..19.0).contains(&from), "{from}");
    assert!((state.world_from_body[0] - 1.0).abs() < 1e-3, "{state:?}");
}

/// Without a field that shows the heading, of which a magnet turns 1.2 rad; baselines of unknown numbers of carrier waves are no help.
#[test]
fn beside_a_magnet_the_heading_is_that_of_two_antennas() {
    for is_fixed in [true, false] {
        let (mut service, mut world) = (with_two_antennas(), World::new(16));
        let mut state = VehicleState::new_zeroed();
        let mut baselines = BaselineInnovations::new_zeroed();
        for number in 0..5000 {
            let mut arrived = world.step(number);
            if let Some(field) = arrived.field.as_mut() {
                let turned =
                    exp(&nalgebra::Vector3::new(0.0, 0.0, 1.2)) * nalgebra::Vector3::from(field.field_body);
                field.field_body = turned.into();
            }
            if let Some(baseline) = arrived.baseline.as_mut() {
                baseline.fixed = is_fixed.into();
            }
            (state, _, _, baselines) = published(&mut service, number, &arrived);
        }
        let heading = heading_of(&state).abs();
        assert_eq!(heading < 0.01, is_fixed, "{heading}");
        // A heading by the field alone is not that for which two antennas are stated.
        assert_eq!(state.tracked.is_set(), is_fixed, "{state:?}");
        // 10 Hz after the alignment, and before the horizon.
        let [fused] = baselines.fused;
        assert!(
            if is_fixed {
                fused.abs_diff(188) < 3
            } else {
                fused == 0
            },
            "{baselines:?}"
        );
        assert_eq!(baselines.refused, [0]);
    }
}

/// Returns the time (s) from which a vehicle is tracked that is aligned by a field bent by an angle (rad), before the first baseline,
/// and the heading at the end, rad; `sign` of the baselines is 1, or −1 where they are stated the wrong way round.
fn aligned_by_a_bent_field(bend: f64, sign: f64) -> (Option<f64>, f64) {
    let (mut service, mut world) = (with_two_antennas(), World::new(17));
    let mut tracked_from = None;
    let mut state = VehicleState::new_zeroed();
    for number in 0..10_000 {
        let mut arrived = world.step(number);
        if let Some(field) = arrived.field.as_mut() {
            let turned =
                exp(&nalgebra::Vector3::new(0.0, 0.0, bend)) * nalgebra::Vector3::from(field.field_body);
            field.field_body = turned.into();
        }
        arrived.baseline = arrived.baseline.filter(|_| number > 300);
        if let Some(baseline) = arrived.baseline.as_mut() {
            baseline.baseline_ned = baseline.baseline_ned.map(|component| sign * component);
        }
        state = step(&mut service, number, &arrived);
        if state.tracked.is_set() {
            tracked_from.get_or_insert(number as f64 * 0.004);
        }
    }
    (tracked_from, heading_of(&state).abs())
}

#[test]
fn while_baselines_are_refused_or_contradict_the_field_the_vehicle_is_not_tracked() {
    // Baselines are refused for 7 s, then the field for as long, and then the vehicle has to be healthy for 10 s.
    let (from, heading) = aligned_by_a_bent_field(1.0, 1.0);
    assert!(
        from.is_some_and(|from| (24.0..27.0).contains(&from)) && heading < 0.01,
        "{from:?} {heading}"
    );
    // A magnet or a wrong sign: one of the two is wrong, and nobody knows which.
    for (bend, sign) in [(2.0, 1.0), (0.0, -1.0)] {
        let (from, heading) = aligned_by_a_bent_field(bend, sign);
        assert_eq!(from, None, "{bend} {sign}: {heading}");
    }
}

fn heading_of(state: &VehicleState) -> f64 {
    libm::atan2(state.world_from_body[3], state.world_from_body[0])
}

/// Baselines that are stated the wrong way round, and no field that could contradict them: none comes, or in milligauss.
#[test]
fn without_a_field_baselines_alone_do_not_make_the_vehicle_tracked() {
    for factor in [None, Some(1000.0)] {
        let (mut service, mut world) = (with_two_antennas(), World::new(17));
        for number in 0..5000 {
            let mut arrived = world.step(number);
            arrived.field = arrived.field.zip(factor).map(|(mut field, factor)| {
                field.field_body = field.field_body.map(|component| factor * component);
                field
            });
            if let Some(baseline) = arrived.baseline.as_mut() {
                baseline.baseline_ned = baseline.baseline_ned.map(|component| -component);
            }
            let state = step(&mut service, number, &arrived);
            assert!(!state.tracked.is_set(), "{factor:?}: {state:?}");
        }
    }
    let (mut service, mut world) = (with_two_antennas(), World::new(17));
    let with_all = (0..5000).map(|number| step(&mut service, number, &world.step(number)));
    assert!(with_all.last().unwrap().tracked.is_set());
}

/// A vehicle that was seen in a hall is carried out, turned, and its inertial measurement unit is switched on there.
#[test]
fn the_alignment_forgets_poses_from_before_a_gap_of_the_inertial_samples() {
    let (mut service, mut world) = (seen(), World::new(15));
    let turned = to_row_major(&exp(&nalgebra::Vector3::new(0.0, 0.0, 1.2)));
    let mut state = VehicleState::new_zeroed();
    for number in 0..6000 {
        let mut arrived = world.step(number);
        if number < 500 {
            if let Some(pose) = arrived.pose.as_mut() {
                pose.world_from_body = turned;
            }
            arrived = Arrived {
                pose: arrived.pose,
                ..Arrived::default()
            };
        } else if number < 2500 {
            arrived = Arrived::default();
        } else {
            arrived.pose = None;
        }
        state = step(&mut service, number, &arrived);
    }
    // That of the field.
    assert!(
        state.tracked.is_set() && heading_of(&state).abs() < 0.3,
        "{state:?}"
    );
}

/// After the heading was reset on the ground, all that made it trusted holds again.
#[test]
fn baselines_that_turn_on_the_ground_end_the_trust_in_the_heading() {
    let (mut service, mut world) = (with_two_antennas(), World::new(17));
    let turn = exp(&nalgebra::Vector3::new(0.0, 0.0, std::f64::consts::PI));
    for number in 0..12_000 {
        let mut arrived = world.step(number);
        if let Some(baseline) = arrived.baseline.as_mut().filter(|_| number >= 4000) {
            baseline.baseline_ned = (turn * nalgebra::Vector3::from(baseline.baseline_ned)).into();
        }
        let state = step(&mut service, number, &arrived);
        // 1 s after the first that is refused, beyond the horizon.
        let is_trusted = (3000..4000).contains(&number);
        if is_trusted || number > 4400 {
            assert_eq!(state.tracked.is_set(), is_trusted, "{number}: {state:?}");
        }
    }
}

/// Poses with another origin than the fixes: the one that was fused first would be flown by.
#[test]
fn poses_that_contradict_the_fixes_keep_the_vehicle_from_being_tracked() {
    let (mut service, mut world) = (seen(), World::new(15));
    world.shift = [3.0, 0.0, 0.0];
    for number in 0..9000 {
        world.is_hidden = number < 4000;
        let state = step(&mut service, number, &world.step(number));
        if number > 4400 || number == 3999 {
            assert_eq!(state.tracked.is_set(), number == 3999, "{number}: {state:?}");
        }
    }
}

/// One pose that is no pose of the vehicle costs nothing, and a frame that stops the motors in the air for a moment neither.
#[test]
fn trust_ends_only_at_rest_and_after_refusals_in_a_row() {
    for (seen_at, motors_from, stopped_at) in [(3501..3502, u64::MAX, 0), (4000..6000, 3500, 5000)] {
        let (mut service, mut world) = (seen(), World::new(15));
        world.motors_from = motors_from;
        for number in 0..6000 {
            let mut arrived = world.step(number);
            arrived.pose = arrived
                .pose
                .filter(|_| seen_at.contains(&number))
                .map(|mut pose| {
                    pose.position_world[0] += 3.0;
                    pose
                });
            if number == stopped_at
                && let Some(frame) = arrived.frame.as_mut()
            {
                frame.failsafe = true.into();
            }
            let state = step(&mut service, number, &arrived);
            assert!(number < 3000 || state.tracked.is_set(), "{number}: {state:?}");
        }
    }
}
