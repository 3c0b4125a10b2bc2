//! Phases and envelope.

use std::net::Ipv4Addr;

use super::assert_only;
use crate::tests_support::{fig1, rig};
use crate::{
    Action, CaptureSystem, Curve, Envelope, EstimateLimit, Fence, Flight, Hover, InputSafety, Limit,
    MotionCapture, Problem, RadioProtocol, Scenario, VectorLimit, Waypoints,
};
use shared_types::schedule::OperatorPlan;
use shared_types::service::Operator;

/// A flight from the ground, with all limits that commands of torque have.
fn phased() -> Scenario {
    let limit = |max| {
        Some(Limit {
            max,
            action: Action::Land,
        })
    };
    let [x, y, z] = fig1().vehicle.initial.position;
    Scenario {
        flight: Some(Flight {
            arm_at: Some(1.0),
            land_at: Some(50.0),
            kill_at: Some(59.0),
            ..Flight::default()
        }),
        envelope: Some(Envelope {
            r#box: Some(Fence {
                min: [x - 9.0, y - 9.0, z - 9.0],
                max: [x + 9.0, y + 9.0, z + 9.0],
                margin: 0.5,
                action: Action::Kill,
            }),
            tilt: limit(0.8),
            speed: limit(3.0),
            estimate: Some(EstimateLimit {
                position_sigma: 0.05,
                action: Action::Warn,
            }),
            thrust: limit(4.0),
            torque: Some(VectorLimit {
                max: [0.1; 3],
                action: Action::Warn,
            }),
            ..Envelope::default()
        }),
        ..fig1()
    }
}

fn problems(spoil: impl FnOnce(&mut Scenario, &mut Flight, &mut Envelope)) -> Vec<Problem> {
    let mut scenario = phased();
    let (mut flight, mut envelope) = (scenario.flight.take().unwrap(), scenario.envelope.take().unwrap());
    spoil(&mut scenario, &mut flight, &mut envelope);
    (scenario.flight, scenario.envelope) = (Some(flight), Some(envelope));
    scenario.problems()
}

#[track_caller]
fn refused(
    spoil: impl FnOnce(&mut Scenario, &mut Flight, &mut Envelope),
    key: &str,
    reason: &str,
    fix: &str,
) {
    assert_only(&problems(spoil), key, reason, fix);
}

#[test]
fn a_flight_with_phases_and_an_envelope_is_accepted() {
    assert_eq!(problems(|_, _, _| ()), []);
    assert_eq!(phased().missing_arm_request(), None);
}

#[test]
fn the_operator_asks_at_the_stated_ticks_and_flies_all_along_without_phases() {
    let plan = phased().schedule().unwrap().operator();
    let at = |tick| plan.at(tick);
    let asks = |armed, land, killed| Operator {
        armed,
        land,
        killed,
        arm_count: u8::from(armed),
    };
    assert_eq!(
        [at(999), at(1000)],
        [asks(false, false, false), asks(true, false, false)]
    );
    assert_eq!(
        [at(49_999), at(50_000)],
        [asks(true, false, false), asks(true, true, false)]
    );
    assert_eq!(
        [at(58_999), at(59_000)],
        [asks(true, true, false), asks(true, true, true)]
    );
    assert_eq!(fig1().schedule().unwrap().operator(), OperatorPlan::FLYING);
    assert_eq!(OperatorPlan::FLYING.at(0), Operator::FLYING);
}

#[test]
fn a_simulated_flight_without_arming_is_refused() {
    let mut scenario = phased();
    scenario.flight.as_mut().unwrap().arm_at = None;
    assert_eq!(scenario.problems(), []);
    let problem = scenario.missing_arm_request().unwrap();
    assert_eq!(problem.key.to_string(), "flight.arm_at");
    assert!(problem.fix.contains("arm_at = 1.0"), "{}", problem.fix);
}

#[test]
fn in_a_laboratory_people_arm() {
    assert_eq!(rig().unattended_arming(), None);
    let seen = |scenario: &mut Scenario| {
        scenario.motion_capture = Some(MotionCapture::new(
            CaptureSystem::Vrpn,
            Ipv4Addr::LOCALHOST,
            "quad",
        ));
    };
    let heard = |scenario: &mut Scenario| {
        scenario.rc_output.get_or_insert_default().link = RadioProtocol::Crsf;
    };
    for connect in [&seen as &dyn Fn(&mut Scenario), &heard] {
        let mut scenario = rig();
        connect(&mut scenario);
        let problem = scenario.unattended_arming().unwrap();
        assert_eq!(problem.key.to_string(), "flight");
        scenario.flight = Some(Flight::default());
        assert_eq!(scenario.unattended_arming(), None);
        scenario.flight.as_mut().unwrap().arm_at = Some(1.0);
        let problem = scenario.unattended_arming().unwrap();
        assert_eq!(problem.key.to_string(), "flight.arm_at");
    }
}

