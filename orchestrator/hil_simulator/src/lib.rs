//! Hardware-in-the-loop simulator of a scenario: vehicle, cameras, navigation receivers or both, and radio receiver in one process, connected to the flight by
//! the network and a radio link.
//!
//! ```text
//! flight: rc_output ── frames: pseudo-terminal, TCP, UDP ──▶ receiver ─▶ actuators, body, air
//! flight: estimator ◀── poses: VRPN, NatNet, Vicon ───────── cameras ◀──────────┘
//! ```
//!
//! The simulator shares only the scenario with the flight. It simulates the same plant, paced by the system's clock: tick k
//! begins k·h after the first, and frames that arrive later do not act in it.
//!
//! * [`mod@receiver_input`]: the port at which frames arrive;
//! * `battery`: its voltage, sent back over CRSF and to a Crazyflie's log;
//! * [`radio`]: the receiver, with its latency, and [`crazyflie`], what that vehicle does without setpoints;
//! * [`autopilot`]: the scenario's rate loop, or [`betaflight`], the real firmware of a flight controller;
//! * [`cameras`]: poses, sent with the latency of a real system;
//! * [`receivers`]: samples of sensors outdoors, as packets of a satellite receiver and of an autopilot;
//! * [`hand`]: movements of the vehicle by hand, for `gerono lab check`;
//! * [`record`]: the log of the truth;
//! * [`summary`]: what the command prints.
//!
//! Failure policy: a port or address that cannot be opened at the start is an error with the fix. Later a missing flight is
//! no error: without frames for [`link_loss_timer::LOST_AFTER_NS`] the vehicle stops its motors; a Crazyflie levels first.

pub mod autopilot;
mod battery;
pub mod betaflight;
pub mod cameras;
pub mod crazyflie;
pub mod hand;
pub mod link_loss_timer;
pub mod radio;
pub mod receiver_input;
pub mod receivers;
pub mod record;
pub mod summary;
mod vehicle;

use hdrhistogram::Histogram;
use runtime::flight_clock::{FlightClock, monotonic_ns};
use scenario::Scenario;
use shared_types::service::{BuildError, seconds};

use self::autopilot::{Autopilot, AutopilotCommands};
use self::battery::SimulatedBattery;
use self::cameras::{CameraSender, LateCaptures};
use self::receivers::ReceiverSender;
use self::record::{Record, RecordedTick};
use self::vehicle::SimulatedVehicle;
use flight::interrupt::Interrupt;
use run_log::LogError;

/// Upper limit of the lateness histogram, ns.
const LATEST_NS: u64 = 10_000_000_000;

/// Timing of the simulator that the scenario does not state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Rate of captures, Hz.
    pub capture_rate: f64,
    /// Time from an exposure until its pose is sent, s.
    pub capture_latency: f64,
    /// Time from a frame's arrival until it acts, s.
    pub radio_latency: f64,
}

impl Timing {
    /// Returns the timing that matches the scenario's model on average: the mean capture rate, the modelled capture latency, and
    /// the modelled radio latency less the mean waiting time for the next frame, which is half a frame period.
    #[must_use]
    pub fn nominal(scenario: &Scenario) -> Self {
        let rates = scenario.motion_capture.as_ref().map(|stated| stated.rate);
        let frames = scenario.rc_output.as_ref().and_then(|link| {
            let transmitter = link.transmitter.as_ref()?;
            Some(transmitter.frame_rate_on(link.link))
        });
        let waiting = frames.map_or(0.0, |rate| 0.5 / rate);
        let latency = scenario.model.as_ref().map_or(0.0, |model| model.radio_latency);
        Self {
            capture_rate: rates.map_or(100.0, |[least, most]| 0.5 * (least + most)),
            capture_latency: seconds(scenario.capture_latency_ns()),
            radio_latency: (latency - waiting).max(0.0),
        }
    }
}

/// Results of a simulation.
#[derive(Clone, Debug)]
pub struct HilReport {
    /// Simulated ticks.
    pub ticks: u64,
    /// Lateness of the ticks, ns.
    pub lateness_ns: Histogram<u64>,
    /// Poses, or packets of receivers, sent.
    pub poses: u64,
    /// Those of them that were sent late.
    pub late: LateCaptures,
    /// Commands received on board.
    pub received: AutopilotCommands,
    /// The signal that ended the simulation, if any.
    pub signal: Option<i32>,
}

/// What measures the vehicle: cameras, receivers, or both.
#[derive(Debug)]
pub struct Sensing {
    /// Cameras.
    pub cameras: Option<Box<CameraSender>>,
    /// A satellite receiver and an autopilot.
    pub receivers: Option<Box<ReceiverSender>>,
}

impl Sensing {
    fn captures_at(&self, tick: u64) -> bool {
        self.cameras
            .as_ref()
            .is_some_and(|cameras| cameras.captures_at(tick))
    }

    fn due_ns(&self) -> u64 {
        let cameras = self.cameras.as_ref().map_or(u64::MAX, |cameras| cameras.due_ns());
        let receivers = self
            .receivers
            .as_ref()
            .map_or(u64::MAX, |receivers| receivers.due_ns());
        cameras.min(receivers)
    }

    fn send(&mut self, now_ns: u64) {
        if let Some(cameras) = &mut self.cameras {
            cameras.send(now_ns);
        }
        if let Some(receivers) = &mut self.receivers {
            receivers.send(now_ns);
        }
    }

