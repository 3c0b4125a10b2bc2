//! Thrust of a sent travel, from calibration, ends and reversal.

use super::{RcLink, Transmitter};

/// Thrust channel of a radio link, from the sent travel to the thrust.
///
/// "Motors off" is stated as thrust, because its travel may be at either end of the channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrustChannel {
    /// Sent travels of the stick's −1 and 1.
    ends: [f64; 2],
    /// Thrust at a stick of 0, N, and per unit of its travel.
    calibration: [f64; 2],
}

impl ThrustChannel {
    /// Makes the thrust channel of a link.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter) -> Self {
        let [low, high] = transmitter.thrust_ends;
        Self {
            ends: if transmitter.reversed.contains('T') {
                [high, low]
            } else {
                [low, high]
            },
            calibration: [link.thrust_offset, link.thrust_slope],
        }
    }

    /// Returns the thrust of a sent travel, N; the motors are off at 0 and below.
    #[must_use]
    pub fn thrust(&self, sent: f64) -> f64 {
        let ([low, high], [offset, slope]) = (self.ends, self.calibration);
        offset + slope * (2.0 * (sent - low) / (high - low) - 1.0)
    }

    /// Returns the sent travel of the least thrust: the end of the stick or −100 or 100 % of the link, whichever is further.
    #[must_use]
    pub fn motors_off(&self) -> f64 {
        let ([low, high], [_, slope]) = (self.ends, self.calibration);
        let end = if slope > 0.0 { low } else { high };
        if (high - low) * slope > 0.0 {
            end.min(-1.0)
        } else {
            end.max(1.0)
        }
    }
}
