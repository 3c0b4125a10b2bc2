//! The phases of a flight: one table of what leads from which to which.
//!
//! ```text
//! disarmed → armed → take-off → fly → land → disarmed
//! ```
//!
//! The rows of a phase are asked in their order, and the first that holds counts; where none holds the phase stays.
//! Who kills or takes the arming back disarms from every phase, in the air too: the motors rest then by what the
//! transmitter does, and the phases only tell of it.

use crate::samples::PathReference;

/// For how long the motors must rest without a break until the vehicle is on the ground, wherever it was, s.
///
/// A vehicle falls 20 m in this time, more than the height of any laboratory.
pub const GROUNDED_AFTER: f64 = 2.0;

/// A phase of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlightPhase {
    /// The motors rest.
    Disarmed,
    /// The motors may turn, and idle.
    Armed,
    /// From the ground to the path.
    TakeOff,
    /// Along the path.
    Fly,
    /// From where the vehicle is to the ground.
    Land,
}

/// What the next phase depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conditions {
    /// The operator arms, and did not take it back.
    pub armed: bool,
    /// The operator or the envelope killed.
    pub killed: bool,
    /// The operator's arming has not been used up by a flight.
    pub arming_is_new: bool,
    /// The operator or the envelope wants the vehicle on the ground.
    pub land: bool,
    /// Every input is fresh, the vehicle is tracked and does not coast, and the estimate is good.
    pub ready: bool,
    /// The motors have idled long enough.
    pub spooled_up: bool,
    /// The vehicle carries itself.
    pub airborne: bool,
    /// The reference has come to the path, and the vehicle with it.
    pub arrived: bool,
    /// The take-off has not come to an end in its time.
    pub overdue: bool,
    /// The vehicle stands on the ground again.
    pub touched_down: bool,
    /// Whoever keeps the phases begins anew, and finds frames on their way that carry a vehicle.
    pub found_flying: bool,
}

/// A row of the table: in a phase, under a condition, comes another.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// The phase that is left.
    pub from: FlightPhase,
    /// Under which condition, in words.
    pub words: &'static str,
    /// Whether it holds.
    pub when: fn(&Conditions) -> bool,
    /// The phase that comes.
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
            "found in the air by a path generator that begins anew",
            |now| !now.stops() && now.found_flying,
        ),
        row(
            Disarmed,
            Armed,
            "armed anew, all is ready, and nobody wants it on the ground",
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

    /// The phase that follows.
    #[must_use]
    pub fn next(self, conditions: &Conditions) -> Self {
        let mut rows = ROWS.iter().filter(|row| row.from == self);
        rows.find(|row| (row.when)(conditions)).map_or(self, |row| row.to)
    }

    /// The phase as references say it.
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

    /// The phase of a code; disarmed for a code of none.
    #[must_use]
    pub fn from_code(code: u8) -> Self {
        let mut phases = Self::ALL.into_iter();
        phases
            .find(|phase| phase.code() == code)
            .unwrap_or(Self::Disarmed)
    }

    /// Its name.
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
