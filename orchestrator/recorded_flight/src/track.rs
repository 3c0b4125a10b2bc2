//! Motion over time: the recording's own estimate, and the distance of another one from it.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde::Serialize;
use shared_types::geodesy::{Geodetic, LocalFrame};
use shared_types::rotation::{exp, from_row_major, log};
use shared_types::samples::VehicleState;

use crate::recording::{WrongLine, lines, number};

/// Longest time between two rows over which motion is interpolated, ns.
const LONGEST_GAP_NS: u64 = 1_000_000_000;

/// Distance of a quaternion's norm from 1 that rounding explains.
const ROUNDING: f64 = 1e-3;

/// Motion of the vehicle at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// p in {I}, m.
    pub position_world: Vector3<f64>,
    /// v in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// R.
    pub world_from_body: Matrix3<f64>,
    /// ω in {B}, rad/s: the mean between two rows.
    pub rate_body: Vector3<f64>,
}

impl Default for Motion {
    fn default() -> Self {
        Self {
            position_world: Vector3::zeros(),
            velocity_world: Vector3::zeros(),
            world_from_body: Matrix3::identity(),
            rate_body: Vector3::zeros(),
        }
    }
}

/// Motions in the order of time, ns since the start of the flight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track(pub Vec<(u64, Motion)>);

impl Track {
    /// Adds the state of an estimator, if it is tracked.
    pub fn add(&mut self, state: &VehicleState) {
        if !state.tracked.is_set() {
            return;
        }
        let world_from_body = from_row_major(&state.world_from_body);
        let motion = Motion {
            position_world: state.position_world.into(),
            velocity_world: world_from_body * Vector3::from(state.velocity_body),
            world_from_body,
            rate_body: state.angular_velocity_body.into(),
        };
        self.0.push((state.state_time_ns, motion));
    }

    /// Returns the rows within `[from, to]`, s.
    pub(crate) fn within(&self, [from, to]: [f64; 2]) -> impl Iterator<Item = &(u64, Motion)> {
        let is_within = move |(time_ns, _): &&(u64, Motion)| (from..=to).contains(&(*time_ns as f64 * 1e-9));
        self.0.iter().filter(is_within)
    }

    /// Returns the motion at a time, interpolated between two rows; `None` outside of them, and in a gap of more than a second.
    #[must_use]
    pub fn at(&self, time_ns: u64) -> Option<Motion> {
        let index = self.0.partition_point(|(row_ns, _)| *row_ns <= time_ns);
        let (from_ns, from) = self.0[..index].last()?;
        if *from_ns == time_ns {
            return Some(*from);
        }
        let (to_ns, to) = self.0.get(index)?;
        let span_ns = to_ns - from_ns;
        if span_ns > LONGEST_GAP_NS {
            return None;
        }
        let share = (time_ns - from_ns) as f64 / span_ns as f64;
        let turn = log(&from.world_from_body.tr_mul(&to.world_from_body));
        Some(Motion {
            position_world: from.position_world.lerp(&to.position_world, share),
            velocity_world: from.velocity_world.lerp(&to.velocity_world, share),
            world_from_body: from.world_from_body * exp(&(turn * share)),
            rate_body: turn / (span_ns as f64 * 1e-9),
        })
    }
}

