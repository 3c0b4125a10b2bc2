//! Hardware-in-the-loop simulator of a scenario: vehicle, cameras and receiver in one process, connected to the flight by
//! the network and a radio link.
//!
//! ```text
//! flight: rc_output ── frames: pseudo-terminal, TCP, UDP ──▶ receiver ─▶ actuators, body, air
//! flight: estimator ◀── poses: VRPN, NatNet, Vicon ───────── cameras ◀──────────┘
//! ```
//!
//! Nothing of it is shared with the flight but the scenario. It simulates the same plant, by the system's clock: tick k begins
//! k·h after the first, and what has not arrived by then does not act in it.
//!
//! * [`mod@receiver_input`]: where frames arrive;
//! * [`radio`]: what the newest of them that has reached the motors asks for;
//! * [`autopilot`]: what flies by it: the scenario's own rate loop, or [`betaflight`], a flight controller's real firmware;
//! * [`cameras`]: poses, sent when a real system would have them ready;
//! * [`record`]: what truly happened, on the disk.
//!
//! Failure policy: a port or address that cannot be opened at the start is an error with the fix. Later a missing flight is
//! no error: without frames for [`link_loss_timer::LOST_AFTER_NS`] the vehicle stops its motors.

pub mod autopilot;
pub mod betaflight;
pub mod cameras;
pub mod link_loss_timer;
pub mod radio;
pub mod receiver_input;
pub mod record;
mod vehicle;

use hdrhistogram::Histogram;
use runtime::flight_clock::{FlightClock, monotonic_ns};
use scenario::Scenario;
use shared_types::service::{BuildError, seconds};

use self::autopilot::{Autopilot, AutopilotCommands};
use self::cameras::CameraSender;
use self::record::{Record, RecordedTick};
use self::vehicle::SimulatedVehicle;
use flight::interrupt::Interrupt;
use run_log::LogError;

/// Longest lateness that is told apart, ns.
const LATEST_NS: u64 = 10_000_000_000;

/// The timing of a world that the scenario does not state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Captures a second, Hz.
    pub capture_rate: f64,
    /// Time from an exposure until its pose is sent, s.
    pub capture_latency: f64,
    /// Time from a frame's arrival until it acts, s.
    pub radio_latency: f64,
}

impl Timing {
    /// Returns the timing that makes the scenario's beliefs true on average: cameras in the middle of their rates, as
    /// late as they are believed to be, and a radio that is late by what is left of the believed latency when a command
    /// has waited for the next frame, which takes half the time between two.
    #[must_use]
    pub fn believed(scenario: &Scenario) -> Self {
        let rates = scenario.motion_capture.as_ref().map(|stated| stated.rate);
        let frames = scenario.rc_output.as_ref().and_then(|link| {
            let transmitter = link.transmitter.as_ref()?;
            Some(transmitter.frame_rate_on(link.link))
        });
        let waiting = frames.map_or(0.0, |rate| 0.5 / rate);
        let believed = scenario.model.as_ref().map_or(0.0, |model| model.radio_latency);
        Self {
            capture_rate: rates.map_or(100.0, |[least, most]| 0.5 * (least + most)),
            capture_latency: seconds(scenario.capture_latency_ns()),
            radio_latency: (believed - waiting).max(0.0),
        }
    }
}

/// The result of a world.
#[derive(Clone, Debug)]
pub struct HilReport {
    /// Ticks that were simulated.
    pub ticks: u64,
    /// The lateness of its ticks, ns.
    pub lateness_ns: Histogram<u64>,
    /// Poses that were sent.
    pub poses: u64,
    /// The commands received on board.
    pub heard: AutopilotCommands,
    /// The signal that ended it, if one did.
    pub signal: Option<i32>,
}

/// Hardware-in-the-loop simulator.
pub struct HilSimulator {
    clock: FlightClock,
    vehicle: SimulatedVehicle,
    onboard: Autopilot,
    cameras: CameraSender,
    record: Record,
}

impl HilSimulator {
    /// The vehicle of a scenario, by a clock, with what connects it to a flight.
    ///
    /// # Errors
    /// What the plant cannot do that the scenario asks for.
    pub fn new(
        scenario: &Scenario,
        clock: FlightClock,
        onboard: Autopilot,
        cameras: CameraSender,
        record: Record,
    ) -> Result<Self, BuildError> {
        Ok(Self {
            clock,
            vehicle: SimulatedVehicle::new(scenario)?,
            onboard,
            cameras,
            record,
        })
    }

    /// Continues for so many ticks, or until an interrupt.
    ///
    /// # Errors
    /// [`LogError`] if what happened cannot be kept.
    ///
    /// # Panics
    /// Never: the histogram is made for all latenesses that are counted.
    pub fn run(mut self, ticks: u64, interrupt: &Interrupt) -> Result<HilReport, LogError> {
        let mut lateness_ns =
            Histogram::new_with_bounds(1000, LATEST_NS, 3).expect("the bounds of a histogram");
        let mut simulated = 0;
        while simulated < ticks && interrupt.signal().is_none() {
            let begins_ns = self.clock.begins_at(simulated);
            self.attend_until(begins_ns);
            let late_ns = monotonic_ns().saturating_sub(begins_ns);
            lateness_ns.saturating_record(late_ns.clamp(1, LATEST_NS));
            self.step(simulated, begins_ns);
            simulated += 1;
        }
        let heard = self.onboard.heard();
        self.record.finish()?;
        Ok(HilReport {
            ticks: simulated,
            lateness_ns,
            poses: self.cameras.sent(),
            heard,
            signal: interrupt.signal(),
        })
    }

    /// Takes frames and sends poses until a time has come, ns of `CLOCK_MONOTONIC`.
    fn attend_until(&mut self, at_ns: u64) {
        loop {
            let until_ns = at_ns.min(self.cameras.due_ns());
            self.onboard.listen_until(until_ns);
            self.cameras.send(monotonic_ns());
            if until_ns == at_ns {
                return;
            }
        }
    }

    fn step(&mut self, tick: u64, begins_ns: u64) {
        // The step covers the time since the tick before: what acts for the larger part of it acts in all of it.
        let frame = self
            .onboard
            .acting(begins_ns.saturating_sub(self.clock.tick_ns / 2));
        let sees = self.cameras.see_at(tick);
        let (truth, pose) = self.vehicle.step(tick, self.clock.tick_ns, frame.as_ref(), sees);
        self.onboard.feel(&truth);
        if let Some(pose) = &pose {
            self.cameras
                .take(pose, self.clock.start_ns + pose.capture_time_ns);
        }
        self.record.keep(RecordedTick { truth, pose, frame });
    }
}
