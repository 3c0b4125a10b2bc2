//! The true distance of the vehicle from its point on the path, whoever is out.

use shared_types::Topic;
use shared_types::samples::{PathReference, VehicleTruth};
use shared_types::scenario::Vector;

use crate::summary::read;

/// How far from the time that it speaks of a reference is carried along the path, s.
///
/// References are made seldom, and of times to come; between them the point moves on. A path that nobody has moved
/// for longer stands.
const CARRIED: f64 = 0.2;

/// Tells ‖p − pd‖ at every tick of the truth, pd being the point of the newest reference, moved along the path to
/// the time of the truth.
///
/// In a tick of the log the truth comes first. So it is compared when the next one comes, or at the end.
#[derive(Clone, Copy, Debug, Default)]
pub struct TrueError {
    truth: Option<Truth>,
    reference: Option<PathReference>,
}

/// What is kept of the truth.
#[derive(Clone, Copy, Debug)]
struct Truth {
    tick: u64,
    time_ns: u64,
    position_world: Vector,
}

impl TrueError {
    /// Takes a sample into account; the tick before, with its error (m), if that is now known.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) -> Option<(u64, f64)> {
        match topic {
            Topic::VehicleTruth => {
                let known = self.last();
                let truth = read::<VehicleTruth>(bytes);
                self.truth = Some(Truth {
                    tick: truth.header.tick,
                    time_ns: truth.header.stamp_ns,
                    position_world: truth.position_world,
                });
                known
            }
            Topic::PathReference => {
                self.reference = Some(read(bytes));
                None
            }
            _ => None,
        }
    }

    /// pd at the time of the last truth, in {I}, m.
    #[must_use]
    pub fn point(&self) -> Option<Vector> {
        self.point_at(self.truth?.time_ns)
    }

    /// pd at a time, ns since the start of the flight, in {I}, m.
    #[must_use]
    pub fn point_at(&self, time_ns: u64) -> Option<Vector> {
        Some(point_at(self.reference.as_ref()?, time_ns))
    }

    /// The last tick, with its error (m), once nothing more of it comes.
    #[must_use]
    pub fn last(&self) -> Option<(u64, f64)> {
        let truth = self.truth?;
        let point = self.point()?;
        let [x, y, z] = [0, 1, 2].map(|axis| truth.position_world[axis] - point[axis]);
        Some((truth.tick, (x * x + y * y + z * z).sqrt()))
    }
}

/// pd at a time: γ moves by its derivatives, and pd by its Taylor polynomial in γ.
fn point_at(reference: &PathReference, time_ns: u64) -> Vector {
    let ahead = (time_ns as f64 - reference.reference_time_ns as f64) / 1e9;
    let t = ahead.clamp(-CARRIED, CARRIED);
    let gamma = t * (reference.gamma_dot + 0.5 * t * reference.gamma_ddot);
    [0, 1, 2].map(|axis| {
        let third = reference.derivative2_world[axis] + gamma / 3.0 * reference.derivative3_world[axis];
        let second = reference.derivative1_world[axis] + 0.5 * gamma * third;
        reference.position_world[axis] + gamma * second
    })
}
