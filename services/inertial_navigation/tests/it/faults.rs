//! Faults of the sensors in flight.

use inertial_navigation::{InertialFilter, Parameters, Source};
use nalgebra::Vector3;
use shared_types::gnss::FixKind;

use super::rig::{Event, Flight, Flown, H, H_NS, give};

/// Flies with RTK and events that `change` may alter or drop, given the time of their arrival in s.
fn flown_with(change: impl Fn(&mut Event, f64) -> bool) -> Flown {
    let flight = Flight::modelled(3, FixKind::RtkFixed);
    let mut ticks = 0;
    Flown::new(&flight, &flight.parameters(), |event| {
        ticks += u64::from(matches!(event, Event::Imu(_)));
        change(event, ticks as f64 * H)
    })
}

fn within(time: f64, from: f64, to: f64) -> bool {
    (from..to).contains(&time)
}

#[test]
fn a_step_of_multipath_with_unchanged_accuracy_is_refused() {
    for step in [0.5, 3.0] {
        let flown = flown_with(|event, time| {
            if let Event::Fix(fix) = event
                && within(time, 60.0, 65.0)
            {
                fix.position_world.x += step;
            }
            true
        });
        let [position, velocity, attitude] = flown.largest(60.0, 110.0);
        assert!(
            position < 0.2 && velocity < 0.1 && attitude < 0.02,
            "{position} {velocity} {attitude}"
        );
        assert!(flown.filter.source(Source::FixPosition).refused >= 49);
        assert_eq!(flown.filter.resets(), (0, Vector3::zeros()));
    }
}

#[test]
fn a_step_that_stays_is_accepted_after_seven_seconds_and_its_jump_is_stated() {
    let flown = flown_with(|event, time| {
        if let Event::Fix(fix) = event
            && time > 60.0
        {
            fix.position_world.x += 3.0;
        }
        true
    });
    let [before, ..] = flown.largest(60.0, 66.5);
    assert!(before < 0.3, "{before}");
    let (resets, jump) = flown.filter.resets();
    assert_eq!(resets, 1);
    assert!((jump - Vector3::new(3.0, 0.0, 0.0)).norm() < 0.3, "{jump}");
    assert!((flown.errors.last().unwrap().1.position.x + 3.0).abs() < 0.1);
}

#[test]
fn without_fixes_the_motion_is_that_of_the_inertial_measurement_unit() {
    let flown = flown_with(|event, time| !(matches!(event, Event::Fix(_)) && within(time, 60.0, 70.0)));
    let [position, velocity, attitude] = flown.largest(60.0, 70.0);
    assert!(
        position < 1.0 && velocity < 0.25 && attitude < 0.02,
        "{position} {velocity} {attitude}"
    );
    let [after, ..] = flown.largest(71.0, 110.0);
    assert!(after < 0.1, "{after}");
}

#[test]
fn the_age_of_the_last_fix_is_stated() {
    let flown = flown_with(|event, time| !(matches!(event, Event::Fix(_)) && time > 100.0));
    let age = flown.filter.without_fix_for().unwrap();
    assert!((age - 9.9).abs() < 0.2, "{age}");
}

#[test]
fn a_change_of_the_kind_of_fixes_is_followed() {
    for kind in [FixKind::RtkFloat, FixKind::SinglePoint] {
        let flown = flown_with(|event, time| {
            if let Event::Fix(fix) = event
                && time > 60.0
            {
                let [horizontal, vertical, speed] =
                    shared_types::gnss::FixErrors::TYPICAL[kind as usize].deviations();
                fix.kind = kind;
                fix.accuracies = [std::f64::consts::SQRT_2 * horizontal, vertical, speed];
                fix.position_world += Vector3::new(0.3, -0.2, 0.1) * horizontal / 0.2;
            }
            true
        });
        // The new error is no motion.
        let [_, velocity, attitude] = flown.largest(60.0, 62.0);
        assert!(velocity < 0.1 && attitude < 0.02, "{velocity} {attitude}");
        assert_eq!(flown.filter.source(Source::FixPosition).resets, 0);
    }
}

#[test]
fn a_fix_later_than_the_horizon_is_refused() {
    let flown = flown_with(|event, time| {
        if let Event::Fix(fix) = event
            && within(time, 60.0, 62.0)
        {
            fix.time_ns -= 1_000_000_000;
        }
        true
    });
    assert!((20..=21).contains(&flown.filter.source(Source::FixPosition).unusable));
    let [position, ..] = flown.largest(60.0, 110.0);
    assert!(position < 0.15, "{position}");
}

#[test]
fn a_magnetic_disturbance_leaves_the_heading() {
    let flown = flown_with(|event, time| {
        if let Event::Field(field) = event
            && within(time, 60.0, 65.0)
        {
            field.field_body += Vector3::new(0.05, 0.08, 0.0);
        }
        true
    });
    let [.., attitude] = flown.largest(60.0, 110.0);
    assert!(attitude < 0.02, "{attitude}");
    assert!(flown.filter.source(Source::Field).refused >= 240);
}