/// Reads the states of EKF2 as the crate `ekf2` has them: a line of names, then rows of time (µs), quaternion (world from body, real
/// part first), velocity (m/s) and position (m) to the north, to the east and downwards of `first_fix`, and numbers that are
/// not used. Rows before the alignment, at rest without a turn, are left out.
///
/// # Errors
/// The first wrong line.
pub fn read(
    text: &str,
    frame: &LocalFrame,
    first_fix: Geodetic,
    flight_ns: impl Fn(u64) -> Option<u64>,
) -> Result<Track, WrongLine> {
    let origin_world = frame.to_world(first_fix);
    let mut track = Track::default();
    let mut last_us = None;
    for (line, text) in lines(text)?.skip(1) {
        let wrong = |reason: String| WrongLine::new(line, reason);
        let row = text.split(',').map(|word| number(word.trim()));
        let row = row.collect::<Result<Vec<f64>, _>>().map_err(wrong)?;
        let &[time, w, x, y, z, vx, vy, vz, px, py, pz] = row.first_chunk::<11>().ok_or_else(|| {
            wrong(format!(
                "a row has time, quaternion, velocity and position, 11 numbers, and here are {}",
                row.len()
            ))
        })?;
        let time_us = whole(time).ok_or_else(|| wrong(format!("`{time}` is no time in whole µs")))?;
        if last_us.replace(time_us).is_some_and(|last| last >= time_us) {
            return Err(wrong(
                "the time is not later than that of the row before".to_owned(),
            ));
        }
        let attitude = Quaternion::new(w, x, y, z);
        if (attitude.norm() - 1.0).abs() > ROUNDING {
            return Err(wrong(format!("the quaternion has a norm of {}", attitude.norm())));
        }
        let is_aligned = row[2..11].iter().any(|number| *number != 0.0);
        let Some(time_ns) = flight_ns(time_us * 1000).filter(|_| is_aligned) else {
            continue;
        };
        let ned = UnitQuaternion::from_quaternion(attitude).to_rotation_matrix();
        let world_from_ned = frame.world_from_ned();
        let motion = Motion {
            position_world: origin_world + world_from_ned * Vector3::new(px, py, pz),
            velocity_world: world_from_ned * Vector3::new(vx, vy, vz),
            world_from_body: world_from_ned * ned.matrix(),
            rate_body: Vector3::zeros(),
        };
        track.0.push((time_ns, motion));
    }
    Ok(track)
}

/// Returns a number of µs as an integer, if it is one.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "checked: whole, not negative and exact"
)]
fn whole(number: f64) -> Option<u64> {
    let is_whole = (0.0..9e15).contains(&number) && number.fract() == 0.0;
    is_whole.then_some(number as u64)
}

/// Difference of two estimates over a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Difference {
    /// Largest magnitude of a component.
    pub largest: f64,
    /// Root of the mean square of the whole vector.
    pub rms: f64,
}

/// Differences of an estimate from a reference, at the rows of the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Differences {
    /// Time of the first and of the last compared row, s since the start of the flight.
    pub span: [f64; 2],
    /// Number of compared rows.
    pub rows: u64,
    /// Of the velocity, m/s.
    pub velocity: Difference,
    /// Of the position, m.
    pub position: Difference,
    /// Of the attitude, as a rotation vector, rad.
    pub attitude: Difference,
}

impl Differences {
    /// Compares an estimate with the rows of a reference within `[from, to]`, s. Returns the differences, `None` if no row could
    /// be compared, and the number of rows at which the estimator did not track the vehicle.
    #[must_use]
    pub fn of(estimate: &Track, reference: &Track, span: [f64; 2]) -> (Option<Self>, u64) {
        let mut found = Self::default();
        let mut untracked = 0;
        let mut errors: [Vec<Vector3<f64>>; 3] = Default::default();
        for (time_ns, expected) in reference.within(span) {
            let time = *time_ns as f64 * 1e-9;
            let Some(motion) = estimate.at(*time_ns) else {
                untracked += 1;
                continue;
            };
            errors[0].push(motion.velocity_world - expected.velocity_world);
            errors[1].push(motion.position_world - expected.position_world);
            errors[2].push(log(&expected.world_from_body.tr_mul(&motion.world_from_body)));
            found.span = [if found.rows == 0 { time } else { found.span[0] }, time];
            found.rows += 1;
        }
        let [velocity, position, attitude] = errors.map(|errors| Difference {
            largest: errors.iter().map(Vector3::amax).fold(0.0, f64::max),
            rms: (errors.iter().map(Vector3::norm_squared).sum::<f64>() / errors.len().max(1) as f64).sqrt(),
        });
        let differences = (found.rows > 0).then_some(Self {
            velocity,
            position,
            attitude,
            ..found
        });
        (differences, untracked)
    }
}
