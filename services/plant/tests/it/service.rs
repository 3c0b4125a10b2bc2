//! Plant as hosts see it: time, frames, changes, restarts.

use plant::PlantService;
use proptest::prelude::*;
use scenario::{GRAVITY, Scenario};
use shared_types::Now;
use shared_types::samples::{MocapPose, RcFrame, VehicleTruth};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

const TICK_NS: u64 = 1_000_000;
const H: f64 = 1e-3;

/// A level vehicle of 0.25 kg, at rest unless `initial` says otherwise.
fn scenario(initial: &str, changes: &str) -> Scenario {
    toml::from_str(&format!(
        "duration = 1.0\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]\n\
         [vehicle]\n\
         mass = 0.25\n\
         inertia = [6.5e-4, 9.0e-4, 13.0e-4]\n\
         disturbance = [0.0, 0.0, 0.0]\n\
         initial = {{ {initial} }}\n\
         change = [{changes}]"
    ))
    .unwrap()
}

const TUMBLING: &str = "position = [1.0, 2.0, -3.0], roll_pitch_yaw = [0.1, -0.2, 0.3], \
     velocity_body = [1.0, 0.5, -0.5], angular_velocity_body = [3.0, -2.0, 1.0]";

fn frame(thrust: f64, torque_body: [f64; 3]) -> RcFrame {
    RcFrame {
        thrust,
        torque_body,
        ..RcFrame::new_zeroed()
    }
}

/// The frame that carries a vehicle of 0.25 kg.
fn hover_frame() -> RcFrame {
    frame(0.25 * GRAVITY, [0.0; 3])
}

/// Steps at `tick`, `elapsed` ticks after the previous step, with every output due.
fn step(
    service: &mut PlantService,
    tick: u64,
    elapsed: u64,
    frame: Option<&RcFrame>,
) -> (VehicleTruth, MocapPose) {
    let mut truth = VehicleTruth::new_zeroed();
    let mut pose = MocapPose::new_zeroed();
    let outputs = [Some(truth.as_mut_bytes()), Some(pose.as_mut_bytes())];
    step_into(service, tick, elapsed, frame, outputs);
    (truth, pose)
}

fn step_into(
    service: &mut PlantService,
    tick: u64,
    elapsed: u64,
    frame: Option<&RcFrame>,
    outputs: [Option<&mut [u8]>; 2],
) {
    let now = Now {
        tick,
        time_ns: tick * TICK_NS,
        elapsed_ns: elapsed * TICK_NS,
        operator: shared_types::Operator::FLYING,
    };
    let inputs = [InputView {
        bytes: frame.map(IntoBytes::as_bytes),
        fresh: frame.is_some(),
    }];
    let [truth, pose] = outputs;
    let mut outputs = [truth, pose, None, None, None, None, None].map(|bytes| OutputSlot { bytes });
    ErasedService::step(service, &now, &inputs, &mut outputs);
}

/// Flies ticks 0 to `last` with one frame and returns the truth of each.
fn truths(scenario: &Scenario, frame: Option<&RcFrame>, last: u64) -> Vec<VehicleTruth> {
    let mut service = PlantService::new(scenario);
    (0..=last)
        .map(|tick| step(&mut service, tick, tick.min(1), frame).0)
        .collect()
}

#[test]
fn the_first_sample_is_the_initial_state_and_nothing_has_acted() {
    let scenario = scenario("position = [1.0, 2.0, -3.0], velocity_body = [4.0, 5.0, 6.0]", "");
    let (truth, _) = step(
        &mut PlantService::new(&scenario),
        0,
        0,
        Some(&frame(9.0, [1.0; 3])),
    );
    assert_eq!(truth.position_world, [1.0, 2.0, -3.0]);
    assert_eq!(truth.velocity_body, [4.0, 5.0, 6.0]);
    assert_eq!((truth.thrust, truth.torque_body), (0.0, [0.0; 3]));
}

