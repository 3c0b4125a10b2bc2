//! Errors of the filter against those of PX4's EKF2 on the same flights.

use shared_types::gnss::FixKind;

use super::rig::{Flight, Flown, unchanged};

/// A row: flights of a seed, and the velocity (cm/s) and attitude (mrad) of EKF2, the best of two tunings: medians of 20 seeds, which
/// `ekf2/run.sh` prints.
type Row = (fn(u64) -> Flight, f64, f64);

const ROWS: [Row; 4] = [
    (|seed| Flight::modelled(seed, FixKind::RtkFixed), 2.4, 5.1),
    (
        |seed| Flight::modelled(seed, FixKind::RtkFixed).shaken(10.0),
        10.7,
        18.8,
    ),
    (|seed| Flight::modelled(seed, FixKind::RtkFloat), 4.6, 8.5),
    (|seed| Flight::modelled(seed, FixKind::SinglePoint), 8.7, 12.0),
];

#[test]
fn velocity_and_attitude_err_less_than_those_of_ekf2() {
    for (number, (flight, velocity, attitude)) in ROWS.into_iter().enumerate() {
        for seed in 1..=3 {
            let mut flight = flight(seed);
            flight.gnss.latency = [0.1; 2];
            let figures = Flown::new(&flight, &flight.parameters(), unchanged).figures(50.0);
            let (own_velocity, own_attitude) = (100.0 * figures.velocity, 1000.0 * figures.attitude);
            assert!(
                own_velocity <= velocity && own_attitude <= attitude,
                "row {number}, seed {seed}: {own_velocity} cm/s of {velocity}, {own_attitude} mrad of {attitude}"
            );
        }
    }
}
