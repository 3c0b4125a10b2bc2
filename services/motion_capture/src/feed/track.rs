//! Tracks: the last accepted poses of bodies, and the check whether a next pose is reachable.
//!
//! A pose follows a track if the body can have reached it, in position *and* attitude, at the stated speed and turn rate
//! since the last accepted pose. Both reaches grow with time and saturate, the position's after 0.2 s and the attitude's at
//! 1 rad, so that a body that was away for long, or came back turned, must settle again.
//!
//! If only the attitude jumps, the position is still accepted until the attitude has settled: confused markers keep their
//! centroid. If one part of a pose is frozen, the other can follow alone.
//!
//! Poses that continue refused ones are refused too, even if they are within reach by then: a pose belongs to the track
//! from which the body reaches it sooner, and to the refused ones if it is where the last of them was. A track restarts
//! when poses were consistent for the stated time, unless they began where another body was: then the markers were
//! exchanged, and the poses are refused without a time limit.

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::angle_between;

use crate::wire::{MAX_BODIES, Name, WireBody};

/// Time without a pose after which a body's reach no longer grows, ns.
const MAX_REACH_NS: u64 = 200_000_000;
/// Position error by noise and uncertain time, m.
const POSITION_NOISE: f64 = 0.02;
/// Attitude error by noise and uncertain time, rad.
const ATTITUDE_NOISE: f64 = 0.1;
/// Maximum rotation between two accepted poses, rad.
const MAX_TURN: f64 = 1.0;
/// Time for which another body's last pose is stored, ns.
const OTHER_NS: u64 = 1_000_000_000;
/// A pose is another body's if its distance from that body is less than this share of its distance from the vehicle.
const EXCHANGE_FACTOR: f64 = 0.5;

/// Limits of a body's motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Maximum speed, m/s.
    pub max_speed: f64,
    /// Maximum turn rate, rad/s.
    pub max_turn_rate: f64,
    /// Time for which poses must be consistent before they are accepted, ns.
    pub settle_ns: u64,
}

/// Decision on a pose for a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PoseDecision {
    /// The pose follows the track.
    Follows,
    /// The pose completes the poses that start a track.
    Settled,
    /// There is no track yet.
    Unsettled,
    /// The position is reachable, the attitude is not.
    Turned,
    /// The position is not reachable.
    Jumped,
    /// The pose is not reachable, but is for another body.
    Exchanged,
}

/// Pose of a body at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TimedPose {
    pub(super) position: Vector3<f64>,
    pub(super) rotation: Matrix3<f64>,
    /// Time of the position.
    pub(super) at_ns: u64,
    /// Time of the rotation.
    pub(super) turned_at_ns: u64,
}

/// Consistent poses that are not accepted yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub(super) newest: TimedPose,
    pub(super) since_ns: u64,
    pub(super) decision: PoseDecision,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Other {
    name: Name,
    number: i32,
    pose: TimedPose,
}

/// The vehicle's track, and the last poses of other bodies.
#[derive(Clone, Debug)]
pub(super) struct Tracks {
    bounds: Bounds,
    accepted: Option<TimedPose>,
    candidate: Option<Candidate>,
    others: Vec<Other>,
}

impl TimedPose {
    fn new(position: &Vector3<f64>, rotation: &Matrix3<f64>, at_ns: u64) -> Self {
        Self {
            position: *position,
            rotation: *rotation,
            at_ns,
            turned_at_ns: at_ns,
        }
    }

    /// Returns whether two poses are equal up to noise.
    fn is_close_to(&self, other: &Self) -> bool {
        let [distance, angle] = self.distance_and_angle(other);
        distance <= POSITION_NOISE && angle <= ATTITUDE_NOISE
    }

    /// Returns distance and rotation angle to another pose, m and rad.
    fn distance_and_angle(&self, to: &Self) -> [f64; 2] {
        let angle = angle_between(&self.rotation, &to.rotation);
        [(self.position - to.position).norm(), angle]
    }
}

impl Bounds {
    fn can_follow(&self, from: &TimedPose, to: &TimedPose) -> bool {
        self.can_reach(from, to) && self.can_turn(from, to)
    }

    fn can_reach(&self, from: &TimedPose, to: &TimedPose) -> bool {
        let since_ns = to.at_ns.saturating_sub(from.at_ns).min(MAX_REACH_NS);
        let [distance, _] = from.distance_and_angle(to);
        distance <= self.max_speed * seconds(since_ns) + POSITION_NOISE
    }

    fn can_turn(&self, from: &TimedPose, to: &TimedPose) -> bool {
        let since_ns = to
            .turned_at_ns
            .saturating_sub(from.turned_at_ns)
            .min(MAX_REACH_NS);
        let [_, angle] = from.distance_and_angle(to);
        angle <= (self.max_turn_rate * seconds(since_ns)).min(MAX_TURN) + ATTITUDE_NOISE
    }

