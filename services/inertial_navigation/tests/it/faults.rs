//! Faults of the sensors in flight.

use inertial_navigation::{InertialFilter, Parameters, Source};
use nalgebra::Vector3;
use shared_types::gnss::FixKind;
use shared_types::noise::{Noise, Stream};

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

/// Flies with RTK and cameras in the same way.
fn seen_with(change: impl Fn(&mut Event, f64) -> bool) -> Flown {
    let flight = Flight::modelled(3, FixKind::RtkFixed).seen();
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
    let age = flown.filter.without_position_for().unwrap();
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

#[test]
fn indoors_the_vehicle_flies_by_inertia_where_the_cameras_drop_out() {
    let flown = seen_with(|event, time| match event {
        Event::Fix(_) => false,
        Event::Pose(_) => !within(time, 60.0, 65.0),
        _ => true,
    });
    let [seen, velocity, attitude] = flown.largest(40.0, 60.0);
    assert!(
        seen < 2e-3 && velocity < 0.02 && attitude < 5e-3,
        "{seen} {velocity} {attitude}"
    );
    let [unseen, velocity, _] = flown.largest(60.0, 65.0);
    assert!(unseen < 0.25 && velocity < 0.1, "{unseen} {velocity}");
    let [again, ..] = flown.largest(65.2, 110.0);
    assert!(again < 2e-3, "{again}");
    for source in [Source::PosePosition, Source::PoseAttitude] {
        let status = flown.filter.source(source);
        assert!(
            status.refused * 200 < status.fused && status.resets == 0,
            "{source:?} {status:?}"
        );
    }
}

#[test]
fn fixes_take_over_outside_of_the_cameras_volume_and_poses_back() {
    let is_outside = |time: f64| within(time, 60.0, 80.0);
    let flown = seen_with(|event, time| match event {
        Event::Fix(_) => is_outside(time),
        Event::Pose(_) => !is_outside(time),
        _ => true,
    });
    let [outside, ..] = flown.largest(60.0, 80.2);
    let [inside, ..] = flown.largest(80.4, 110.0);
    assert!(outside < 0.06 && inside < 2e-3, "{outside} {inside}");
    assert_eq!(flown.filter.resets(), (0, Vector3::zeros()));
}

/// Cameras and datum that do not agree: no position jumps to and fro between them.
#[test]
fn fixes_that_contradict_the_cameras_are_refused_as_long_as_these_see_the_vehicle() {
    let flown = seen_with(|event, time| {
        if let Event::Fix(fix) = event
            && time > 30.0
        {
            fix.position_world.x += 2.0;
        }
        !(matches!(event, Event::Pose(_)) && time > 90.0)
    });
    let [seen, ..] = flown.largest(30.0, 90.0);
    assert!(seen < 2e-3, "{seen}");
    let (resets, jump) = flown.filter.resets();
    assert_eq!(resets, 1);
    assert!((jump - Vector3::new(2.0, 0.0, 0.0)).norm() < 0.3, "{jump}");
}

#[test]
fn swapped_markers_are_refused_and_so_is_an_attitude_that_stays_wrong() {
    for axis in [Vector3::z(), Vector3::x()] {
        let flown = seen_with(|event, time| {
            if let Event::Pose(pose) = event {
                if within(time, 60.0, 60.9) {
                    pose.position_world = pose
                        .position_world
                        .map(|place| place + Vector3::new(0.2, 0.0, 0.0));
                }
                if time > 80.0 {
                    let turn = shared_types::rotation::exp(&(axis * 0.2));
                    pose.world_from_body = pose.world_from_body.map(|attitude| turn * attitude);
                }
            }
            !matches!(event, Event::Fix(_))
        });
        let [swapped, ..] = flown.largest(60.0, 62.0);
        let [position, _, attitude] = flown.largest(62.0, 110.0);
        assert!(
            swapped < 0.02 && position < 2e-3 && attitude < 0.03,
            "{swapped} {position} {attitude}"
        );
        assert_eq!(flown.filter.resets().0, 0);
        assert!(flown.filter.source(Source::PoseAttitude).refused > 2_000);
    }
}

#[test]
fn a_pose_with_one_part_is_fused_by_that_part() {
    let flown = seen_with(|event, time| {
        if let Event::Pose(pose) = event {
            if within(time, 40.0, 60.0) {
                pose.world_from_body = None;
            } else if time > 60.0 {
                pose.position_world = None;
            }
        }
        true
    });
    let statuses =
        [Source::PosePosition, Source::PoseAttitude].map(|source| flown.filter.source(source).fused);
    let rate = 1.0 / (3.0 * H);
    let expected = [58.5, 88.5].map(|span| span * rate);
    for (fused, expected) in statuses.into_iter().zip(expected) {
        assert!(
            (f64::from(fused) / expected - 1.0).abs() < 0.02,
            "{fused} {expected}"
        );
    }
}

/// A force that was not there leads the motion astray by 1 m and 0.5 m/s while the cameras see nothing.
#[test]
fn poses_that_find_the_vehicle_elsewhere_after_a_silence_are_accepted_after_a_second() {
    let flown = seen_with(|event, time| {
        if let Event::Imu(sample) = event
            && within(time, 60.0, 65.0)
        {
            sample.force_body.x += 0.1;
        }
        match event {
            Event::Fix(_) => false,
            Event::Pose(_) => !within(time, 60.0, 65.0),
            _ => true,
        }
    });
    let [astray, ..] = flown.largest(64.9, 66.0);
    assert!(astray > 1.0, "{astray}");
    let [position, velocity, _] = flown.largest(66.6, 110.0);
    assert!(position < 5e-3 && velocity < 0.1, "{position} {velocity}");
    assert_eq!(flown.filter.resets().0, 1);
}

#[test]
fn beside_fixes_swapped_markers_are_refused_for_longer() {
    let flown = seen_with(|event, time| {
        if let Event::Pose(pose) = event
            && within(time, 60.0, 66.0)
        {
            pose.position_world = pose
                .position_world
                .map(|place| place + Vector3::new(0.2, 0.0, 0.0));
        }
        true
    });
    let [swapped, ..] = flown.largest(60.0, 67.0);
    assert!(swapped < 0.06, "{swapped}");
    assert_eq!(flown.filter.resets().0, 0);
}

/// Scattered numbers in place of positions for 5 s: as little of them is followed as if no pose came.
#[test]
fn poses_that_scatter_are_never_accepted() {
    for range in [2.0, 8.0] {
        let flown = seen_with(move |event, time| {
            if let Event::Pose(pose) = event
                && within(time, 60.0, 65.0)
            {
                pose.position_world = Some(scattered(range, pose.time_ns));
            }
            !matches!(event, Event::Fix(_))
        });
        let [scattered, velocity, _] = flown.largest(60.0, 65.0);
        assert!(scattered < 0.25 && velocity < 0.1, "{scattered} {velocity}");
        let [again, ..] = flown.largest(66.2, 110.0);
        assert!(again < 5e-3, "{again}");
        assert_eq!(flown.filter.resets().0, 0);
    }
}

/// Beside fixes a wrong pose is never accepted, be it scattered or not, and a right one is at once.
#[test]
fn beside_fixes_no_refused_pose_is_accepted() {
    for is_constant in [true, false] {
        let flown = seen_with(move |event, time| {
            if let Event::Pose(pose) = event
                && within(time, 60.0, 70.0)
            {
                pose.position_world = Some(if is_constant {
                    pose.position_world.unwrap() + Vector3::new(0.5, 0.0, 0.0)
                } else {
                    scattered(2.0, pose.time_ns)
                });
            }
            true
        });
        let [position, velocity, _] = flown.largest(60.0, 70.2);
        assert!(position < 0.06 && velocity < 0.1, "{position} {velocity}");
        let [again, ..] = flown.largest(70.4, 110.0);
        assert!(again < 2e-3, "{again}");
        assert_eq!(flown.filter.resets().0, 0);
    }
}

/// Returns a position with components of up to `range` m, another one at each time.
fn scattered(range: f64, time_ns: u64) -> Vector3<f64> {
    let draws = Noise::new(1, Stream::EdgeGarbage).at(time_ns / H_NS).normal3();
    draws.map(|draw| (draw * range).clamp(-range, range))
}

/// Returns the largest error of the heading from a time to another, s, in a flight beside a magnet from `from` on.
fn heading_beside_a_magnet(has_antennas: bool, from: f64, span: [f64; 2]) -> f64 {
    let flight = Flight::modelled(3, FixKind::RtkFixed).with_two_antennas();
    let mut ticks = 0;
    let flown = Flown::new(&flight, &flight.parameters(), |event| {
        ticks += u64::from(matches!(event, Event::Imu(_)));
        if let Event::Field(field) = event
            && ticks as f64 * H >= from
        {
            field.field_body += Vector3::new(0.05, 0.15, 0.0);
        }
        has_antennas || !matches!(event, Event::Baseline(_))
    });
    let errors = flown
        .errors
        .iter()
        .filter(|(tick, _)| within(*tick as f64 * H, span[0], span[1]));
    errors.fold(0.0, |largest, (tick, errors)| {
        let truth = &flown.truths[usize::try_from(*tick).unwrap()].world_from_body;
        (truth * errors.attitude).z.abs().max(largest)
    })
}

#[test]
fn beside_a_magnet_two_antennas_keep_the_heading() {
    let mut table = Vec::new();
    for (name, from, span) in [
        ("magnet from the start, at rest", 0.0, [10.0, 19.0]),
        ("magnet from the start, in flight", 0.0, [30.0, 110.0]),
        ("magnet from 60 s on, in flight", 60.0, [60.0, 110.0]),
        ("none, at rest", 200.0, [10.0, 19.0]),
        ("none, in flight", 200.0, [30.0, 110.0]),
    ] {
        let [with, without] = [true, false].map(|has| heading_beside_a_magnet(has, from, span));
        println!(
            "{name}: {:.1} mrad with, {:.1} mrad without",
            1e3 * with,
            1e3 * without
        );
        table.push([with, without]);
    }
    for [with, without] in &table {
        assert!(*with < 0.02 && with < without, "{with} {without}");
    }
    assert!(table[0][1] > 0.3, "{table:?}");
}

/// Wrong numbers of carrier waves along the baseline make another length, and a baseline that scatters is no second time the same. One
/// across it is refused by the gate alone, and not taken in the air.
#[test]
fn wrong_baselines_are_refused_and_right_ones_fused_at_once() {
    type Wrong = fn(u64) -> Vector3<f64>;
    let wrongs: [Wrong; 5] = [
        |_| Vector3::new(0.2, -0.19, 0.0),
        |_| Vector3::new(0.0, 0.19, 0.0),
        |time_ns| scattered(0.3, time_ns),
        |time_ns| scattered(1.0, time_ns),
        |time_ns| scattered(2.0, time_ns),
    ];
    for wrong in wrongs {
        let flight = Flight::modelled(3, FixKind::RtkFixed).with_two_antennas();
        let mut ticks = 0;
        let flown = Flown::new(&flight, &flight.parameters(), |event| {
            ticks += u64::from(matches!(event, Event::Imu(_)));
            if let Event::Baseline(baseline) = event
                && within(ticks as f64 * H, 60.0, 75.0)
            {
                baseline.baseline_world += wrong(baseline.time_ns);
            }
            true
        });
        let [.., attitude] = flown.largest(30.0, 110.0);
        assert!(attitude < 0.02, "{attitude}");
        let status = flown.filter.source(Source::Baseline);
        assert!((140..160).contains(&status.refused), "{status:?}");
        assert!(status.resets == 0 && status.fused > 900, "{status:?}");
    }
}
