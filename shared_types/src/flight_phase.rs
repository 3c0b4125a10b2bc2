//! Phases of a flight: one table of all transitions.
//!
//! ```text
//! disarmed → armed → take-off → fly → land → disarmed
//! ```
//!
//! The rows of a phase are tested in their order, and the first that holds applies; if none holds the phase stays. A
//! kill or a disarming disarms from every phase, in the air too. The transmitter stops the motors then; the phases only
//! report it.
//!
//! Each row states its [`Cause`], which the path generator publishes with the phase. No reader derives the cause of a
//! transition from what else holds at that time.

mod readiness;

use crate::samples::PathReference;
pub use readiness::{NotReady, ReadyLimits};

/// Time for which the motors must be stopped continuously until the vehicle is on the ground, from any height, s.
///
/// A vehicle falls 20 m in this time, more than the height of any laboratory.
pub const GROUNDED_AFTER: f64 = 2.0;

/// Share of the speed of a descent below which a vehicle does not sink.
pub const SINKING: f64 = 0.25;
/// Ratio of thrust to weight below which something else carries the vehicle.
pub const UNLOADED: f64 = 0.75;

/// Returns the minimum thrust of a flying vehicle, N: half of the weight of the lightest one (kg), because a thrust may be
/// calibrated wrong.
#[must_use]
pub const fn airborne_thrust(mass_min: f64) -> f64 {
    0.5 * mass_min * crate::GRAVITY
}

/// Acceleration downwards of a descent without a measured velocity, m/s².
pub const DESCENT: f64 = 0.3;

/// Time for which the vehicle neither sinks nor is carried by its thrust until it counts as touched down, s.
pub const STANDING: f64 = 0.4;

/// Timeout of a request to arm: it lapses if the vehicle does not become ready in this time, s.
pub const ARM_WITHIN: f64 = 0.5;

/// Phase of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlightPhase {
    /// The motors stop.
    Disarmed,
    /// The motors may turn, and idle.
    Armed,
    /// From the ground to the path.
    TakeOff,
    /// Along the path.
    Fly,
    /// From the vehicle's position to the ground.
    Land,
}

/// Conditions of the transitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conditions {
    /// The operator has armed, and has not disarmed since.
    pub armed: bool,
    /// The operator or the envelope killed.
    pub killed: bool,
    /// There is a request to arm that was made while disarmed, has not been used and has not lapsed.
    pub arming_is_new: bool,
    /// The operator or the envelope demands a landing.
    pub land: bool,
    /// No condition of readiness is missing ([`NotReady`]).
    pub ready: bool,
    /// The motors have idled long enough.
    pub spooled_up: bool,
    /// The vehicle is airborne.
    pub airborne: bool,
    /// The reference has come to the path, and the vehicle with it.
    pub arrived: bool,
    /// The take-off has exceeded its time.
    pub overdue: bool,
    /// The vehicle stands on the ground again.
    pub touched_down: bool,
    /// The vehicle is tracked again, and not where the reference was.
    pub strayed: bool,
    /// The vehicle is tracked again, and is on the ground.
    pub stranded: bool,
    /// The vehicle is tracked again, and rests on the ground.
    pub rests: bool,
    /// After a cold start, the path generator has found frames whose thrust carries a vehicle.
    pub found_flying: bool,
}

/// Cause of a transition, as the row states it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The next phase of an ordinary flight: armed, take-off, fly.
    Progress,
    /// A path generator after a cold start found the vehicle in the air.
    FoundFlying,
    /// The operator or the envelope killed.
    Killed,
    /// The operator disarmed.
    Disarmed,
    /// The operator or the envelope demanded a landing.
    LandingDemanded,
    /// An input was missing, late or bad: the vehicle must be armed again.
    NotReady,
    /// The take-off exceeded its time.
    Overdue,
    /// The vehicle touched down.
    TouchedDown,
    /// The vehicle was tracked again elsewhere than at the reference.
    Strayed,
}

/// Row of the table: a transition from one phase to another, under a condition.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// The phase before.
    pub from: FlightPhase,
    /// The condition, for docs/safety.md.
    pub words: &'static str,
    /// Returns whether the condition holds.
    pub when: fn(&Conditions) -> bool,
    /// The phase after.
    pub to: FlightPhase,
    /// The cause that references state from then on.
    pub cause: Cause,
}