    fn late(&self) -> LateCaptures {
        let cameras = self.cameras.as_ref().map(|cameras| cameras.late());
        let receivers = self.receivers.as_ref().map(|receivers| receivers.late());
        let [cameras, receivers] = [cameras, receivers].map(Option::unwrap_or_default);
        LateCaptures {
            count: cameras.count + receivers.count,
            worst_ns: cameras.worst_ns.max(receivers.worst_ns),
        }
    }

    fn sent(&self) -> u64 {
        let cameras = self.cameras.as_ref().map_or(0, |cameras| cameras.sent());
        let receivers = self.receivers.as_ref().map_or(0, |receivers| receivers.sent());
        cameras + receivers
    }
}

/// Hardware-in-the-loop simulator.
pub struct HilSimulator {
    clock: FlightClock,
    vehicle: SimulatedVehicle,
    onboard: Autopilot,
    sensing: Sensing,
    record: Record,
    /// `None` for a vehicle that reports no battery.
    battery: Option<SimulatedBattery>,
    /// `true` if a hand moves the vehicle.
    is_by_hand: bool,
}

impl HilSimulator {
    /// Makes the simulator of a scenario.
    ///
    /// # Errors
    /// [`BuildError`] if the plant does not support the scenario.
    pub fn new(
        scenario: &Scenario,
        clock: FlightClock,
        onboard: Autopilot,
        sensing: Sensing,
        record: Record,
    ) -> Result<Self, BuildError> {
        Ok(Self {
            clock,
            vehicle: SimulatedVehicle::new(scenario)?,
            onboard,
            sensing,
            record,
            battery: SimulatedBattery::new(scenario),
            is_by_hand: false,
        })
    }

    /// Lets a hand move the vehicle ([`hand`]).
    #[must_use]
    pub fn moved_by_hand(mut self) -> Self {
        self.is_by_hand = true;
        self
    }

    /// Runs for `ticks` ticks, or until an interrupt. Calls `when_late` at the first capture that is sent late.
    ///
    /// # Errors
    /// [`LogError`] if the log cannot be written.
    ///
    /// # Panics
    /// Never: the bounds of the histogram are valid.
    pub fn run(
        mut self,
        ticks: u64,
        interrupt: &Interrupt,
        when_late: impl FnOnce(LateCaptures),
    ) -> Result<HilReport, LogError> {
        let mut when_late = Some(when_late);
        let mut lateness_ns =
            Histogram::new_with_bounds(1000, LATEST_NS, 3).expect("the bounds of a histogram");
        let mut simulated = 0;
        while simulated < ticks && interrupt.signal().is_none() {
            let begins_ns = self.clock.begins_at(simulated);
            self.exchange_until(begins_ns);
            let late_ns = monotonic_ns().saturating_sub(begins_ns);
            lateness_ns.saturating_record(late_ns.clamp(1, LATEST_NS));
            self.step(simulated, begins_ns);
            simulated += 1;
            let late = self.sensing.late();
            if let Some(when_late) = when_late.take_if(|_| late.count > 0) {
                when_late(late);
            }
        }
        let received = self.onboard.received();
        self.record.finish()?;
        Ok(HilReport {
            ticks: simulated,
            lateness_ns,
            poses: self.sensing.sent(),
            late: self.sensing.late(),
            received,
            signal: interrupt.signal(),
        })
    }

    /// Receives frames and sends poses until a time, ns of `CLOCK_MONOTONIC`.
    fn exchange_until(&mut self, at_ns: u64) {
        loop {
            let until_ns = at_ns.min(self.sensing.due_ns());
            self.onboard.listen_until(until_ns);
            self.sensing.send(monotonic_ns());
            if until_ns == at_ns {
                return;
            }
        }
    }

    fn step(&mut self, tick: u64, begins_ns: u64) {
        // The step covers the time since the previous tick: a frame that acts for more than half of it acts in all of it.
        let frame = self
            .onboard
            .acting(begins_ns.saturating_sub(self.clock.tick_ns / 2));
        let is_captured = self.sensing.captures_at(tick);
        let (mut truth, mut pose, measured) =
            self.vehicle
                .step(tick, self.clock.tick_ns, frame.as_ref(), is_captured);
        if self.is_by_hand {
            let moved = hand::at(seconds(tick * self.clock.tick_ns));
            hand::apply(&moved, &mut truth.position_world, &mut truth.world_from_body);
            if let Some(pose) = &mut pose {
                hand::apply(&moved, &mut pose.position_world, &mut pose.world_from_body);
            }
        }
        self.onboard.update_sensors(&truth);
        let battery = self.battery.as_mut();
        if let Some(voltage) = battery.and_then(|battery| battery.advance(&truth, self.clock.tick_ns)) {
            self.onboard.report_battery(voltage);
        }
        let Sensing { cameras, receivers } = &mut self.sensing;
        if let (Some(cameras), Some(pose)) = (cameras, &pose) {
            cameras.schedule(pose, self.clock.start_ns + pose.capture_time_ns);
        }
        if let Some(receivers) = receivers {
            receivers.schedule(&measured, begins_ns, self.clock.start_ns);
        }
        self.record.push(RecordedTick { truth, pose, frame });
    }
}
