//! Sections of the laboratory rig in a scenario.

use super::{NOWHERE, assert_only};
use crate::tests_support::rig;
use crate::{
    Actuators, Cameras, Dryden, Fan, FanMove, MarkerSwap, Model, Occlusion, Problem, RateCommand, RcLink,
    Scenario, Vector, VehicleChange, Wind, YawStep,
};

/// The problems of the flight in the laboratory after it has been spoilt.
fn problems(spoil: impl FnOnce(&mut Scenario)) -> Vec<Problem> {
    let mut scenario = rig();
    spoil(&mut scenario);
    scenario.problems()
}

#[track_caller]
fn refused(spoil: impl FnOnce(&mut Scenario), key: &str, reason: &str, fix: &str) {
    assert_only(&problems(spoil), key, reason, fix);
}

#[track_caller]
fn accepted(spoil: impl FnOnce(&mut Scenario)) {
    assert_eq!(problems(spoil), []);
}

fn actuators(scenario: &mut Scenario) -> &mut Actuators {
    scenario.vehicle.actuators.as_mut().unwrap()
}

fn fan(scenario: &mut Scenario) -> &mut Fan {
    scenario.vehicle.fan.as_mut().unwrap()
}

fn cameras(scenario: &mut Scenario) -> &mut Cameras {
    scenario.cameras.as_mut().unwrap()
}

fn link(scenario: &mut Scenario) -> &mut RcLink {
    scenario.rc_output.as_mut().unwrap()
}

fn model(scenario: &mut Scenario) -> &mut Model {
    scenario.model.as_mut().unwrap()
}

fn rates(scenario: &mut Scenario) -> &mut RateCommand {
    scenario.controller.rates.as_mut().unwrap()
}