#[test]
fn a_dead_magnetometer_or_barometer_in_flight_costs_little() {
    for is_magnetometer in [true, false] {
        let flown = flown_with(|event, time| match event {
            Event::Field(_) => !is_magnetometer || time < 60.0,
            Event::Altitude(_) => is_magnetometer || time < 60.0,
            _ => true,
        });
        let [position, velocity, attitude] = flown.largest(60.0, 110.0);
        assert!(
            position < 0.1 && velocity < 0.1 && attitude < 0.02,
            "{position} {velocity} {attitude}"
        );
    }
}

#[test]
fn an_offset_of_the_barometer_is_estimated_and_not_followed() {
    let flown = flown_with(|event, time| {
        if let Event::Altitude(altitude) = event
            && time > 60.0
        {
            altitude.altitude += 5.0;
        }
        true
    });
    let [position, velocity, _] = flown.largest(60.0, 110.0);
    assert!(position < 0.1 && velocity < 0.1, "{position} {velocity}");
    assert_eq!(flown.filter.source(Source::Altitude).resets, 1);
}

#[test]
fn a_gap_and_clipping_of_the_inertial_measurement_unit_are_survived() {
    let flown = flown_with(|event, time| {
        if let Event::Imu(sample) = event {
            if within(time, 70.0, 70.02) {
                sample.force_body.x = 157.0;
                sample.is_clipped = true;
            }
            return !within(time, 60.0, 60.02);
        }
        true
    });
    let [_, velocity, _] = flown.largest(60.0, 62.0);
    assert!(velocity < 0.3, "{velocity}");
    let [position, velocity, attitude] = flown.largest(75.0, 110.0);
    assert!(
        position < 0.1 && velocity < 0.1 && attitude < 0.03,
        "{position} {velocity} {attitude}"
    );
}

#[test]
fn numbers_that_are_not_finite_change_nothing() {
    let flown = flown_with(|event, time| {
        if within(time, 60.0, 60.5) {
            match event {
                Event::Fix(fix) => fix.velocity_world.y = f64::NAN,
                Event::Field(field) => field.field_body.x = f64::INFINITY,
                Event::Altitude(altitude) => altitude.altitude = f64::NAN,
                Event::Imu(sample) if within(time, 60.2, 60.21) => sample.rate_body.z = f64::NAN,
                _ => {}
            }
        }
        true
    });
    let [position, velocity, attitude] = flown.largest(60.0, 110.0);
    assert!(
        position < 0.1 && velocity < 0.1 && attitude < 0.02,
        "{position} {velocity} {attitude}"
    );
}

#[test]
fn an_antenna_that_is_not_at_the_centre_leaves_no_error() {
    let antenna_body = Vector3::new(0.1, -0.1, -0.2);
    let mut flight = Flight::modelled(3, FixKind::RtkFixed);
    flight.gnss.antenna_body = antenna_body;
    let parameters = Parameters {
        antenna_body,
        ..flight.parameters()
    };
    let right = Flown::new(&flight, &parameters, |_| true).figures(50.0);
    let wrong = Flown::new(&flight, &flight.parameters(), |_| true).figures(50.0);
    assert!(right.position < 0.025 && right.velocity < 0.025, "{right:?}");
    assert!(wrong.position > 0.15, "{wrong:?}");
}

#[test]
fn a_vehicle_at_rest_without_fixes_stays_where_it_is() {
    let mut flight = Flight::modelled(3, FixKind::RtkFixed);
    flight.duration = 18.0;
    let mut filter = InertialFilter::new(&flight.parameters());
    let mut tick = 0;
    for event in flight.flown().1 {
        tick += u64::from(matches!(event, Event::Imu(_)));
        if !(matches!(event, Event::Fix(_)) && tick as f64 * H > 5.0) {
            give(&mut filter, &event, tick * H_NS);
        }
    }
    let motion = filter.motion().unwrap();
    assert!(
        motion.position_world.norm() < 0.05 && motion.velocity_world.norm() < 0.01,
        "{motion:?}"
    );
}

#[test]
fn silence_between_two_refused_fixes_is_not_a_source_that_is_refused() {
    let flown = flown_with(|event, time| {
        if let Event::Fix(fix) = event {
            if within(time, 60.0, 60.1) || within(time, 67.4, 67.5) {
                fix.position_world.x += 30.0;
                return true;
            }
            return !within(time, 60.1, 67.4);
        }
        true
    });
    let status = flown.filter.source(Source::FixPosition);
    assert!(
        status.resets == 0 && (2..10).contains(&status.refused),
        "{status:?}"
    );
    let [position, ..] = flown.largest(70.0, 110.0);
    assert!(position < 0.15, "{position}");
}

#[test]
fn a_fix_that_is_valid_within_a_gap_is_fused() {
    // The gap is in a turn, of which the sample after it shows only the end.
    let refused = |flown: &Flown| {
        [Source::FixPosition, Source::FixVelocity].map(|source| flown.filter.source(source).refused)
    };
    let without = refused(&flown_with(|_, _| true));
    for at in [60.0, 61.0, 62.0, 63.0] {
        let flown =
            flown_with(|event, time| !(matches!(event, Event::Imu(_)) && within(time, at + 0.05, at + 0.45)));
        assert_eq!(refused(&flown), without, "gap at {at} s");
    }
}
