//! Tracks: the accepted places of bodies, and their possible next places.
//!
//! A pose follows a track if the body could have got there at the stated speed and rate of turn since the last accepted
//! pose. That distance grows with the time, but not beyond a fifth of a second: a body that was away for long must
//! settle again. Poses that continue refused ones are refused too, even if they have come into reach by then. A track
//! restarts when poses followed each other for the stated time, unless they began where another body was: then the
//! markers were exchanged, and the poses are refused for any time.

use nalgebra::{Matrix3, Vector3};

use crate::wire::{MOST_BODIES, Name, WireBody};

/// Longest time without a pose for which a body's reach grows, ns.
const LONGEST_NS: u64 = 200_000_000;
/// Error of a pose by noise and by an uncertain time, m.
const POSITION_NOISE: f64 = 0.02;
/// The same of an attitude, rad.
const ATTITUDE_NOISE: f64 = 0.1;
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
    /// Excess of the time between two poses over that of their capture times, ns.
    pub time_noise_ns: u64,
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
    /// The body cannot have got there.
    Jumped,
    /// The body cannot have got there, but another could.
    Exchanged,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    position: Vector3<f64>,
    rotation: Matrix3<f64>,
    at_ns: u64,
}

/// Poses that follow each other and are not accepted yet.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    newest: Place,
    since_ns: u64,
    verdict: PoseDecision,
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

impl Bounds {
    /// Returns the distance that a body can cover in a time, m.
    fn reach(&self, ns: u64) -> f64 {
        self.max_speed * seconds(ns) + POSITION_NOISE
    }

    fn can_follow(&self, from: &Place, to: &Place) -> bool {
        let ns = to.at_ns.saturating_sub(from.at_ns).min(LONGEST_NS) + self.time_noise_ns;
        let turn = self.max_turn_rate * seconds(ns) + ATTITUDE_NOISE;
        // |R1 − R2|F = √8 sin(angle / 2)
        let chord = (from.rotation - to.rotation).norm() / 8.0_f64.sqrt();
        let is_turned = turn < std::f64::consts::PI && chord > libm::sin(turn / 2.0);
        (from.position - to.position).norm() <= self.reach(ns) && !is_turned
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

    /// Takes the vehicle's next pose.
    pub(super) fn vehicle(
        &mut self,
        position: &Vector3<f64>,
        rotation: &Matrix3<f64>,
        at_ns: u64,
    ) -> PoseDecision {
        let place = Place {
            position: *position,
            rotation: *rotation,
            at_ns,
        };
        let away = |from: &Place| (from.position - place.position).norm();
        let continued = self
            .candidate
            .filter(|candidate| self.bounds.can_follow(&candidate.newest, &place));
        if let Some(believed) = self.believed
            && self.bounds.can_follow(&believed, &place)
            && continued.is_none_or(|candidate| away(&believed) <= away(&candidate.newest))
        {
            self.believed = Some(place);
            self.candidate = None;
            return PoseDecision::Follows;
        }
        let candidate = Candidate {
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
        self.candidate = Some(candidate);
        candidate.verdict
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
        let place = Place {
            position: *position,
            rotation: *rotation,
            at_ns,
        };
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
