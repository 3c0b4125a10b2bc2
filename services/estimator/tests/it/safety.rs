//! Estimator on captures and frames that are missing, too old or impossible.

use estimator::EstimatorService;
use proptest::prelude::*;
use shared_types::Now;
use shared_types::sample::Field;
use shared_types::samples::{MocapPose, RcFrame, VehicleState};
use shared_types::service::{ErasedService, InputView};
use zerocopy::{FromZeros, IntoBytes};

use crate::garbage::sample;

const TICK_NS: u64 = 1_000_000;
const IDEAL: &str = "";
const POLICY: &str = "[safety.\"mocap/pose -> estimator\"]\nmax_age = 0.03";
const FILTER: &str = "[estimator.kalman]\n[model]\n[vehicle.actuators]\n[controller.rates]\n\
                      [schedule.period]\n\"mocap/pose\" = 0.01\n[schedule.latency]\n\"mocap/pose -> estimator\" = 0.005";

fn service(sections: &str) -> EstimatorService {
    let head = "duration = 1.0\n\
                vehicle.mass = 0.2\nvehicle.inertia = [6.5e-4, 6.5e-4, 13.0e-4]\n\
                path.curve.hover.position = [0.0, 0.0, -1.0]\n";
    EstimatorService::new(&toml::from_str(&(head.to_owned() + sections)).unwrap()).unwrap()
}

fn pose(tick: u64) -> MocapPose {
    let mut pose = MocapPose::new_zeroed();
    (pose.header.seq, pose.header.stamp_ns) = (tick, tick * TICK_NS);
    pose.capture_time_ns = pose.header.stamp_ns;
    pose.position_world = [1e-3 * tick as f64, 0.0, -1.0];
    pose.world_from_body = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    pose.tracked = true.into();
    pose.velocities_measured = true.into();
    pose
}

fn frame(tick: u64) -> RcFrame {
    let mut frame = RcFrame::new_zeroed();
    (frame.header.seq, frame.header.stamp_ns) = (tick, tick * TICK_NS);
    (frame.thrust, frame.mode) = (1.962, RcFrame::MODE_RATES);
    frame
}

fn step(
    service: &mut EstimatorService,
    tick: u64,
    (pose, pose_is_new): (&MocapPose, bool),
    frame: Option<&RcFrame>,
) -> VehicleState {
    let now = Now {
        tick,
        time_ns: tick * TICK_NS,
        elapsed_ns: TICK_NS,
        operator: shared_types::Operator::FLYING,
    };
    let pose = InputView {
        bytes: Some(pose.as_bytes()),
        fresh: pose_is_new,
    };
    let frame = InputView {
        bytes: frame.map(IntoBytes::as_bytes),
        fresh: frame.is_some(),
    };
    let inputs = crate::indoors::inputs(pose, frame);
    let mut state = VehicleState::new_zeroed();
    let mut outputs = crate::indoors::outputs(Some(state.as_mut_bytes()));
    ErasedService::step(service, &now, &inputs, &mut outputs);
    state
}

fn restarted(service: &EstimatorService, sections: &str) -> EstimatorService {
    crate::restart::restarted(service, self::service(sections))
}

#[test]
fn an_ideal_capture_that_is_too_old_is_no_measurement_with_a_policy_and_is_one_without() {
    for (sections, limit) in [(IDEAL, u64::MAX), (POLICY, 30)] {
        let mut service = service(sections);
        for age in 0..60 {
            service = restarted(&service, sections);
            let state = step(&mut service, 5 + age, (&pose(5), age == 0), None);
            assert_eq!(state.tracked.is_set(), age <= limit, "{age} ms");
            assert_eq!(state.coasting.is_set(), age > limit, "{age} ms");
            assert_eq!(state.position_world, pose(5).position_world);
        }
    }
}

