//! Tracks: the accepted poses of bodies, and their possible next poses.
//!
//! A pose follows a track if the body could have got there, in position *and* attitude, at the stated speed and rate of
//! turn since the last accepted pose. Both reaches grow with the time and saturate: after a fifth of a second in
//! position, and at 1 rad in attitude, so that a body that was away for long, or came back turned, must settle again.
//! Of a body that turns at once, the position follows without the attitude until it has settled: confused markers have
//! the same centre as before. Of a pose that is frozen in part, the other part can follow alone.
//! Poses that continue refused ones are refused too, even if they have come into reach by then: a pose belongs to the
//! track from which the body gets there sooner, and to the refused ones if it is where the last of them was. A track
//! restarts when poses followed each other for the stated time, unless they began where another body was: then the
//! markers were exchanged, and the poses are refused for any time.

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::angle_between;

use crate::wire::{MOST_BODIES, Name, WireBody};

/// Longest time without a pose for which a body's reach grows, ns.
const LONGEST_NS: u64 = 200_000_000;
/// Error of a pose by noise and by an uncertain time, m.
const POSITION_NOISE: f64 = 0.02;
/// The same of an attitude, rad.
const ATTITUDE_NOISE: f64 = 0.1;
/// Largest turn between two accepted poses, rad.
const LARGEST_TURN: f64 = 1.0;
/// Time for which another body's last place is kept, ns.
const OTHER_NS: u64 = 1_000_000_000;
/// A place is another body's if the way from there is shorter by this factor than from the vehicle's last place.
const EXCHANGE_FACTOR: f64 = 0.5;

/// Limits of a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Largest speed, m/s.
    pub max_speed: f64,
    /// Largest rate of turn, rad/s.
    pub max_turn_rate: f64,
    /// Time for which poses must follow each other before they are accepted, ns.
    pub settle_ns: u64,
}

/// Decision on a pose for a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PoseDecision {
    /// It follows.
    Follows,
    /// It is the last of those that started the track.
    Settled,
    /// There is no track yet.
    Unsettled,
    /// The body can have got there, but not have turned so.
    Turned,
    /// The body cannot have got there.
    Jumped,
    /// The body cannot have got there, but another could.
    Exchanged,
}

/// Pose of a body at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub(super) position: Vector3<f64>,
    pub(super) rotation: Matrix3<f64>,
    /// Time of the position.
    pub(super) at_ns: u64,
    /// Time of the rotation.
    pub(super) turned_at_ns: u64,
}

/// Poses that follow each other and are not accepted yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub(super) newest: Place,
    pub(super) since_ns: u64,
    pub(super) verdict: PoseDecision,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Other {
    name: Name,
    number: i32,
    place: Place,
}

/// The vehicle's track, and the last places of other bodies.
#[derive(Clone, Debug)]
pub(super) struct Tracks {
    bounds: Bounds,
    believed: Option<Place>,
    candidate: Option<Candidate>,
    others: Vec<Other>,
}

impl Place {
    fn new(position: &Vector3<f64>, rotation: &Matrix3<f64>, at_ns: u64) -> Self {
        Self {
            position: *position,
            rotation: *rotation,
            at_ns,
            turned_at_ns: at_ns,
        }
    }

    /// Returns whether another one cannot be told from it.
    fn is_as(&self, other: &Self) -> bool {
        let [way, turn] = self.way_and_turn(other);
        way <= POSITION_NOISE && turn <= ATTITUDE_NOISE
    }

    /// Returns way and turn to another one, m and rad.
    fn way_and_turn(&self, to: &Self) -> [f64; 2] {
        let turn = angle_between(&self.rotation, &to.rotation);
        [(self.position - to.position).norm(), turn]
    }
}

impl Bounds {
    fn can_follow(&self, from: &Place, to: &Place) -> bool {
        self.can_reach(from, to) && self.can_turn(from, to)
    }

    fn can_reach(&self, from: &Place, to: &Place) -> bool {
        let since_ns = to.at_ns.saturating_sub(from.at_ns).min(LONGEST_NS);
        let [way, _] = from.way_and_turn(to);
        way <= self.max_speed * seconds(since_ns) + POSITION_NOISE
    }

    fn can_turn(&self, from: &Place, to: &Place) -> bool {
        let since_ns = to.turned_at_ns.saturating_sub(from.turned_at_ns).min(LONGEST_NS);
        let [_, turn] = from.way_and_turn(to);
        turn <= (self.max_turn_rate * seconds(since_ns)).min(LARGEST_TURN) + ATTITUDE_NOISE
    }