#[test]
fn the_initial_velocity_is_that_of_the_body_frame_whatever_the_attitude() {
    let (truth, _) = step(&mut PlantService::new(&scenario(TUMBLING, "")), 0, 0, None);
    for (got, stated) in truth.velocity_body.iter().zip([1.0, 0.5, -0.5]) {
        assert!((got - stated).abs() < 1e-15);
    }
    assert_eq!(truth.angular_velocity_body, [3.0, -2.0, 1.0]);
}

#[test]
fn without_a_frame_the_vehicle_falls_freely() {
    let truth = truths(&scenario("", ""), None, 100)[100];
    assert!((truth.position_world[2] - 0.5 * GRAVITY * 0.01).abs() < 1e-15);
    assert_eq!(truth.thrust, 0.0);
}

#[test]
fn thrust_and_torque_follow_the_frame_at_once_and_are_reported() {
    let asked = frame(1.0, [1e-3, 2e-3, 3e-3]);
    let truth = truths(&scenario("", ""), Some(&asked), 1)[1];
    assert_eq!(
        (truth.thrust, truth.torque_body),
        (asked.thrust, asked.torque_body)
    );
    let angular_acceleration = [1e-3 / 6.5e-4, 2e-3 / 9.0e-4, 3e-3 / 13.0e-4];
    for (omega, acceleration) in truth.angular_velocity_body.iter().zip(angular_acceleration) {
        // The effect of the gyroscopic term within a tick is of second order.
        assert!((omega / H - acceleration).abs() < 2e-6, "{omega}");
    }
    assert!((truth.velocity_body[2] / H - (GRAVITY - 4.0)).abs() < 1e-6);
}

#[test]
fn the_ideal_cameras_report_the_truth_at_once() {
    let mut service = PlantService::new(&scenario(TUMBLING, ""));
    step(&mut service, 0, 0, None);
    let (truth, pose) = step(&mut service, 1, 1, Some(&hover_frame()));
    assert_eq!(pose.capture_time_ns, TICK_NS);
    assert_eq!(pose.position_world, truth.position_world);
    assert_eq!(pose.world_from_body, truth.world_from_body);
    assert_eq!(pose.velocity_body, truth.velocity_body);
    assert_eq!(pose.angular_velocity_body, truth.angular_velocity_body);
    assert!(pose.tracked.is_set() && pose.velocities_measured.is_set());
}

#[test]
fn due_outputs_have_no_influence_on_the_flight() {
    let scenario = scenario(TUMBLING, "{ at = 0.005, mass = 0.5 }");
    let frame = hover_frame();
    let mut watched = PlantService::new(&scenario);
    let mut unwatched = PlantService::new(&scenario);
    for tick in 0..10 {
        step(&mut watched, tick, tick.min(1), Some(&frame));
        step_into(&mut unwatched, tick, tick.min(1), Some(&frame), [None, None]);
    }
    assert_eq!(saved(&watched), saved(&unwatched));
}

#[test]
fn a_change_states_only_what_it_changes() {
    let changes = "{ at = 0.001, mass = 0.5 }, { at = 0.002, inertia = [7e-4, 8e-4, 9e-4] }, \
         { at = 0.003, disturbance = [1.0, 2.0, 3.0] }";
    let before = [6.5e-4, 9.0e-4, 13.0e-4];
    let after = [7e-4, 8e-4, 9e-4];
    let bodies: Vec<_> = truths(&scenario("", changes), None, 3)
        .iter()
        .map(|truth| (truth.mass, truth.inertia, truth.disturbance_world))
        .collect();
    let expected = [
        (0.25, before, [0.0; 3]),
        (0.5, before, [0.0; 3]),
        (0.5, after, [0.0; 3]),
        (0.5, after, [1.0, 2.0, 3.0]),
    ];
    assert_eq!(bodies, expected);
}

#[test]
fn a_change_at_the_start_is_in_force_from_the_first_tick() {
    let truths = truths(&scenario("", "{ at = 0.0, mass = 0.5 }"), Some(&hover_frame()), 1);
    assert_eq!(truths[0].mass, 0.5);
    assert!((truths[1].velocity_body[2] / H - 0.5 * GRAVITY).abs() < 1e-12);
}