#[test]
fn an_ideal_capture_of_no_pose_is_counted_and_the_last_good_one_stays() {
    let mut service = service(IDEAL);
    step(&mut service, 1, (&pose(1), true), None);
    let spoil: [fn(&mut MocapPose); 4] = [
        |pose| pose.position_world[0] = f64::NAN,
        |pose| pose.velocity_body[1] = f64::INFINITY,
        |pose| pose.world_from_body[0] = 1.01,
        |pose| pose.world_from_body[8] = -1.0,
    ];
    for (tick, spoil) in (2..).zip(spoil) {
        let mut spoilt = pose(tick);
        spoil(&mut spoilt);
        let state = step(&mut service, tick, (&spoilt, true), None);
        assert_eq!(state.captures_refused, tick as u32 - 1);
        assert_eq!(state.position_world, pose(1).position_world);
        assert_eq!(
            state.state_time_ns,
            pose(1).capture_time_ns,
            "consumers see that the state is not new"
        );
    }
}

#[test]
fn a_filtered_state_coasts_when_nothing_was_used_for_two_periods_and_the_latency() {
    let mut service = service(FILTER);
    for tick in 0..=105 {
        let arrives = tick % 10 == 5;
        let state = step(
            &mut service,
            tick,
            (&pose(tick - tick.min(5)), arrives),
            Some(&frame(tick)),
        );
        assert!(!state.coasting.is_set(), "{tick}");
    }
    for tick in 106..200 {
        let state = step(&mut service, tick, (&pose(100), false), Some(&frame(tick)));
        assert_eq!(state.coasting.is_set(), tick - 105 > 25, "{tick}");
        assert!(state.tracked.is_set());
    }
    let state = step(&mut service, 205, (&pose(200), true), Some(&frame(205)));
    assert!(!state.coasting.is_set());
}

#[test]
fn a_frame_that_is_not_finite_or_beyond_the_link_is_ignored() {
    let with_link = format!("{FILTER}\n[rc_output]");
    let (mut with, mut without) = (service(&with_link), service(&with_link));
    for tick in 0..200 {
        let mut garbage = frame(tick);
        match tick % 4 {
            0 => garbage.rates_body[1] = f64::NAN,
            1 => garbage.rates_body[1] = -19.1,
            2 => garbage.rates_body[2] = 8.1,
            _ => garbage.thrust = 5.5,
        }
        let capture = (&pose(tick), tick % 10 == 0);
        let heard = if tick % 3 == 1 { Some(&garbage) } else { None };
        let state = step(&mut with, tick, capture, heard);
        assert_eq!(
            state.as_bytes(),
            step(&mut without, tick, capture, None).as_bytes()
        );
    }
}

type Bits = (Vec<u8>, Vec<bool>, bool);

fn bits() -> impl Strategy<Value = Vec<Bits>> {
    let one = (
        proptest::collection::vec(any::<u8>(), 400),
        proptest::collection::vec(any::<bool>(), 7),
        proptest::bool::weighted(0.7),
    );
    proptest::collection::vec(one, 1..40)
}

proptest! {
    #[test]
    fn any_input_bits_give_a_finite_state_and_a_restart_changes_nothing(garbage in bits()) {
        for sections in [IDEAL, POLICY, FILTER] {
            let (mut steady, mut other) = (service(sections), service(sections));
            for (tick, (bits, keep, is_good)) in (0..).step_by(3).zip(&garbage) {
                let all = [*is_good].repeat(keep.len());
                let keep = if *is_good { &all } else { keep };
                let capture = sample(bits, &pose(tick), keep);
                let heard = sample(bits, &frame(tick), keep);
                let state = step(&mut steady, tick, (&capture, true), Some(&heard));
                prop_assert!(state.is_finite(), "{:?}", state);
                other = restarted(&other, sections);
                let again = step(&mut other, tick, (&capture, true), Some(&heard));
                prop_assert_eq!(again.as_bytes(), state.as_bytes());
            }
        }
    }
}