    /// Returns the minimum time from one pose to another, s.
    fn min_time(&self, from: &TimedPose, to: &TimedPose) -> f64 {
        let [distance, angle] = from.distance_and_angle(to);
        (distance / self.max_speed).max(angle / self.max_turn_rate)
    }
}

#[expect(clippy::cast_precision_loss, reason = "a second at most")]
fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

impl Tracks {
    pub(super) fn new(bounds: Bounds) -> Self {
        Self {
            bounds,
            accepted: None,
            candidate: None,
            others: Vec::with_capacity(MAX_BODIES),
        }
    }

    /// Returns the last accepted pose of the vehicle.
    pub(super) fn accepted(&self) -> Option<&TimedPose> {
        self.accepted.as_ref()
    }

    /// Returns the poses that are not accepted yet.
    pub(super) fn candidate(&self) -> Option<&Candidate> {
        self.candidate.as_ref()
    }

    /// Restores the last accepted pose of the vehicle, and the poses that were not accepted yet.
    pub(super) fn restore(&mut self, accepted: Option<TimedPose>, candidate: Option<Candidate>) {
        (self.accepted, self.candidate) = (accepted, candidate);
    }

    /// Decides on the vehicle's next pose.
    pub(super) fn add_vehicle(
        &mut self,
        position: &Vector3<f64>,
        rotation: &Matrix3<f64>,
        at_ns: u64,
    ) -> PoseDecision {
        let pose = TimedPose::new(position, rotation, at_ns);
        let time = |from: &TimedPose| self.bounds.min_time(from, &pose);
        let longest_ns = self.bounds.settle_ns.max(MAX_REACH_NS);
        let continued = self.candidate.filter(|Candidate { newest, decision, .. }| {
            // Exchanged bodies stay exchanged after an occlusion.
            let lasts =
                at_ns.saturating_sub(newest.at_ns) <= longest_ns || *decision == PoseDecision::Exchanged;
            lasts && self.bounds.can_follow(newest, &pose)
        });
        if let Some(accepted) = self.accepted
            && self.bounds.can_follow(&accepted, &pose)
            && continued.is_none_or(|candidate| {
                !candidate.newest.is_close_to(&pose) && time(&accepted) <= time(&candidate.newest)
            })
        {
            self.accepted = Some(pose);
            self.candidate = None;
            return PoseDecision::Follows;
        }
        let mut candidate = Candidate {
            newest: pose,
            since_ns: continued.map_or(at_ns, |candidate| candidate.since_ns),
            decision: continued.map_or_else(|| self.first_decision(&pose), |candidate| candidate.decision),
        };
        let lasts_ns = at_ns.saturating_sub(candidate.since_ns);
        // A single pose never settles a track, even with a settling time of 0.
        if candidate.decision != PoseDecision::Exchanged
            && continued.is_some()
            && lasts_ns >= self.bounds.settle_ns
        {
            self.accepted = Some(pose);
            self.candidate = None;
            return PoseDecision::Settled;
        }
        if candidate.decision == PoseDecision::Turned && !self.follow_position(position, at_ns) {
            candidate.decision = PoseDecision::Jumped;
        }
        self.candidate = Some(candidate);
        candidate.decision
    }

    /// Updates the track by a position alone, if it is reachable. Returns whether it is.
    pub(super) fn follow_position(&mut self, position: &Vector3<f64>, at_ns: u64) -> bool {
        self.follow(|accepted| TimedPose {
            position: *position,
            at_ns,
            ..accepted
        })
    }

    /// Updates the track by an attitude alone, if it is reachable. Returns whether it is.
    pub(super) fn follow_attitude(&mut self, rotation: &Matrix3<f64>, at_ns: u64) -> bool {
        self.follow(|accepted| TimedPose {
            rotation: *rotation,
            turned_at_ns: at_ns,
            ..accepted
        })
    }

    /// Updates the track by the next pose, if it is reachable.
    fn follow(&mut self, next: impl FnOnce(TimedPose) -> TimedPose) -> bool {
        let Some(accepted) = &mut self.accepted else {
            return false;
        };
        let pose = next(*accepted);
        let follows = self.bounds.can_follow(accepted, &pose);
        if follows {
            *accepted = pose;
        }
        follows
    }

    /// Returns the decision on a pose that continues neither the track nor the candidate.
    fn first_decision(&self, pose: &TimedPose) -> PoseDecision {
        let Some(accepted) = &self.accepted else {
            return PoseDecision::Unsettled;
        };
        let own = (accepted.position - pose.position).norm();
        let is_others = self.others.iter().any(|other| {
            pose.at_ns.saturating_sub(other.pose.at_ns) <= OTHER_NS
                && self.bounds.can_follow(&other.pose, pose)
                && (other.pose.position - pose.position).norm() < EXCHANGE_FACTOR * own
        });
        if is_others {
            PoseDecision::Exchanged
        } else if self.bounds.can_reach(accepted, pose) {
            PoseDecision::Turned
        } else {
            PoseDecision::Jumped
        }
    }

