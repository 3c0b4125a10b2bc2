//! Radio link: calibration, resolution and frames of commands.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{LinkBattery, RadioProtocol, Transmitter, Vector};
use crate::range::{between, not_zero};

/// Radio link: calibration of the sticks, resolution, and frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RcLink {
    /// Thrust at a thrust channel of 0, N.
    pub thrust_offset: f64,
    /// Thrust per unit of the thrust channel, N.
    #[schemars(transform = not_zero, extend("x-hint" = "a negative slope reverses the channel"))]
    pub thrust_slope: f64,
    /// Body rate about each axis per unit of its channel, rad/s; negative in the paper.
    #[schemars(transform = not_zero, transform = between(-60.0, 60.0), extend("x-hint" = "in rad/s: 1000 °/s are 17.45; a negative slope reverses the channel"))]
    pub rate_slope: Vector,
    /// Range of the thrust channel; the paper states [0, 1], with which its vehicle could not hover.
    #[schemars(transform = between(-1.0, 1.0))]
    pub thrust_range: [f64; 2],
    /// Range of each rate channel.
    #[schemars(transform = between(-1.0, 1.0))]
    pub rate_range: [f64; 2],
    /// Resolution of the link from −1 to 1, bits.
    #[schemars(transform = between(1, 16), extend("x-hint" = "11 is usual"))]
    pub resolution: u32,
    /// Radio link of frames in real time; simulated unless stated, and always in simulated time.
    #[serde(skip_serializing_if = "RadioProtocol::is_simulated")]
    pub link: RadioProtocol,
    /// The transmitter of a laboratory; none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transmitter: Option<Transmitter>,
    /// Battery of the vehicle; its voltage is not corrected for unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub battery: Option<LinkBattery>,
}

impl Default for RcLink {
    fn default() -> Self {
        Self {
            thrust_offset: 2.3071,
            thrust_slope: 3.138,
            rate_slope: [-19.0, -19.0, -8.0],
            thrust_range: [-1.0, 1.0],
            rate_range: [-1.0, 1.0],
            resolution: 11,
            link: RadioProtocol::Simulated,
            transmitter: None,
            battery: None,
        }
    }
}

impl RcLink {
    /// Returns the minimum and maximum thrust of a frame, N; never below 0.
    #[must_use]
    pub fn thrust_limits(&self) -> [f64; 2] {
        let [a, b] = self
            .thrust_range
            .map(|channel| (self.thrust_offset + self.thrust_slope * channel).max(0.0));
        [a.min(b), a.max(b)]
    }

    /// Returns the maximum body rate of a frame about each axis in both directions, rad/s.
    #[must_use]
    pub fn rate_limits(&self) -> Vector {
        let reach = self.rate_range[0].abs().min(self.rate_range[1].abs());
        self.rate_slope.map(|slope| slope.abs() * reach)
    }
}