/// A number of a scenario and its place.
type Number = (&'static str, fn(&mut Scenario) -> &mut f64);

#[test]
fn a_flight_in_the_laboratory_has_no_problem() {
    accepted(|_| ());
}

#[test]
fn a_centre_of_mass_outside_of_the_vehicle_is_refused() {
    let (key, reason, fix) = (
        "vehicle.center_of_mass",
        "lies 0.5 m from the origin",
        "less than 0.5 m away",
    );
    refused(|s| s.vehicle.center_of_mass = [0.3, 0.0, -0.4], key, reason, fix);
    let changed = |s: &mut Scenario| s.vehicle.change[0].center_of_mass = Some([0.0, 5.0, 0.0]);
    let key = "vehicle.change.0.center_of_mass";
    refused(changed, key, "lies 5.0 m from the origin", fix);
    accepted(|s| s.vehicle.center_of_mass = [0.28, 0.0, -0.4]);
}

#[test]
fn a_change_of_the_centre_of_mass_alone_is_a_change() {
    accepted(|scenario| {
        scenario.vehicle.change[0] = VehicleChange {
            at: 30.0,
            mass: None,
            inertia: None,
            disturbance: None,
            center_of_mass: Some([0.01, 0.0, 0.0]),
        }
    });
}

#[test]
fn a_thrust_at_the_start_above_the_largest_is_refused() {
    let key = "vehicle.actuators.initial_thrust";
    let reason = "5.6 N is above the maximum of 5.5 N";
    let fix = "lower `initial_thrust`";
    refused(|s| actuators(s).initial_thrust = 5.6, key, reason, fix);
    accepted(|scenario| actuators(scenario).initial_thrust = 5.5);
}

#[test]
fn motors_that_cannot_hold_the_vehicle_are_refused() {
    // The vehicle of 0.245 kg in b = [0.3, 0.2, 0.1] takes 0.245 |[0.3, 0.2, 9.91]| = 2.42956 N.
    for most in [2.0, 2.429] {
        refused(
            |scenario| actuators(scenario).thrust_max = most,
            "vehicle.actuators.thrust_max",
            &format!(
                "it takes 2.42956 N to hold the vehicle in the air, but its largest thrust is {most:?} N"
            ),
            "raise `thrust_max` above 2.42956",
        );
    }
    accepted(|scenario| actuators(scenario).thrust_max = 2.43);
}

#[test]
fn a_link_that_cannot_ask_for_the_thrust_to_hover_is_refused() {
    // The paper's range: the lighter vehicle takes 0.2 |[0.3, 0.2, 9.91]| = 1.98331 N.
    refused(
        |scenario| link(scenario).thrust_range = [0.0, 1.0],
        "rc_output.thrust_range",
        "1.98331 N must be commanded to hold the vehicle in the air, but the thrust channel reaches from 2.3071 N to 5.4451 N",
        "the paper's numbers need [-1.0, 1.0]",
    );
    let key = "rc_output.thrust_range";
    let reason = "1.98331 N must be commanded";
    let fix = "another `thrust_offset` and `thrust_slope`";
    refused(|s| link(s).thrust_slope = 0.1, key, reason, fix);
    refused(
        |scenario| link(scenario).thrust_range = [-1.0, 0.0],
        "rc_output.thrust_range",
        "2.42956 N must be commanded to hold the vehicle in the air, but the thrust channel reaches from 0.0 N to 2.3071 N",
        "widen `thrust_range`",
    );
    // A vehicle that gives half of what is asked for must be asked for twice as much.
    refused(
        |scenario| {
            actuators(scenario).thrust_factor = 0.4;
        },
        "rc_output.thrust_range",
        "6.07389 N must be commanded",
        "widen `thrust_range`",
    );
}

#[test]
fn a_fan_that_is_switched_off_before_it_is_on_is_refused() {
    for off_at in [20.0, 10.0] {
        refused(
            |scenario| fan(scenario).off_at = Some(off_at),
            "vehicle.fan.off_at",
            &format!("switched off at {off_at:?} s, but not on before 20.0 s"),
            "raise `off_at`",
        );
    }
    accepted(|scenario| fan(scenario).off_at = None);
}

/// A wind with Dryden's gusts about a mean.
fn blow(scenario: &mut Scenario, mean: Vector) {
    scenario.vehicle.drag = [0.06; 3];
    let (deviation, length) = ([0.5; 3], [2.0; 3]);
    let dryden = Some(Dryden { deviation, length });
    let wind = scenario.vehicle.wind.insert(Wind::default());
    (wind.mean, wind.dryden) = (mean, dryden);
}

#[test]
fn air_that_blows_nowhere_is_refused() {
    for nowhere in NOWHERE {
        let (reason, fix) = ("has no direction", "such as [1.0, 0.0, 0.0]");
        refused(
            |s| fan(s).direction = nowhere,
            "vehicle.fan.direction",
            reason,
            fix,
        );
        let key = "vehicle.fan.moves.1.direction";
        refused(|s| fan(s).moves[1].direction = nowhere, key, reason, fix);
        refused(|s| blow(s, nowhere), "vehicle.wind.mean", "need a mean wind", fix);
    }
    accepted(|s| fan(s).direction = [0.0, 2e-9, 0.0]);
    accepted(|s| blow(s, [0.0, 2e-9, 0.0]));
}

#[test]
fn a_fan_that_is_moved_at_the_start_is_refused() {
    let key = "vehicle.fan.moves.0.at";
    let reason = "moves at 0.0 s, when it is at `position`";
    let fix = "as the fan's `position` and `direction`";
    refused(|s| fan(s).moves[0].at = 0.0, key, reason, fix);
}

/// Events in flight: key, and a change that sets two times in s.
type Happenings = (&'static str, &'static str, fn(&mut Scenario, [f64; 2]));

const HAPPENINGS: [Happenings; 4] = [
    ("vehicle.fan.moves", "move", |scenario, times| {
        let place = |at| FanMove {
            at,
            position: [0.0; 3],
            direction: [1.0, 0.0, 0.0],
        };
        fan(scenario).moves = times.map(place).to_vec();
    }),
    ("path.yaw_step", "yaw step", |scenario, times| {
        scenario.path.yaw_step = times.map(|at| YawStep { at, yaw: 0.1 }).to_vec();
    }),
    ("cameras.occlusion", "occlusion", |scenario, times| {
        cameras(scenario).occlusion = times.map(|at| Occlusion { at, lasts: 0.5 }).to_vec();
    }),
    ("cameras.marker_swap", "marker swap", |scenario, times| {
        let swap = |at| MarkerSwap {
            at,
            lasts: 0.5,
            position: [0.1; 3],
            rotation: [0.0; 3],
        };
        cameras(scenario).marker_swap = times.map(swap).to_vec();
    }),
];

#[test]
fn events_lie_within_the_flight_and_in_order() {
    for (key, one, happen_at) in HAPPENINGS {
        let second = format!("{key}.1.at");
        refused(
            |scenario| happen_at(scenario, [59.0, 60.5]),
            &second,
            &format!("the {one} at 60.5 s comes after the end of the flight at 60.0 s"),
            "raise `duration`",
        );
        refused(
            |scenario| happen_at(scenario, [30.0, 20.0]),
            &second,
            &format!("the {one} at 20.0 s is listed after the one at 30.0 s"),
            &format!("put the {one}s in the order"),
        );
        refused(
            |scenario| happen_at(scenario, [30.0, 30.0]),
            &second,
            &format!("two {one}s happen at 30.0 s"),
            "merge them into one",
        );
        refused(
            |scenario| happen_at(scenario, [20.0, 20.5005]),
            &second,
            "20.5005 s is not a whole number of base ticks of 0.001 s",
            "use 20.5 or 20.501",
        );
        accepted(|scenario| happen_at(scenario, [59.0, 60.0]));
        accepted(|scenario| happen_at(scenario, [0.1, 0.6]));
    }
}

#[test]
fn a_fan_is_switched_within_the_flight_at_whole_ticks() {
    let reason = "switching the fan off at 61.0 s comes after the end";
    let (off_at, fix) = ("vehicle.fan.off_at", "raise `duration`");
    refused(|s| fan(s).off_at = Some(61.0), off_at, reason, fix);
    let late = |s: &mut Scenario| (fan(s).on_at, fan(s).off_at) = (61.0, None);
    let reason = "switching the fan on at 61.0 s comes after the end";
    refused(late, "vehicle.fan.on_at", reason, fix);
    for (key, set) in [
        (
            "vehicle.fan.on_at",
            (|fan| &mut fan.on_at) as fn(&mut Fan) -> &mut f64,
        ),
        ("vehicle.fan.off_at", |fan| fan.off_at.as_mut().unwrap()),
    ] {
        refused(
            |scenario| *set(fan(scenario)) = 20.7005,
            key,
            "is not a whole number of base ticks",
            "use 20.7 or 20.701",
        );
    }
}

#[test]
fn an_event_during_another_is_refused() {
    for (key, one, happen_at) in &HAPPENINGS[2..] {
        refused(
            |scenario| happen_at(scenario, [20.0, 20.4]),
            &format!("{key}.1.at"),
            &format!("the {one} at 20.4 s begins before the one at 20.0 s ends at 20.5 s"),
            "or shorten the earlier",
        );
    }
}

#[test]
fn durations_are_whole_ticks() {
    let lengths: &[Number] = &[
        ("cameras.occlusion.0.lasts", |s| {
            &mut cameras(s).occlusion[0].lasts
        }),
        ("cameras.marker_swap.0.lasts", |s| {
            &mut cameras(s).marker_swap[0].lasts
        }),
    ];
    for (key, length) in lengths {
        refused(
            |scenario| *length(scenario) = 0.2005,
            key,
            "0.2005 s is not a whole number of base ticks",
            "use 0.2 or 0.201",
        );
    }
}

#[test]
fn an_occlusion_may_last_longer_than_the_filter_coasts_and_beyond_the_end() {
    accepted(|scenario| cameras(scenario).occlusion[1].lasts = 50.0);
}

#[test]
fn a_marker_swap_of_nothing_is_refused() {
    refused(
        |scenario| {
            let swap = &mut cameras(scenario).marker_swap[1];
            (swap.position, swap.rotation) = ([0.0; 3], [0.0; 3]);
        },
        "cameras.marker_swap.1",
        "the marker swap changes nothing",
        "or leave the marker swap out",
    );
    accepted(|scenario| cameras(scenario).marker_swap[1].position = [0.0; 3]);
}

#[test]
fn jitter_beyond_the_frame_before_is_refused() {
    let reason = "exposed up to 0.011 s early, but their period is 0.01 s";
    let fix = "lower `jitter` to 0.01 or less";
    refused(|s| cameras(s).jitter = 0.011, "cameras.jitter", reason, fix);
    accepted(|scenario| cameras(scenario).jitter = 0.01);
    accepted(|scenario| {
        scenario.schedule.period.insert("mocap/pose".to_owned(), 0.02);
        cameras(scenario).jitter = 0.02;
    });
}

#[test]
fn an_empty_range_is_refused() {
    for range in [[1.0, -1.0], [0.5, 0.5]] {
        let reason = format!(
            "from {:?} to {:?} is not a range of a channel",
            range[0], range[1]
        );
        for key in ["rc_output.thrust_range", "rc_output.rate_range"] {
            refused(
                |scenario| match key {
                    "rc_output.rate_range" => link(scenario).rate_range = range,
                    _ => link(scenario).thrust_range = range,
                },
                key,
                &reason,
                "both from -1.0 to 1.0",
            );
        }
    }
}

#[test]
fn rate_channels_that_turn_one_way_only_are_refused() {
    for range in [[0.0, 1.0], [-1.0, 0.0], [0.2, 0.8]] {
        let (key, reason) = ("rc_output.rate_range", "the vehicle cannot turn both ways");
        refused(|s| link(s).rate_range = range, key, reason, "with 0 inside");
    }
}

#[test]
fn a_link_that_cannot_pull_is_refused() {
    let key = "rc_output.thrust_range";
    let reason = "no travel of the thrust channel commands a thrust above 0 N";
    let fix = "check `thrust_offset`";
    refused(|s| link(s).thrust_offset = -4.0, key, reason, fix);
}

#[test]
fn a_range_without_a_step_of_the_link_is_refused() {
    let bits = |scenario: &mut Scenario, bits| {
        (link(scenario).resolution, link(scenario).rate_range) = (bits, [-0.3, 0.3]);
    };
    let reason = "the range is 0.6 wide, less than one of the steps of 0.666667";
    refused(
        |s| bits(s, 2),
        "rc_output.rate_range",
        reason,
        "raise `resolution`",
    );
    accepted(|s| bits(s, 3));
}

#[test]
fn modelled_latencies_are_whole_ticks() {
    for (key, set) in [
        (
            "model.radio_latency",
            (|model, time| model.radio_latency = time) as fn(&mut Model, f64),
        ),
        ("model.capture_latency", |model, time| {
            model.capture_latency = Some(time);
        }),
    ] {
        refused(
            |scenario| set(model(scenario), 0.0055),
            key,
            "0.0055 s is not a whole number of base ticks",
            "use 0.005 or 0.006",
        );
        accepted(|scenario| set(model(scenario), 0.0));
        accepted(|scenario| set(model(scenario), 0.2));
    }
}

#[test]
fn a_roll_out_that_does_not_fill_the_hold_is_refused() {
    let held = "0.0015 s does not divide the 0.022 s for which a command is held";
    for (step, reason, fix) in [
        (0.0015, held, "use 0.00146667"),
        (0.05, "0.05 s does not divide the 0.022 s", "use 0.022"),
        (0.00001, "2200.0 steps for one command", "to 2.2e-5 or more"),
    ] {
        let key = "controller.rates.roll_out_step";
        refused(|scenario| rates(scenario).roll_out_step = step, key, reason, fix);
    }
    for parts in [1.0, 3.0, 7.0, 22.0, 1000.0] {
        accepted(|scenario| rates(scenario).roll_out_step = 0.022 / parts);
    }
}

#[test]
fn body_rates_need_a_vehicle_that_follows_them_a_model_and_a_filter() {
    let key = "controller.rates";
    let no_loop = "the vehicle has no rate loop that follows them";
    refused(
        |s| s.vehicle.actuators = None,
        key,
        no_loop,
        "add `[vehicle.actuators]`",
    );
    let no_model = "by a model of the vehicle, but there is none";
    refused(|s| s.model = None, key, no_model, "add `[model]`");
    let no_filter = "needs a thrust and an acceleration that only a filter estimates";
    refused(|s| s.estimator = None, key, no_filter, "add `[estimator.kalman]`");
}

#[test]
fn sections_for_body_rates_are_refused_with_a_controller_of_torque() {
    let mut scenario = rig();
    scenario.controller.rates = None;
    let mut refused = |leave_out: fn(&mut Scenario), key, reason, fix| {
        assert_only(&scenario.problems(), key, reason, fix);
        leave_out(&mut scenario);
    };
    let reason = "the vehicle's rate loop follows body rates, but the controller commands torque";
    let fix = "add `[controller.rates]`";
    refused(|s| s.vehicle.actuators = None, "vehicle.actuators", reason, fix);
    let (reason, fix) = (
        "the radio link carries body rates, but",
        "or leave `rc_output` out",
    );
    refused(|s| s.rc_output = None, "rc_output", reason, fix);
    let reason = "the filter predicts by the body rates of the frames, but";
    refused(
        |s| s.estimator = None,
        "estimator",
        reason,
        "or leave `estimator` out",
    );
    let (reason, fix) = ("these cameras measure poses only", "or leave `cameras` out");
    refused(|_| (), "cameras", reason, fix);
}

#[test]
fn each_imperfection_can_be_left_out() {
    // Perfect cameras in front of the filter give the period of the filter alone.
    accepted(|scenario| scenario.cameras = None);
    accepted(|scenario| scenario.rc_output = None);
    accepted(|scenario| scenario.vehicle.turbulence = None);
    accepted(|scenario| scenario.vehicle.fan = None);
    accepted(|scenario| scenario.controller.observer_gain = None);
    accepted(|scenario| scenario.schedule = Default::default());
}
