//! What the services fly: a vehicle, its operator, the samples between services.

use shared_types::samples::RcFrame;
use shared_types::{FlightPhase, ServiceId};
use zerocopy::FromZeros;

/// Which services have stepped, by index.
pub type Present = [bool; ServiceId::ALL.len()];

/// Request to the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    Arm,
    Land,
    Kill,
}

/// What the services fly.
///
/// The simulation tells it, in the order of time, which services step, which are replaced, and what the operator asks for.
pub trait World {
    /// Advances to the start of a tick. Since the last call the services have stepped that are `present`.
    fn advance_to(&mut self, tick: u64, present: &Present);
    /// A process has taken the place of another one, with its state before the step at `next_tick`.
    fn replace(&mut self, service: ServiceId, next_tick: u64);
    /// The operator or the supervisor asks for something, at the last tick of [`Self::advance_to`].
    fn ask(&mut self, request: Request);
    /// Returns the newest frame to the vehicle.
    fn newest_frame(&self) -> Option<RcFrame>;
    /// Returns the phase of the flight.
    fn phase(&self) -> FlightPhase;
    /// Returns the longest time from a request to land until the motors rest, ns.
    fn longest_landing_ns(&self) -> u64;
    /// Returns what the vehicle did that it must not do.
    ///
    /// # Errors
    /// A sentence for the user.
    fn judge(&self) -> Result<(), String>;
}

/// A vehicle without dynamics: it is armed and lands within fixed times.
#[derive(Clone, Debug)]
pub struct NullWorld {
    tick_ns: u64,
    tick: u64,
    landed_at: Option<u64>,
    is_armed: bool,
    frame: RcFrame,
}

/// Time from the request to land until the motors rest, ns.
const LANDING_NS: u64 = 300_000_000;

impl NullWorld {
    #[must_use]
    pub fn new(tick_ns: u64, has_phases: bool) -> Self {
        Self {
            tick_ns,
            tick: 0,
            landed_at: None,
            is_armed: !has_phases,
            frame: RcFrame::new_zeroed(),
        }
    }

    fn has_landed(&self) -> bool {
        self.landed_at.is_some_and(|at| at <= self.tick)
    }
}

impl World for NullWorld {
    fn advance_to(&mut self, tick: u64, present: &Present) {
        self.tick = tick;
        if present[ServiceId::RcOutput.index()] {
            self.frame.header.stamp_ns = tick * self.tick_ns;
        }
        self.frame.failsafe = (!self.is_armed || self.has_landed()).into();
    }

    fn replace(&mut self, _service: ServiceId, _next_tick: u64) {}

    fn ask(&mut self, request: Request) {
        match request {
            Request::Arm => self.is_armed |= self.landed_at.is_none(),
            Request::Land => {
                self.landed_at
                    .get_or_insert(self.tick + LANDING_NS / self.tick_ns);
            }
            Request::Kill => self.landed_at = Some(self.tick),
        }
    }

    fn newest_frame(&self) -> Option<RcFrame> {
        (self.tick > 0).then_some(self.frame)
    }

    fn phase(&self) -> FlightPhase {
        match (self.is_armed, self.landed_at) {
            (false, _) => FlightPhase::Disarmed,
            (true, None) => FlightPhase::Fly,
            (true, Some(_)) if self.has_landed() => FlightPhase::Disarmed,
            (true, Some(_)) => FlightPhase::Land,
        }
    }

    fn longest_landing_ns(&self) -> u64 {
        LANDING_NS
    }

    fn judge(&self) -> Result<(), String> {
        Ok(())
    }
}
