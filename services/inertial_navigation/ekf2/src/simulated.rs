//! Simulated flights.

use shared_types::gnss::FixKind;

use crate::reference::{Noises, Reference};
use crate::rig::{Errors, Event, Figures, Flight, Flown, H};

/// Times from and up to which errors count, s.
const WHOLE: [f64; 2] = [50.0, f64::INFINITY];
/// The same where the cameras see nothing.
const UNSEEN: [f64; 2] = [80.0, 85.0];
/// Latency of fixes, s.
const LATENCY: f64 = 0.1;

/// End of the name of a row with errors that neither filter models.
const UNMODELLED: &str = "all errors";

/// A row of the table: its name, its flights, the time that counts, and the noises with which EKF2 may fly them. Rows with errors that
/// neither filter models are for information. In flights with cameras there are no fixes.
type Row = (
    &'static str,
    fn(u64) -> Flight,
    [f64; 2],
    Vec<(&'static str, Noises)>,
);

/// Returns whether an event at a time, s, reaches the filters.
fn arrives(event: &Event, time: f64, flight: &Flight, [from, to]: [f64; 2]) -> bool {
    match event {
        Event::Fix(_) => flight.cameras.is_none(),
        Event::Pose(_) => [from, to] == WHOLE || !(from..to).contains(&time),
        _ => true,
    }
}

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
    let seen = |position| Noises {
        pose: Some(position),
        ..Noises::DEFAULT
    };
    let poses = vec![("position 0.1 m", seen(0.1)), ("position 0.01 m", seen(0.01))];
    vec![
        (
            "RTK fixed",
            |seed| Flight::modelled(seed, FixKind::RtkFixed),
            WHOLE,
            tunings.clone(),
        ),
        (
            "RTK fixed, IMU noise × 10",
            |seed| Flight::modelled(seed, FixKind::RtkFixed).shaken(10.0),
            WHOLE,
            tunings.clone(),
        ),
        (
            "RTK fixed, all errors",
            |seed| Flight::with_all_errors(seed, FixKind::RtkFixed),
            WHOLE,
            tunings,
        ),
        (
            "RTK float",
            |seed| Flight::modelled(seed, FixKind::RtkFloat),
            WHOLE,
            single.clone(),
        ),
        (
            "single point",
            |seed| Flight::modelled(seed, FixKind::SinglePoint),
            WHOLE,
            single.clone(),
        ),
        (
            "single point, all errors",
            |seed| Flight::with_all_errors(seed, FixKind::SinglePoint),
            WHOLE,
            single,
        ),
        (
            "cameras",
            |seed| Flight::modelled(seed, FixKind::RtkFixed).seen(),
            WHOLE,
            poses.clone(),
        ),
        (
            "cameras, none for 5 s",
            |seed| Flight::modelled(seed, FixKind::RtkFixed).seen(),
            UNSEEN,
            poses,
        ),
    ]
}

fn own_figures(flight: &Flight, span: [f64; 2]) -> Figures {
    let mut ticks = 0;
    let flown = Flown::new(flight, &flight.parameters(), |event| {
        ticks += u64::from(matches!(event, Event::Imu(_)));
        arrives(event, ticks as f64 * H, flight, span)
    });
    let errors = flown.errors.iter();
    let errors = errors.filter(|(tick, _)| (span[0]..span[1]).contains(&(*tick as f64 * H)));
    Figures::new(&errors.map(|(_, errors)| *errors).collect::<Vec<_>>())
}

fn reference_figures(flight: &Flight, span: [f64; 2], noises: Noises) -> Figures {
    let (truths, events) = flight.flown();
    let mut reference = Reference::new(noises, LATENCY);
    let (mut tick, mut errors) = (0, Vec::new());
    for event in events {
        tick += usize::from(matches!(event, Event::Imu(_)));
        let time = tick as f64 * H;
        if !arrives(&event, time, flight, span) {
            continue;
        }
        reference.give(&event, tick as u64);
        if matches!(event, Event::Imu(_)) && (span[0]..span[1]).contains(&time) {
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
    for (name, flight, span, tunings) in rows() {
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
        let own: Vec<_> = flights.iter().map(|flight| own_figures(flight, span)).collect();
        let own = medians(&own);
        print("inertial", own);
        let mut best = [f64::INFINITY; 4];
        for (tuning, noises) in tunings {
            let figures: Vec<_> = flights
                .iter()
                .map(|flight| reference_figures(flight, span, noises))
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
