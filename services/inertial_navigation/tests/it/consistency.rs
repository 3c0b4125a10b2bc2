//! Consistency of the filter: flights with exactly the errors that it models.

use inertial_navigation::Source;
use inertial_navigation::error_state::{ATTITUDE, Covariance, POSITION, VELOCITY};
use nalgebra::{SMatrix, SVector};
use shared_types::gnss::FixKind;

use super::rig::{Event, Flight, Flown, H_NS, give, unchanged};

/// Number of flights.
const SEEDS: u64 = 20;

#[test]
fn innovations_of_every_source_have_the_filters_covariance() {
    let outdoors: fn(u64) -> Flight = |seed| Flight::modelled(seed, FixKind::RtkFixed);
    let single: fn(u64) -> Flight = |seed| Flight::modelled(seed, FixKind::SinglePoint);
    let seen: fn(u64) -> Flight = |seed| Flight::modelled(seed, FixKind::RtkFixed).seen();
    let two_antennas: fn(u64) -> Flight =
        |seed| Flight::modelled(seed, FixKind::RtkFixed).with_two_antennas();
    for (name, flight, has_fixes) in [
        ("RTK", outdoors, true),
        ("RTK and two antennas", two_antennas, true),
        ("single point", single, true),
        ("RTK and cameras", seen, true),
        ("cameras", seen, false),
    ] {
        let mut squares = [const { Vec::new() }; Source::ALL.len()];
        for seed in 1..=SEEDS {
            let flight = flight(seed);
            let flown = Flown::new(&flight, &flight.parameters(), |event| {
                has_fixes || !matches!(event, Event::Fix(_))
            });
            for (squares, innovations) in squares.iter_mut().zip(flown.innovations) {
                squares.extend(innovations.iter().map(|(_, square)| *square));
            }
        }
        // The velocity of a vehicle at rest has no noise: its standard deviation is a choice.
        let judged = Source::ALL
            .into_iter()
            .filter(|source| *source != Source::ZeroVelocity && !squares[*source as usize].is_empty());
        for source in judged {
            let freedom = if source == Source::Altitude { 1.0 } else { 3.0 };
            let squares = &squares[source as usize];
            let count = squares.len() as f64;
            let mean = squares.iter().sum::<f64>() / count;
            // 95 % of the means of as many independent squares of χ².
            let width = 1.96 * (2.0 * freedom / count).sqrt();
            println!("{name}, {source:?}: {mean:.3} of {freedom} ± {width:.3}, {count} innovations");
            assert!(
                (mean - freedom).abs() < width,
                "{name}, {source:?}: {mean}, {freedom} ± {width}"
            );
        }
    }
}

/// The error of position, velocity and attitude, against its covariance: 9 degrees of freedom.
#[test]
fn the_squared_error_of_the_motion_is_that_of_the_covariance() {
    let mut squares = Vec::new();
    for seed in 1..=2 * SEEDS {
        let flight = Flight {
            duration: 60.0,
            ..Flight::modelled(seed, FixKind::RtkFixed)
        };
        let flown = Flown::new(&flight, &flight.parameters(), unchanged);
        let horizon = flown.filter.horizon().unwrap();
        let at = usize::try_from(horizon.time_ns / H_NS).unwrap();
        let truth = &flown.truths[at];
        let motion = &horizon.kinematics;
        let error = super::rig::Errors::new(
            truth,
            motion.position_world,
            motion.velocity_world,
            &motion.world_from_body,
        );
        let mut vector = SVector::<f64, 9>::zeros();
        for (row, part) in [
            (POSITION, error.position),
            (VELOCITY, error.velocity),
            (ATTITUDE, error.attitude),
        ] {
            vector.fixed_rows_mut::<3>(row).copy_from(&part);
        }
        let covariance: SMatrix<f64, 9, 9> = horizon.covariance.fixed_view::<9, 9>(0, 0).into();
        squares.push(vector.dot(&covariance.cholesky().unwrap().solve(&vector)));
    }
    let count = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / count;
    let width = 1.96 * (2.0 * 9.0 / count).sqrt();
    println!("{mean:.2} of 9 ± {width:.2}");
    assert!((mean - 9.0).abs() < width, "{mean}, 9 ± {width}");
}

#[test]
fn the_covariance_stays_symmetric_and_positive_definite_whatever_is_lost() {
    let mut flight = Flight::with_all_errors(5, FixKind::SinglePoint);
    flight.duration = 60.0;
    let mut filter = inertial_navigation::InertialFilter::new(&flight.parameters());
    let mut tick = 0;
    for event in flight.flown().1 {
        tick += u64::from(matches!(event, Event::Imu(_)));
        let time = tick as f64 * 0.004;
        let is_lost = match event {
            Event::Fix(_) => (30.0..45.0).contains(&time),
            Event::Field(_) => (35.0..50.0).contains(&time),
            Event::Imu(_) => (40.0..40.1).contains(&time),
            _ => false,
        };
        if is_lost {
            continue;
        }
        give(&mut filter, &event, tick * H_NS);
        let Some(horizon) = filter.horizon() else { continue };
        if tick % 25 == 0 {
            let covariance: &Covariance = &horizon.covariance;
            assert_eq!(*covariance, covariance.transpose());
            assert!(covariance.cholesky().is_some(), "at {time} s");
        }
    }
}
