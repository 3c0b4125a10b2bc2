//! Phases of a flight: one table of all transitions.
//!
//! ```text
//! disarmed → armed → take-off → fly → land → disarmed
//! ```
//!
//! The rows of a phase are tested in their order, and the first that holds applies; if none holds the phase stays. A
//! kill or a disarming disarms from every phase, in the air too. The transmitter stops the motors then; the phases only
//! report it.

use crate::samples::PathReference;

/// Time for which the motors must stop without a break until the vehicle is on the ground, wherever it was, s.
///
/// A vehicle falls 20 m in this time, more than the height of any laboratory.
pub const GROUNDED_AFTER: f64 = 2.0;

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
    /// From the vehicle's place to the ground.
    Land,
}

/// Conditions of the transitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conditions {
    /// The operator has armed, and has not disarmed since.
    pub armed: bool,
    /// The operator or the envelope killed.
    pub killed: bool,
    /// The operator's arming has not been used by a flight.
    pub arming_is_new: bool,
    /// The operator or the envelope demands a landing.
    pub land: bool,
    /// Every input is fresh, the vehicle is tracked and does not coast, and the estimate is good.
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
    /// After a cold start, the path generator has found frames whose thrust carries a vehicle.
    pub found_flying: bool,
}

/// Row of the table: a transition from one phase to another, under a condition.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// The phase before.
    pub from: FlightPhase,
    /// The condition, in words.
    pub words: &'static str,
    /// Returns whether the condition holds.
    pub when: fn(&Conditions) -> bool,
    /// The phase after.
    pub to: FlightPhase,
}

/// The table.
pub const ROWS: [Row; 13] = {
    use FlightPhase::{Armed, Disarmed, Fly, Land, TakeOff};
    const fn row(
        from: FlightPhase,
        to: FlightPhase,
        words: &'static str,
        when: fn(&Conditions) -> bool,
    ) -> Row {
        Row {
            from,
            words,
            when,
            to,
        }
    }
    [
        row(
            Disarmed,
            TakeOff,
            "found in the air by a path generator after a cold start",
            |now| !now.stops() && now.found_flying,
        ),
        row(
            Disarmed,
            Armed,
            "armed again, all is ready, and no landing is demanded",
            |now| !now.stops() && now.arming_is_new && now.ready && !now.land,
        ),
        row(
            Armed,
            Disarmed,
            "killed, or the arming is taken back",
            Conditions::stops,
        ),
        row(
            Armed,
            Disarmed,
            "something is no longer ready, or it is to land",
            |now| !now.ready || now.land,
        ),
        row(Armed, TakeOff, "the motors have idled long enough", |now| {
            now.spooled_up
        }),
        row(
            TakeOff,
            Disarmed,
            "killed, or the arming is taken back",
            Conditions::stops,
        ),
        row(
            TakeOff,
            Disarmed,
            "it is to land or overdue, and has not lifted off",
            |now| (now.land || now.overdue) && !now.airborne,
        ),
        row(
            TakeOff,
            Land,
            "it is to land or overdue, and is airborne",
            |now| now.land || now.overdue,
        ),
        row(
            TakeOff,
            Fly,
            "it is airborne and has arrived at the path",
            |now| now.airborne && now.arrived,
        ),
        row(
            Fly,
            Disarmed,
            "killed, or the arming is taken back",
            Conditions::stops,
        ),
        row(Fly, Land, "it is to land", |now| now.land),
        row(
            Land,
            Disarmed,
            "killed, or the arming is taken back",
            Conditions::stops,
        ),
        row(Land, Disarmed, "it has touched down", |now| now.touched_down),
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

    /// Returns the phase that follows.
    #[must_use]
    pub fn next(self, conditions: &Conditions) -> Self {
        let mut rows = ROWS.iter().filter(|row| row.from == self);
        rows.find(|row| (row.when)(conditions)).map_or(self, |row| row.to)
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

#[cfg(test)]
mod tests;