#[test]
fn requests_that_cannot_be_meant_are_refused() {
    refused(
        |_, flight, _| flight.land_at = Some(1.0),
        "flight.land_at",
        "never flies",
        "after 1.0 s",
    );
    refused(
        |_, flight, _| flight.kill_at = Some(99.0),
        "flight.kill_at",
        "after the end",
        "raise `duration`",
    );
    refused(
        |_, flight, _| flight.arm_at = Some(0.000_5),
        "flight.arm_at",
        "",
        "",
    );
}

#[test]
fn a_vehicle_that_moves_does_not_stand_on_the_ground() {
    refused(
        |scenario, _, _| scenario.vehicle.initial.velocity_body = [0.1, 0.0, 0.0],
        "vehicle.initial.velocity_body",
        "stands on the ground",
        "leave `velocity_body` out",
    );
}

#[test]
fn limits_that_cannot_be_kept_are_refused() {
    let fence = |change: fn(&mut Fence)| {
        move |_: &mut Scenario, _: &mut Flight, envelope: &mut Envelope| {
            change(envelope.r#box.as_mut().unwrap());
        }
    };
    refused(
        |_, _, envelope| {
            let fence = envelope.r#box.as_mut().unwrap();
            (fence.min, fence.max) = ([90.0; 3], [99.0; 3]);
        },
        "envelope.box",
        "starts outside",
        "vehicle.initial.position",
    );
    let swapped = problems(fence(|fence| {
        std::mem::swap(&mut fence.min[2], &mut fence.max[2]);
    }));
    assert_eq!(swapped[0].key.to_string(), "envelope.box.max.2");
    refused(
        |_, _, envelope| envelope.tilt.as_mut().unwrap().max = 3.2,
        "envelope.tilt.max",
        "upside down",
        "below π",
    );
}

#[test]
fn a_limit_on_the_state_needs_an_action_without_one() {
    refused(
        |_, _, envelope| envelope.estimate = None,
        "envelope.estimate",
        "`box` is checked on the estimated state",
        "add `envelope.estimate",
    );
}

#[test]
fn only_a_flight_with_phases_can_land() {
    let mut scenario = phased();
    scenario.flight = None;
    let keys: Vec<_> = scenario
        .problems()
        .iter()
        .map(|problem| problem.key.to_string())
        .collect();
    let expected = ["tilt", "speed", "thrust"].map(|name| format!("envelope.{name}.action"));
    assert_eq!(keys, expected);
}

#[test]
fn a_limit_on_values_that_are_not_commanded_is_refused() {
    let rates = VectorLimit {
        max: [9.0; 3],
        action: Action::Warn,
    };
    refused(
        |_, _, envelope| envelope.rates = Some(rates.clone()),
        "envelope.rates",
        "commands torque",
        "leave",
    );
    let mut scenario = rig();
    scenario.envelope = Some(Envelope {
        rates: Some(rates),
        ..Envelope::default()
    });
    assert_eq!(scenario.problems(), []);
}

#[test]
fn policies_of_inputs_that_only_phases_or_an_envelope_use_want_them() {
    for (edge, section) in [
        ("rc/frame -> path_generator", "[flight]"),
        ("vehicle/state -> rc_output", "[envelope]"),
    ] {
        let mut scenario = fig1();
        scenario.safety.insert(edge.to_owned(), InputSafety::new(0.1));
        assert_only(
            &scenario.problems(),
            &format!("safety.{edge:?}"),
            "does not use this input",
            section,
        );
        let mut scenario = phased();
        scenario.safety.insert(edge.to_owned(), InputSafety::new(0.1));
        assert_eq!(scenario.problems(), []);
    }
}

#[test]
fn a_path_below_the_ground_is_refused_with_the_direction_of_z() {
    let curves: [(&str, Curve); 2] = [
        ("path.curve.hover.position", hover([0.0, 0.0, 3.0])),
        (
            "path.curve.waypoints.points",
            Curve::Waypoints(Waypoints {
                points: vec![[0.0; 3], [0.0, 0.0, 3.0]],
                ..Waypoints::default()
            }),
        ),
    ];
    for (key, curve) in curves {
        refused(
            |scenario, _, _| {
                scenario.vehicle.initial.position = [0.0; 3];
                scenario.path.curve = curve;
            },
            key,
            "the path lies 3.0 m below the ground",
            "z points down",
        );
    }
    let above = problems(|scenario, _, _| scenario.path.curve = hover([0.0, 0.0, -3.0]));
    assert_eq!(above, []);
}

fn hover(position: [f64; 3]) -> Curve {
    Curve::Hover(Hover { position })
}
