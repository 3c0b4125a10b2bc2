//! The autopilot on board the vehicle, by which the commands of a flight become forces.

use shared_types::samples::{RcFrame, VehicleTruth};

use super::betaflight::Betaflight;
use super::radio::Radio;
use super::receiver_input::ReceiverInput;

/// The autopilot on board.
#[derive(Debug)]
pub enum Autopilot {
    /// The scenario's own rate loop, behind a receiver.
    RateLoop(ReceiverInput, Box<Radio>),
    /// Betaflight, which has the receiver, in a process of its own.
    Betaflight(Betaflight),
}

/// The commands that it has received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AutopilotCommands {
    /// Frames or packets that asked for something.
    pub frames: u64,
    /// Bytes that belonged to none.
    pub skipped: u64,
    /// Number of times that nothing came for so long that the motors were let rest.
    pub losses: u64,
}

impl Autopilot {
    /// Listens until a time has come, ns of `CLOCK_MONOTONIC`.
    pub(super) fn listen_until(&mut self, until_ns: u64) {
        match self {
            Self::RateLoop(line, radio) => {
                line.listen_until(until_ns, &mut |bytes, now_ns| radio.hear(bytes, now_ns));
            }
            Self::Betaflight(betaflight) => betaflight.listen_until(until_ns),
        }
    }

    /// Returns the frame that begins to act at a time, if one does.
    pub(super) fn acting(&mut self, at_ns: u64) -> Option<RcFrame> {
        match self {
            Self::RateLoop(_, radio) => radio.acting(at_ns),
            Self::Betaflight(betaflight) => Some(betaflight.acting(at_ns)),
        }
    }

    /// Returns what its sensors feel.
    pub(super) fn feel(&mut self, truth: &VehicleTruth) {
        if let Self::Betaflight(betaflight) = self {
            betaflight.feel(truth);
        }
    }

    /// The commands that it has received.
    #[must_use]
    pub fn heard(&self) -> AutopilotCommands {
        match self {
            Self::RateLoop(_, radio) => AutopilotCommands {
                frames: radio.heard().frames,
                skipped: radio.heard().skipped,
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
