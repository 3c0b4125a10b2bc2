//! The onboard autopilot, which turns the commands of a flight into actuator commands.

use shared_types::samples::{RcFrame, VehicleTruth};

use super::betaflight::Betaflight;
use super::radio::Radio;
use super::receiver_input::ReceiverInput;

/// The onboard autopilot.
#[derive(Debug)]
pub enum Autopilot {
    /// The scenario's rate loop with a receiver.
    RateLoop(ReceiverInput, Box<Radio>),
    /// Betaflight in a separate process, which contains the receiver.
    Betaflight(Betaflight),
}

/// Counts of received commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AutopilotCommands {
    /// Frames or packets with commands.
    pub frames: u64,
    /// Bytes outside of valid frames.
    pub skipped: u64,
    /// Link losses, after which the motors were stopped.
    pub losses: u64,
}

impl Autopilot {
    /// Receives commands until a time, ns of `CLOCK_MONOTONIC`.
    pub(super) fn listen_until(&mut self, until_ns: u64) {
        match self {
            Self::RateLoop(line, radio) => {
                line.listen_until(until_ns, &mut |bytes, now_ns| radio.receive(bytes, now_ns));
            }
            Self::Betaflight(betaflight) => betaflight.listen_until(until_ns),
        }
    }

    /// Returns the frame that begins to act at a time, if any.
    pub(super) fn acting(&mut self, at_ns: u64) -> Option<RcFrame> {
        match self {
            Self::RateLoop(_, radio) => radio.acting(at_ns),
            Self::Betaflight(betaflight) => Some(betaflight.acting(at_ns)),
        }
    }

    /// Updates the sensor readings.
    pub(super) fn update_sensors(&mut self, truth: &VehicleTruth) {
        match self {
            Self::RateLoop(_, radio) => radio.update_sensors(truth),
            Self::Betaflight(betaflight) => betaflight.update_sensors(truth),
        }
    }

    /// Sends the battery's voltage, V, back over the link, if its protocol has telemetry here.
    pub(super) fn report_battery(&mut self, voltage: f64) {
        if let Self::RateLoop(line, radio) = self {
            line.report_battery(radio.protocol(), voltage);
        }
    }

    /// Returns the counts of received commands.
    #[must_use]
    pub fn received(&self) -> AutopilotCommands {
        match self {
            Self::RateLoop(_, radio) => AutopilotCommands {
                frames: radio.received().frames,
                skipped: radio.received().skipped,
                losses: radio.losses(),
            },
            Self::Betaflight(betaflight) => {
                let [frames, losses] = betaflight.counts();
                AutopilotCommands {
                    frames,
                    skipped: 0,
                    losses,
                }
            }
        }
    }
}