    /// Returns the shortest time in which the body gets from one place to another, s.
    fn time_between(&self, from: &Place, to: &Place) -> f64 {
        let [way, turn] = from.way_and_turn(to);
        (way / self.max_speed).max(turn / self.max_turn_rate)
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
            believed: None,
            candidate: None,
            others: Vec::with_capacity(MOST_BODIES),
        }
    }

    /// Returns the last accepted pose of the vehicle.
    pub(super) fn believed(&self) -> Option<&Place> {
        self.believed.as_ref()
    }

    /// Returns the poses that are not accepted yet.
    pub(super) fn candidate(&self) -> Option<&Candidate> {
        self.candidate.as_ref()
    }

    /// Goes on from an accepted pose of the vehicle, and from poses that were not accepted yet.
    pub(super) fn restore(&mut self, believed: Option<Place>, candidate: Option<Candidate>) {
        (self.believed, self.candidate) = (believed, candidate);
    }

    /// Takes the vehicle's next pose.
    pub(super) fn vehicle(
        &mut self,
        position: &Vector3<f64>,
        rotation: &Matrix3<f64>,
        at_ns: u64,
    ) -> PoseDecision {
        let place = Place::new(position, rotation, at_ns);
        let time = |from: &Place| self.bounds.time_between(from, &place);
        let longest_ns = self.bounds.settle_ns.max(LONGEST_NS);
        let continued = self.candidate.filter(|Candidate { newest, verdict, .. }| {
            // Another body stays another one also after an occlusion.
            let lasts =
                at_ns.saturating_sub(newest.at_ns) <= longest_ns || *verdict == PoseDecision::Exchanged;
            lasts && self.bounds.can_follow(newest, &place)
        });
        if let Some(believed) = self.believed
            && self.bounds.can_follow(&believed, &place)
            && continued.is_none_or(|candidate| {
                !candidate.newest.is_as(&place) && time(&believed) <= time(&candidate.newest)
            })
        {
            self.believed = Some(place);
            self.candidate = None;
            return PoseDecision::Follows;
        }
        let mut candidate = Candidate {
            newest: place,
            since_ns: continued.map_or(at_ns, |candidate| candidate.since_ns),
            verdict: continued.map_or_else(|| self.verdict_of_first(&place), |candidate| candidate.verdict),
        };
        let lasts_ns = at_ns.saturating_sub(candidate.since_ns);
        // One pose follows nothing, however short the time is.
        if candidate.verdict != PoseDecision::Exchanged
            && continued.is_some()
            && lasts_ns >= self.bounds.settle_ns
        {
            self.believed = Some(place);
            self.candidate = None;
            return PoseDecision::Settled;
        }
        if candidate.verdict == PoseDecision::Turned && !self.reach(position, at_ns) {
            candidate.verdict = PoseDecision::Jumped;
        }
        self.candidate = Some(candidate);
        candidate.verdict
    }

    /// Takes the vehicle's next position alone. Returns whether it follows.
    pub(super) fn reach(&mut self, position: &Vector3<f64>, at_ns: u64) -> bool {
        self.follow(|believed| Place {
            position: *position,
            at_ns,
            ..believed
        })
    }

    /// Takes the vehicle's next attitude alone. Returns whether it follows.
    pub(super) fn turn(&mut self, rotation: &Matrix3<f64>, at_ns: u64) -> bool {
        self.follow(|believed| Place {
            rotation: *rotation,
            turned_at_ns: at_ns,
            ..believed
        })
    }

    /// Takes the next place, one part of which stays, if the vehicle can have got there.
    fn follow(&mut self, next: impl FnOnce(Place) -> Place) -> bool {
        let Some(believed) = &mut self.believed else {
            return false;
        };
        let place = next(*believed);
        let follows = self.bounds.can_follow(believed, &place);
        if follows {
            *believed = place;
        }
        follows
    }

    /// Returns the decision on a pose that follows neither the track nor the pose before.
    fn verdict_of_first(&self, place: &Place) -> PoseDecision {
        let Some(believed) = &self.believed else {
            return PoseDecision::Unsettled;
        };
        let own = (believed.position - place.position).norm();
        let is_others = self.others.iter().any(|other| {
            place.at_ns.saturating_sub(other.place.at_ns) <= OTHER_NS
                && self.bounds.can_follow(&other.place, place)
                && (other.place.position - place.position).norm() < EXCHANGE_FACTOR * own
        });
        if is_others {
            PoseDecision::Exchanged
        } else if self.bounds.can_reach(believed, place) {
            PoseDecision::Turned
        } else {
            PoseDecision::Jumped
        }
    }

    /// Takes a pose of another body, which mostly stands at the same index of every frame.
    pub(super) fn other(
        &mut self,
        index: usize,
        body: &WireBody,
        position: &Vector3<f64>,
        rotation: &Matrix3<f64>,
        at_ns: u64,
    ) {
        let place = Place::new(position, rotation, at_ns);
        let is_it = |other: &Other| other.number == body.number && other.name == body.name;
        let known = if self.others.get(index).is_some_and(is_it) {
            Some(index)
        } else {
            self.others.iter().position(is_it)
        };
        if let Some(known) = known {
            let old = self.others[known].place;
            // During an exchange with the vehicle it is not where it was: its old place counts until it expires.
            if self.bounds.can_follow(&old, &place) || at_ns.saturating_sub(old.at_ns) > OTHER_NS {
                self.others[known].place = place;
            }
        } else if self.others.len() < MOST_BODIES {
            self.others.push(Other {
                name: body.name,
                number: body.number,
                place,
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
            self.tracks.vehicle(&position, &rotation, at_ns)
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
                let decision = body.tracks.vehicle(&ghost, &Matrix3::identity(), at_ns);
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
