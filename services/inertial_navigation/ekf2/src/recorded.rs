//! PX4's recorded flight `iris_gps`: 20 s on the ground, 13 s in the air, 3.5 m up and down; and what EKF2 made of it.

use std::path::Path;

use inertial_navigation::{Altitude, Field, Fix, ImuSample, InertialFilter, Parameters};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use shared_types::gnss::FixKind;

use crate::reference::RADIUS;
use crate::rig::{Errors, Event, give};
use sensor_models::TrueMotion;

/// Time between which the two are compared, s: from when both have converged until before the landing.
const COMPARED: std::ops::Range<f64> = 10.0..30.0;
/// Largest differences: of the velocity (m/s), of the position (m), of the attitude (rad).
const LIMITS: [f64; 3] = [0.1, 0.3, 0.0175];

/// A row of the reference: time in s, and the motion.
type Row = (f64, TrueMotion);

fn numbers(line: &str) -> Vec<f64> {
    line.split(',')
        .map(|word| word.parse().unwrap_or(f64::NAN))
        .collect()
}

/// Returns EKF2's states, and its field of the earth at the end, G.
fn reference(data: &Path) -> (Vec<Row>, Vector3<f64>) {
    let text =
        std::fs::read_to_string(data.join("iris_gps_reference.csv")).expect("the reference of the flight");
    let mut field = Vector3::zeros();
    let row = |line: &str| {
        let row = numbers(line);
        let three = |at: usize| Vector3::from_row_slice(&row[at..at + 3]);
        let attitude = UnitQuaternion::from_quaternion(Quaternion::new(row[1], row[2], row[3], row[4]));
        field = three(17);
        let motion = TrueMotion {
            velocity_world: three(5),
            position_world: three(8),
            world_from_body: *attitude.to_rotation_matrix().matrix(),
            ..TrueMotion::AT_REST
        };
        (row[0] * 1e-6, motion)
    };
    let rows = text.lines().skip(1).map(row).collect();
    (rows, field)
}

/// Returns the event of a line; `origin` is latitude, longitude (°) and height (m) of the first fix.
fn event(line: &str, origin: &mut Option<[f64; 3]>) -> Option<(u64, Event)> {
    let row = numbers(line);
    let three = |at: usize| Vector3::from_row_slice(&row[at..at + 3]);
    let time_ns = (row[0] * 1e3) as u64;
    let event = match line.split(',').nth(1)? {
        "imu" => Event::Imu(ImuSample {
            time_ns,
            force_body: three(2),
            rate_body: three(5),
            is_clipped: false,
        }),
        "mag" => Event::Field(Field {
            time_ns,
            field_body: three(2),
        }),
        "baro" => Event::Altitude(Altitude {
            time_ns,
            altitude: row[2] - (*origin)?[2],
        }),
        "gps" => {
            let place = [row[4] * 1e-7, row[3] * 1e-7, row[2] * 1e-3];
            let [latitude, longitude, height] = *origin.get_or_insert(place);
            let north = (place[0] - latitude).to_radians() * RADIUS;
            let east = (place[1] - longitude).to_radians() * RADIUS * latitude.to_radians().cos();
            // EKF2 takes the time for that of the arrival.
            Event::Fix(Fix {
                time_ns: time_ns.saturating_sub(110_000_000),
                kind: FixKind::SinglePoint,
                position_world: Vector3::new(north, east, height - place[2]),
                velocity_world: three(5),
                accuracies: [0.5, 0.8, 0.2],
            })
        }
        "landed" if row[2] == 0.0 => Event::Motors,
        _ => return None,
    };
    Some((time_ns, event))
}

/// Prints the largest differences from EKF2's states. Returns whether they are small.
pub fn compare(data: &Path) -> bool {
    let (rows, field_world) = reference(data);
    let text = std::fs::read_to_string(data.join("iris_gps_replay.csv")).expect("the samples of the flight");
    let mut parameters = Parameters {
        field_world,
        field_white: 0.02,
        altitude_white: 0.5,
        altitude_deviation: 2.0,
        horizon: 0.14,
        ..Parameters::default()
    };
    parameters.accelerometer.noise_density = 0.02;
    parameters.gyroscope.noise_density = 1e-3;
    let mut filter = InertialFilter::new(&parameters);
    let (mut origin, mut newest_ns, mut rows) = (None, 0, rows.iter().peekable());
    let mut errors = Vec::new();
    for (time_ns, event) in text.lines().filter_map(|line| event(line, &mut origin)) {
        give(&mut filter, &event, newest_ns);
        if !matches!(event, Event::Imu(_)) {
            continue;
        }
        newest_ns = time_ns;
        let now = time_ns as f64 * 1e-9;
        while let Some((_, truth)) = rows.next_if(|(time, _)| *time <= now) {
            if let (true, Some(motion)) = (COMPARED.contains(&now), filter.motion()) {
                errors.push(Errors::new(
                    truth,
                    motion.position_world,
                    motion.velocity_world,
                    &motion.world_from_body,
                ));
            }
        }
    }
    let largest = errors.iter().fold([0.0; 3], |largest: [f64; 3], error| {
        let norms = [
            error.velocity.amax(),
            error.position.amax(),
            error.attitude.amax(),
        ];
        [0, 1, 2].map(|at| largest[at].max(norms[at]))
    });
    let [velocity, position, attitude] = largest;
    println!("\n| largest difference from EKF2 of a component | velocity, m/s | position, m | attitude, ° |");
    println!("| --- | --- | --- | --- |");
    println!(
        "| PX4's recorded flight | {velocity:.2} | {position:.2} | {:.1} |",
        attitude.to_degrees()
    );
    largest.iter().zip(LIMITS).all(|(value, limit)| *value <= limit)
}