    /// Updates the pose of another body, which usually has the same index in every frame.
    pub(super) fn add_other(
        &mut self,
        index: usize,
        body: &WireBody,
        position: &Vector3<f64>,
        rotation: &Matrix3<f64>,
        at_ns: u64,
    ) {
        let pose = TimedPose::new(position, rotation, at_ns);
        let is_same = |other: &Other| other.number == body.number && other.name == body.name;
        let index = if self.others.get(index).is_some_and(is_same) {
            Some(index)
        } else {
            self.others.iter().position(is_same)
        };
        if let Some(index) = index {
            let old = self.others[index].pose;
            // During an exchange with the vehicle the body's new pose is not its own: the old one counts until it expires.
            if self.bounds.can_follow(&old, &pose) || at_ns.saturating_sub(old.at_ns) > OTHER_NS {
                self.others[index].pose = pose;
            }
        } else if self.others.len() < MAX_BODIES {
            self.others.push(Other {
                name: body.name,
                number: body.number,
                pose,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use shared_types::rotation::exp;

    use super::*;

    const FRAME_NS: u64 = 10_000_000;

    /// The track of a body that moves and turns steadily, with the noise of cameras.
    struct Body {
        tracks: Tracks,
        velocity: Vector3<f64>,
        rates: Vector3<f64>,
        frame: u64,
    }

    impl Body {
        fn settled(velocity: [f64; 3], rates: [f64; 3]) -> Self {
            let mut body = Self {
                tracks: Tracks::new(Bounds {
                    max_speed: 10.0,
                    max_turn_rate: 35.0,
                    settle_ns: 300_000_000,
                }),
                velocity: velocity.into(),
                rates: rates.into(),
                frame: 0,
            };
            while body.next(&Matrix3::identity()) != PoseDecision::Settled {
                assert!(body.frame < 40);
            }
            body
        }

        /// The decision on the next pose, whose attitude is wrong by a turn.
        fn next(&mut self, turn: &Matrix3<f64>) -> PoseDecision {
            self.frame += 1;
            let at_ns = self.frame * FRAME_NS;
            let phase = self.frame as f64;
            let noise = Vector3::new(
                libm::sin(31.0 * phase),
                libm::cos(17.0 * phase),
                libm::sin(7.0 * phase),
            );
            let position = self.velocity * seconds(at_ns) + noise * 1e-4;
            let rotation = exp(&(self.rates * seconds(at_ns))) * turn * exp(&(noise * 1e-3));
            self.tracks.add_vehicle(&position, &rotation, at_ns)
        }
    }

    proptest! {
        #[test]
        fn a_turn_at_once_is_refused_for_the_whole_time_in_which_a_track_settles(
            axis in prop::array::uniform3(-1.0..1.0f64),
            degrees in 30.0..180.0f64,
            lasts in 1..29u64,
            velocity in prop::array::uniform3(-1.0..1.0f64),
            rates in prop::array::uniform3(-2.0..2.0f64),
        ) {
            prop_assume!(Vector3::from(axis).norm() > 0.1);
            let turn = exp(&(Vector3::from(axis).normalize() * degrees.to_radians()));
            for (velocity, rates) in [([0.0; 3], [0.0; 3]), (velocity, rates)] {
                let mut body = Body::settled(velocity, rates);
                for _ in 0..lasts {
                    prop_assert_eq!(body.next(&turn), PoseDecision::Turned);
                }
                prop_assert_eq!(body.next(&Matrix3::identity()), PoseDecision::Follows);
            }
        }

        /// A ghost that shows now and then never settles, however long that lasts.
        #[test]
        fn poses_with_longer_gaps_than_the_time_to_settle_do_not_settle(gap in 31..100_u64, times in 1..20) {
            let mut body = Body::settled([0.0; 3], [0.0; 3]);
            for _ in 0..times {
                body.frame += gap;
                let at_ns = body.frame * FRAME_NS;
                let ghost = Vector3::new(5.0, 0.0, 1e-4 * body.frame as f64);
                let decision = body.tracks.add_vehicle(&ghost, &Matrix3::identity(), at_ns);
                prop_assert_eq!(decision, PoseDecision::Jumped);
            }
            prop_assert_eq!(body.next(&Matrix3::identity()), PoseDecision::Follows);
        }

        #[test]
        fn a_body_that_comes_back_turned_must_settle_however_long_it_was_away(
            axis in prop::array::uniform3(-1.0..1.0f64),
            degrees in 65.0..180.0f64,
            away in 1..200u64,
        ) {
            prop_assume!(Vector3::from(axis).norm() > 0.1);
            let turn = exp(&(Vector3::from(axis).normalize() * degrees.to_radians()));
            let mut body = Body::settled([0.0; 3], [0.0; 3]);
            body.frame += away;
            for _ in 0..30 {
                prop_assert_eq!(body.next(&turn), PoseDecision::Turned);
            }
            prop_assert_eq!(body.next(&turn), PoseDecision::Settled);
        }
    }
}
