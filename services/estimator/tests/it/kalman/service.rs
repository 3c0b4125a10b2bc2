//! Filter inside the service, as hosts see it.

use estimator::{Estimate, EstimatorService};
use scenario::{Kalman, Model};
use shared_types::Now;
use shared_types::samples::{MocapPose, RcFrame, VehicleState};
use shared_types::service::{ErasedService, InputView};
use zerocopy::{FromZeros, IntoBytes};

use super::rig::{Rig, TICK_NS, World, pilot_on_the_eight, scenario};

fn service(kalman: &Kalman) -> EstimatorService {
    EstimatorService::new(&scenario(&Model::default(), kalman)).unwrap()
}

fn view<T: IntoBytes + zerocopy::Immutable>(sample: Option<&T>) -> InputView<'_> {
    InputView {
        bytes: sample.map(IntoBytes::as_bytes),
        fresh: true,
    }
}

fn step(
    service: &mut EstimatorService,
    tick: u64,
    pose: Option<&MocapPose>,
    frame: Option<&RcFrame>,
) -> VehicleState {
    let now = Now {
        tick,
        time_ns: tick * TICK_NS,
        elapsed_ns: TICK_NS,
        operator: shared_types::Operator::FLYING,
    };
    let mut state = VehicleState::new_zeroed();
    let mut outputs = crate::indoors::outputs(Some(state.as_mut_bytes()));
    ErasedService::step(
        service,
        &now,
        &crate::indoors::inputs(view(pose), view(frame)),
        &mut outputs,
    );
    state
}

fn saved(service: &EstimatorService) -> Vec<u8> {
    let mut state = vec![0; service.state_size()];
    ErasedService::save(service, &mut state);
    state
}

/// A flight with all events that the filter's memory records: a drop-out, a jump that ends in a restart if the attitude
/// is not turned, and is refused to its end if it is.
fn eventful(swapped_rotation: nalgebra::Vector3<f64>) -> Rig {
    let world = World {
        hidden: 200..300,
        swapped: 400..800,
        swapped_rotation,
        ..World::laboratory(50)
    };
    Rig::new(world, &Kalman::default(), &Model::default())
}

#[test]
fn restored_at_every_step_it_goes_on_with_the_same_bytes() {
    // 30 until the jump is accepted, 20 between its end and that of the flight; or all of a turned attitude.
    for (turn, refused) in [(0.0, 50), (1.5, 50)] {
        let mut steady = service(&Kalman::default());
        let mut rig = eventful(nalgebra::Vector3::z() * turn);
        while rig.tick < 1000 {
            let tick = rig.tick;
            let before = saved(&steady);
            let moment = rig.step(pilot_on_the_eight);
            let (pose, frame) = (moment.seen.as_ref(), moment.heard.as_ref());
            let expected = step(&mut steady, tick, pose, frame);
            let mut restarted = service(&Kalman::default());
            ErasedService::restore(&mut restarted, &before);
            let got = step(&mut restarted, tick, pose, frame);
            assert_eq!(got.as_bytes(), expected.as_bytes(), "at tick {tick}");
            assert_eq!(saved(&restarted), saved(&steady), "at tick {tick}");
        }
        assert_eq!(rig.filter.captures_refused(), refused);
    }
}

#[test]
fn the_service_publishes_the_filters_estimate() {
    let mut service = service(&Kalman::default());
    let mut rig = eventful(nalgebra::Vector3::zeros());
    while rig.tick < 1000 {
        let (tick, now_ns) = (rig.tick, rig.now_ns());
        let moment = rig.step(pilot_on_the_eight);
        let state = step(&mut service, tick, moment.seen.as_ref(), moment.heard.as_ref());
        assert_eq!(state.tracked.is_set(), rig.filter.is_tracking(now_ns));
        assert_eq!(state.coasting.is_set(), rig.filter.is_coasting(now_ns));
        assert_eq!(state.captures_refused, rig.filter.captures_refused());
        let Some(told) = moment.told else {
            continue;
        };
        let mut expected = VehicleState::new_zeroed();
        told.write(&mut expected);
        assert_eq!(
            VehicleState {
                tracked: false.into(),
                coasting: false.into(),
                captures_refused: 0,
                ..state
            },
            expected
        );
    }
}

#[test]
fn before_the_first_capture_the_state_is_level_at_rest_and_not_tracked() {
    let mut expected = VehicleState::new_zeroed();
    Estimate::UNMEASURED.write(&mut expected);
    let hidden = MocapPose::new_zeroed();
    assert_eq!(
        step(&mut service(&Kalman::default()), 3, Some(&hidden), None),
        expected
    );
}

#[test]
fn a_lost_vehicle_keeps_its_last_state_as_not_tracked() {
    let mut service = service(&Kalman::default());
    let seen = MocapPose {
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        tracked: true.into(),
        ..MocapPose::new_zeroed()
    };
    step(&mut service, 5, Some(&seen), None);
    let coasting = step(&mut service, 555, None, None);
    assert!(!coasting.tracked.is_set() && coasting.state_time_ns == 560 * TICK_NS);
    assert_eq!(step(&mut service, 556, None, None), coasting);
    assert_eq!(step(&mut service, 10_000, None, None), coasting);
}

#[test]
fn more_frames_under_way_than_its_history_are_refused_with_the_fix() {
    // Frames of every tick; a capture may be 5 + 10 + 1 of them old, one more acts, the one before is kept, another begins.
    let with_latency = |latency: f64| {
        let model = Model {
            radio_latency: latency,
            ..Model::default()
        };
        let mut scenario = scenario(&model, &Kalman::default());
        scenario.schedule.period.retain(|name, _| name == "mocap/pose");
        EstimatorService::new(&scenario)
    };
    assert!(with_latency(0.045).is_ok());
    let problem = with_latency(0.046).unwrap_err();
    assert_eq!(problem.key.to_string(), "model.radio_latency");
    assert!(
        problem.reason.contains("64 frames") && problem.reason.contains("65 are sent"),
        "{problem}"
    );
}