#[test]
fn a_plant_that_begins_late_has_the_changes_that_are_in_force() {
    let scenario = scenario("", "{ at = 0.1, mass = 0.5 }, { at = 0.2, mass = 0.75 }");
    let (truth, _) = step(&mut PlantService::new(&scenario), 150, 0, None);
    assert_eq!(truth.mass, 0.5);
}

proptest! {
    #[test]
    fn a_change_is_published_at_its_tick_and_acts_from_it_on_not_before(at in 1..60u64) {
        let stated = format!("{{ at = {}, mass = 0.5, disturbance = [1.0, 0.0, 0.0] }}", Now {
            tick: at, time_ns: at * TICK_NS, elapsed_ns: 0, operator: shared_types::Operator::FLYING,
        }.time());
        let truths = truths(&scenario("", &stated), Some(&hover_frame()), at + 1);
        let at = usize::try_from(at).unwrap();
        prop_assert_eq!((truths[at - 1].mass, truths[at - 1].disturbance_world), (0.25, [0.0; 3]));
        prop_assert_eq!((truths[at].mass, truths[at].disturbance_world), (0.5, [1.0, 0.0, 0.0]));
        // Hovering to the bit until the change; then half of gravity is left, and the disturbance.
        prop_assert_eq!(truths[at].velocity_body, [0.0; 3]);
        let velocity = truths[at + 1].velocity_body;
        prop_assert!((velocity[0] / H - 1.0).abs() < 1e-12);
        prop_assert!((velocity[2] / H - 0.5 * GRAVITY).abs() < 1e-12);
    }

    #[test]
    fn a_plant_that_steps_less_often_flies_the_same_bits(period in 2..12u64, at in 1..60u64) {
        let stated = format!("{{ at = {}, mass = 0.5 }}", Now {
            tick: at, time_ns: at * TICK_NS, elapsed_ns: 0, operator: shared_types::Operator::FLYING,
        }.time());
        let scenario = scenario(TUMBLING, &stated);
        let frame = frame(2.0, [1e-3, -2e-3, 1e-3]);
        let every_tick = truths(&scenario, Some(&frame), 60);
        let mut rare = PlantService::new(&scenario);
        for tick in (0..=60).step_by(usize::try_from(period).unwrap()) {
            let (truth, _) = step(&mut rare, tick, tick.min(period), Some(&frame));
            prop_assert_eq!(truth, every_tick[usize::try_from(tick).unwrap()]);
        }
    }

    #[test]
    fn a_restored_plant_continues_with_the_same_bytes(restart in 0..40u64, thrust in 0.0..5.0f64) {
        let scenario = scenario(TUMBLING, "{ at = 0.02, mass = 0.5 }");
        let frame = frame(thrust, [1e-3, -2e-3, 1e-3]);
        let mut steady = PlantService::new(&scenario);
        let mut restarted = PlantService::new(&scenario);
        for tick in 0..60 {
            let expected = step(&mut steady, tick, tick.min(1), Some(&frame));
            let got = step(&mut restarted, tick, tick.min(1), Some(&frame));
            prop_assert_eq!(got.0.as_bytes(), expected.0.as_bytes());
            prop_assert_eq!(got.1.as_bytes(), expected.1.as_bytes());
            if tick == restart {
                let state = saved(&restarted);
                restarted = PlantService::new(&scenario);
                ErasedService::restore(&mut restarted, &state);
                prop_assert_eq!(saved(&restarted), state);
            }
        }
    }
}

#[test]
fn until_a_newer_frame_comes_the_frame_of_the_checkpoint_carries_a_restarted_plant() {
    let scenario = scenario("", "");
    let mut before = PlantService::new(&scenario);
    for tick in 0..10 {
        step(&mut before, tick, tick.min(1), Some(&hover_frame()));
    }
    let mut restarted = PlantService::new(&scenario);
    ErasedService::restore(&mut restarted, &saved(&before));
    for tick in 10..30 {
        let (truth, _) = step(&mut restarted, tick, 1, None);
        assert_eq!(truth.thrust, hover_frame().thrust);
    }
}

fn saved(service: &PlantService) -> Vec<u8> {
    let mut state = vec![0; service.state_size()];
    ErasedService::save(service, &mut state);
    state
}
