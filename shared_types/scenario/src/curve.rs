//! Curves of paths.

use std::f64::consts::PI;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vector;
use crate::range::{angle, positive};

/// A curve pd(γ) in {I}, at least C⁴ with bounded derivatives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Curve {
    /// The paper's tilted figure of eight (27): Rx(tilt) [ℓ sin wγ cos wγ, ℓ sin wγ, −height]ᵀ.
    TiltedEight(TiltedEight),
    /// A point to hover at.
    Hover(Hover),
    /// A tilted circle.
    Circle(Circle),
    /// An infinite straight line.
    Line(Line),
    /// A Lissajous figure: an oscillation along each axis, such as a bob up and down.
    Lissajous(Lissajous),
    /// A smooth curve through points, from rest at the first to rest at the last, or closed.
    Waypoints(Waypoints),
}

/// The paper's tilted figure of eight (27).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TiltedEight {
    /// ℓ, m.
    #[schemars(transform = positive, extend("x-symbol" = "ℓ"))]
    pub size: f64,
    /// w, rad per unit of γ.
    #[schemars(transform = positive, extend("x-symbol" = "w"))]
    pub frequency: f64,
    /// Height of the centre above the origin before the tilt, m.
    pub height: f64,
    /// Angle of the tilt about x, rad.
    #[schemars(transform = angle)]
    pub tilt: f64,
}

impl Default for TiltedEight {
    fn default() -> Self {
        Self {
            size: 1.2,
            frequency: 0.6,
            height: 1.2,
            tilt: PI / 20.0,
        }
    }
}

/// A point to hover at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hover {
    /// The point in {I}, m.
    pub position: Vector,
}

/// Rx(tilt) [r cos wγ, r sin wγ, 0]ᵀ + centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Circle {
    /// Centre in {I}, m.
    pub center: Vector,
    /// r, m.
    #[schemars(transform = positive, extend("x-symbol" = "r"))]
    pub radius: f64,
    /// w, rad per unit of γ.
    #[serde(default = "default::circle_frequency")]
    #[schemars(transform = positive, extend("x-symbol" = "w"))]
    pub frequency: f64,
    /// Angle of the tilt about x, rad.
    #[serde(default)]
    #[schemars(transform = angle)]
    pub tilt: f64,
}

/// start + direction γ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// The point at γ = 0 in {I}, m.
    pub start: Vector,
    /// Displacement per unit of γ in {I}, m.
    pub direction: Vector,
}

/// center + amplitude ∘ sin(frequency γ + phase), along each axis of {I}.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lissajous {
    /// Centre in {I}, m.
    pub center: Vector,
    /// Amplitudes, m.
    pub amplitude: Vector,
    /// Frequencies, rad per unit of γ.
    pub frequency: Vector,
    /// Phases at γ = 0, rad.
    #[serde(default)]
    pub phase: Vector,
}

/// A smooth curve through points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Waypoints {
    /// Points in {I}, m: at least two, or three for a closed curve; neighbours must not coincide.
    pub points: Vec<Vector>,
    /// `true` if the curve returns from the last point to the first.
    pub closed: bool,
    /// γ from one point to the next.
    #[schemars(transform = positive)]
    pub interval: f64,
    /// File in place of `points`, relative to the scenario's: CSV with the columns `x,y,z` or `duration,x^0,…`, z up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// SHA-256 of the file; another file is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Displacement of the file's points in {I}, m, such as `[0.0, 0.0, -1.0]` for 1 m higher.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<Vector>,
}

/// Distance along each axis below which two waypoints are the same, m: less than any motion capture resolves.
const COINCIDENT: f64 = 1e-6;

impl Waypoints {
    /// Returns whether two points of a path coincide.
    #[must_use]
    pub fn coincide(a: &Vector, b: &Vector) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < COINCIDENT)
    }
}

impl Default for Waypoints {
    fn default() -> Self {
        Self {
            points: Vec::new(),
            closed: false,
            interval: 1.0,
            file: None,
            sha256: None,
            offset: None,
        }
    }
}

impl Curve {
    /// Returns the frequency of a periodic curve, rad per unit of γ; `None` for others.
    #[must_use]
    pub fn frequency(&self) -> Option<f64> {
        match self {
            Self::TiltedEight(eight) => Some(eight.frequency),
            Self::Circle(circle) => Some(circle.frequency),
            Self::Lissajous(figure) => figure.common_frequency(),
            Self::Waypoints(way) if way.closed => Some(2.0 * PI / (way.points.len() as f64 * way.interval)),
            Self::Hover(_) | Self::Line(_) | Self::Waypoints(_) => None,
        }
    }
}

impl Lissajous {
    /// Returns the lowest frequency, if the others are multiples of it.
    fn common_frequency(&self) -> Option<f64> {
        let moving = || {
            self.frequency
                .iter()
                .map(|frequency| frequency.abs())
                .filter(|&frequency| frequency > 0.0)
        };
        let lowest = moving().reduce(f64::min)?;
        let is_multiple =
            |frequency: f64| (frequency / lowest - libm::round(frequency / lowest)).abs() < 1e-9;
        moving().all(is_multiple).then_some(lowest)
    }
}

mod default {
    pub(super) fn circle_frequency() -> f64 {
        1.0
    }
}
