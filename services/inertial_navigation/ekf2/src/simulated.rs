//! Simulated flights.

use shared_types::gnss::FixKind;

use crate::reference::{Noises, Reference};
use crate::rig::{Errors, Event, Figures, Flight, Flown, H, unchanged};

/// Time from which errors count, s.
const FROM: f64 = 50.0;
/// Latency of fixes, s.
const LATENCY: f64 = 0.1;

/// End of the name of a row with errors that neither filter models.
const UNMODELLED: &str = "all errors";

/// A row of the table: its name, its flights, and the noises with which EKF2 may fly them. Rows with errors that neither filter
/// models are for information.
type Row = (&'static str, fn(u64) -> Flight, Vec<(&'static str, Noises)>);

fn rows() -> Vec<Row> {
    let rtk = Noises {
        position: 0.01,
        ..Noises::DEFAULT
    };
    let matched = Noises {
        velocity: 0.06,
        height_of_fixes: true,
        ..rtk
    };
    let tunings = vec![
        ("position 0.01 m", rtk),
        ("velocity 0.06 m/s, height of fixes too", matched),
    ];
    let quick = Noises {
        velocity: 0.1,
        ..Noises::DEFAULT
    };
    let single = vec![("defaults", Noises::DEFAULT), ("velocity 0.1 m/s", quick)];
    vec![
        (
            "RTK fixed",
            |seed| Flight::modelled(seed, FixKind::RtkFixed),
            tunings.clone(),
        ),
        (
            "RTK fixed, IMU noise × 10",
            |seed| Flight::modelled(seed, FixKind::RtkFixed).shaken(10.0),
            tunings.clone(),
        ),
        (
            "RTK fixed, all errors",
            |seed| Flight::with_all_errors(seed, FixKind::RtkFixed),
            tunings,
        ),
        (
            "RTK float",
            |seed| Flight::modelled(seed, FixKind::RtkFloat),
            single.clone(),
        ),
        (
            "single point",
            |seed| Flight::modelled(seed, FixKind::SinglePoint),
            single.clone(),
        ),
        (
            "single point, all errors",
            |seed| Flight::with_all_errors(seed, FixKind::SinglePoint),
            single,
        ),
    ]
}

fn reference_figures(flight: &Flight, noises: Noises) -> Figures {
    let (truths, events) = flight.flown();
    let mut reference = Reference::new(noises, LATENCY);
    let (mut tick, mut errors) = (0, Vec::new());
    for event in events {
        tick += usize::from(matches!(event, Event::Imu(_)));
        reference.give(&event, tick as u64);
        if matches!(event, Event::Imu(_)) && tick as f64 * H >= FROM {
            let (position, velocity, r) = reference.motion();
            errors.push(Errors::new(&truths[tick], position, velocity, &r));
        }
    }
    Figures::new(&errors)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Returns the medians of velocity (cm/s), attitude (mrad), position, and position about its mean (cm).
fn medians(figures: &[Figures]) -> [f64; 4] {
    let of = |value: fn(&Figures) -> f64| median(figures.iter().map(value).collect());
    [
        100.0 * of(|figures| figures.velocity),
        1000.0 * of(|figures| figures.attitude),
        100.0 * of(|figures| figures.position),
        100.0 * of(|figures| figures.position_about_mean),
    ]
}

/// Prints the table. Returns whether velocity and attitude are nowhere worse than the best of EKF2, in flights with the errors
/// that both filters model.
pub fn compare(seeds: u64) -> bool {
    println!("| flight | filter | velocity, cm/s | attitude, mrad | position, cm | about its mean, cm |");
    println!("| --- | --- | --- | --- | --- | --- |");
    let mut is_good = true;
    for (name, flight, tunings) in rows() {
        let flights: Vec<Flight> = (1..=seeds)
            .map(|seed| {
                let mut flight = flight(seed);
                flight.gnss.latency = [LATENCY; 2];
                flight
            })
            .collect();
        let print = |filter: &str, [velocity, attitude, position, about]: [f64; 4]| {
            println!("| {name} | {filter} | {velocity:.1} | {attitude:.1} | {position:.1} | {about:.1} |");
        };
        let own: Vec<_> = flights
            .iter()
            .map(|flight| Flown::new(flight, &flight.parameters(), unchanged).figures(FROM))
            .collect();
        let own = medians(&own);
        print("inertial", own);
        let mut best = [f64::INFINITY; 4];
        for (tuning, noises) in tunings {
            let figures: Vec<_> = flights
                .iter()
                .map(|flight| reference_figures(flight, noises))
                .collect();
            let figures = medians(&figures);
            print(&format!("EKF2, {tuning}"), figures);
            best = [0, 1, 2, 3].map(|at| best[at].min(figures[at]));
        }
        for (what, own, best) in [("velocity", own[0], best[0]), ("attitude", own[1], best[1])] {
            if own > best && name.ends_with(UNMODELLED) {
                eprintln!("{name}: {what} {own:.2}, EKF2 {best:.2}; for information");
            } else if own > best {
                eprintln!("{name}: {what} {own:.2}, EKF2 {best:.2}");
                is_good = false;
            }
        }
    }
    is_good
}