/// The table.
pub const ROWS: [Row; 28] = {
    use FlightPhase::{Armed, Disarmed, Fly, Land, TakeOff};
    const fn row(
        from: FlightPhase,
        to: FlightPhase,
        cause: Cause,
        words: &'static str,
        when: fn(&Conditions) -> bool,
    ) -> Row {
        Row {
            from,
            words,
            when,
            to,
            cause,
        }
    }
    const fn killed(from: FlightPhase) -> Row {
        row(from, Disarmed, Cause::Killed, "killed", |now| now.killed)
    }
    const fn disarmed(from: FlightPhase) -> Row {
        let words = "disarmed by the operator";
        row(from, Disarmed, Cause::Disarmed, words, |now| !now.armed)
    }
    const fn strayed(from: FlightPhase, to: FlightPhase) -> Row {
        let words = "it is seen again, and not where it was led";
        row(from, to, Cause::Strayed, words, |now| now.airborne && now.strayed)
    }
    // It has landed without being tracked. A law that continued would turn a vehicle that the ground holds.
    const fn rests(from: FlightPhase) -> Row {
        let words = "it is seen again at rest on the ground";
        row(from, Disarmed, Cause::TouchedDown, words, |now| {
            now.airborne && now.rests
        })
    }
    const fn stranded(from: FlightPhase) -> Row {
        let words = "it is seen again on the ground";
        row(from, Land, Cause::Strayed, words, |now| {
            now.airborne && now.stranded
        })
    }
    [
        row(
            Disarmed,
            TakeOff,
            Cause::FoundFlying,
            "found in the air by a path generator after a cold start",
            |now| !now.stops() && now.found_flying,
        ),
        row(
            Disarmed,
            Armed,
            Cause::Progress,
            "a new request to arm, all is ready, and no landing is demanded",
            |now| !now.stops() && now.arming_is_new && now.ready && !now.land,
        ),
        killed(Armed),
        disarmed(Armed),
        row(
            Armed,
            Disarmed,
            Cause::NotReady,
            "something is no longer ready",
            |now| !now.ready,
        ),
        row(Armed, Disarmed, Cause::LandingDemanded, "it is to land", |now| {
            now.land
        }),
        row(
            Armed,
            TakeOff,
            Cause::Progress,
            "the motors have idled long enough",
            |now| now.spooled_up,
        ),
        killed(TakeOff),
        disarmed(TakeOff),
        rests(TakeOff),
        row(
            TakeOff,
            Disarmed,
            Cause::LandingDemanded,
            "it is to land, and has not lifted off",
            |now| now.land && !now.airborne,
        ),
        row(
            TakeOff,
            Disarmed,
            Cause::Overdue,
            "it is overdue, and has not lifted off",
            |now| now.overdue && !now.airborne,
        ),
        row(
            TakeOff,
            Land,
            Cause::LandingDemanded,
            "it is to land, and is airborne",
            |now| now.land,
        ),
        row(
            TakeOff,
            Land,
            Cause::Overdue,
            "it is overdue, and is airborne",
            |now| now.overdue,
        ),
        stranded(TakeOff),
        strayed(TakeOff, TakeOff),
        row(
            TakeOff,
            Fly,
            Cause::Progress,
            "it is airborne and has arrived at the path",
            |now| now.airborne && now.arrived,
        ),
        killed(Fly),
        disarmed(Fly),
        rests(Fly),
        row(Fly, Land, Cause::LandingDemanded, "it is to land", |now| now.land),
        stranded(Fly),
        strayed(Fly, TakeOff),
        killed(Land),
        disarmed(Land),
        rests(Land),
        strayed(Land, Land),
        row(Land, Disarmed, Cause::TouchedDown, "it has touched down", |now| {
            now.touched_down
        }),
    ]
};

impl Conditions {
    fn stops(&self) -> bool {
        self.killed || !self.armed
    }
}

impl FlightPhase {
    /// All phases, in the order of a flight.
    pub const ALL: [Self; 5] = [Self::Disarmed, Self::Armed, Self::TakeOff, Self::Fly, Self::Land];

    /// Returns the row that applies, if the phase changes.
    #[must_use]
    pub fn transition(self, conditions: &Conditions) -> Option<&'static Row> {
        let mut rows = ROWS.iter().filter(|row| row.from == self);
        rows.find(|row| (row.when)(conditions))
    }

    /// Returns the phase's code in references.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Disarmed => PathReference::PHASE_DISARMED,
            Self::Armed => PathReference::PHASE_ARMED,
            Self::TakeOff => PathReference::PHASE_TAKE_OFF,
            Self::Fly => PathReference::PHASE_FLY,
            Self::Land => PathReference::PHASE_LAND,
        }
    }

    /// Returns the phase of a code; disarmed for an unknown code.
    #[must_use]
    pub fn from_code(code: u8) -> Self {
        let mut phases = Self::ALL.into_iter();
        phases
            .find(|phase| phase.code() == code)
            .unwrap_or(Self::Disarmed)
    }

    /// Returns its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Disarmed => "disarmed",
            Self::Armed => "armed",
            Self::TakeOff => "take-off",
            Self::Fly => "fly",
            Self::Land => "land",
        }
    }
}

impl Cause {
    /// Returns its name in docs/flight_phases.md.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Progress => "–",
            Self::FoundFlying => "found flying",
            Self::Killed => "killed",
            Self::Disarmed => "disarmed",
            Self::LandingDemanded => "landing demanded",
            Self::NotReady => "not ready",
            Self::Overdue => "overdue",
            Self::TouchedDown => "touched down",
            Self::Strayed => "strayed",
        }
    }
}

#[cfg(test)]
mod tests;
