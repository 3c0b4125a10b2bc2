//! Curves pd(γ), at least C⁴ with bounded derivatives, as section II of the paper requires.

mod circle;
mod hover;
mod line;
mod lissajous;
mod tilted_eight;
mod waypoints;

use nalgebra::{Matrix3, Vector3};

pub use circle::Circle;
pub use hover::Hover;
pub use line::Line;
pub use lissajous::Lissajous;
pub use tilted_eight::TiltedEight;
pub use waypoints::Waypoints;

/// A point of a curve with its γ-derivatives, all in {I}, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// pd(γ).
    pub position: Vector3<f64>,
    /// pd′ = dpd/dγ.
    pub derivative1: Vector3<f64>,
    /// pd″ = d²pd/dγ².
    pub derivative2: Vector3<f64>,
    /// pd‴ = d³pd/dγ³.
    pub derivative3: Vector3<f64>,
    /// d⁴pd/dγ⁴.
    pub derivative4: Vector3<f64>,
}

impl CurvePoint {
    /// Returns a point with all derivatives zero.
    pub(crate) fn at_rest(position: Vector3<f64>) -> Self {
        Self {
            position,
            derivative1: Vector3::zeros(),
            derivative2: Vector3::zeros(),
            derivative3: Vector3::zeros(),
            derivative4: Vector3::zeros(),
        }
    }

    /// Returns the point of the curve rotated about the origin.
    fn turned(&self, rotation: &Matrix3<f64>) -> Self {
        Self {
            position: rotation * self.position,
            derivative1: rotation * self.derivative1,
            derivative2: rotation * self.derivative2,
            derivative3: rotation * self.derivative3,
            derivative4: rotation * self.derivative4,
        }
    }
}

/// Errors of the parameters of a curve.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// Fewer waypoints than the curve needs.
    #[error("{found} waypoints are too few: give at least {needed}")]
    TooFewPoints {
        /// Number of waypoints.
        found: usize,
        /// Number of waypoints that an open or a closed curve needs.
        needed: usize,
    },
    /// A waypoint is not finite.
    #[error("waypoint {index} is not finite: give three numbers in metres")]
    PointNotFinite {
        /// Index in the list.
        index: usize,
    },
    /// Two successive waypoints coincide.
    #[error("waypoint {index} and the one after it are the same point: leave one of them out")]
    CoincidentPoints {
        /// Index of the first one in the list.
        index: usize,
    },
    /// The interval of γ between waypoints is not positive.
    #[error("the interval {0} between waypoints is not positive: choose one above 0")]
    Interval(f64),
}

/// Curve of a scenario.
#[derive(Clone, Debug, PartialEq)]
pub enum Curve {
    /// The paper's tilted figure of eight (27).
    TiltedEight(TiltedEight),
    /// A point to hover at.
    Hover(Hover),
    /// A tilted circle.
    Circle(Circle),
    /// An infinite straight line.
    Line(Line),
    /// An oscillation along each axis.
    Lissajous(Lissajous),
    /// A smooth curve through points.
    Waypoints(Waypoints),
}

impl Curve {
    /// Makes the curve of a scenario.
    ///
    /// # Errors
    /// [`CurveError`] if the parameters are invalid.
    pub fn new(parameters: &scenario::Curve) -> Result<Self, CurveError> {
        Ok(match parameters {
            scenario::Curve::TiltedEight(parameters) => Self::TiltedEight(TiltedEight::new(parameters)),
            scenario::Curve::Hover(parameters) => Self::Hover(Hover::new(parameters)),
            scenario::Curve::Circle(parameters) => Self::Circle(Circle::new(parameters)),
            scenario::Curve::Line(parameters) => Self::Line(Line::new(parameters)),
            scenario::Curve::Lissajous(parameters) => Self::Lissajous(Lissajous::new(parameters)),
            scenario::Curve::Waypoints(parameters) => Self::Waypoints(Waypoints::new(parameters)?),
        })
    }

    /// Returns pd(γ) and its derivatives.
    #[must_use]
    #[inline]
    pub fn at(&self, gamma: f64) -> CurvePoint {
        match self {
            Self::TiltedEight(curve) => curve.at(gamma),
            Self::Hover(curve) => curve.at(gamma),
            Self::Circle(curve) => curve.at(gamma),
            Self::Line(curve) => curve.at(gamma),
            Self::Lissajous(curve) => curve.at(gamma),
            Self::Waypoints(curve) => curve.at(gamma),
        }
    }
}

#[cfg(test)]
mod testing {
    use super::CurvePoint;
    use crate::taylor::Taylor;
    use nalgebra::Vector3;

    impl CurvePoint {
        /// Position and derivatives in order.
        pub(super) fn orders(&self) -> [Vector3<f64>; 5] {
            [
                self.position,
                self.derivative1,
                self.derivative2,
                self.derivative3,
                self.derivative4,
            ]
        }
    }

    /// Largest difference between a point and its three coordinates in Taylor arithmetic, any order.
    pub(super) fn distance_to_taylor(point: &CurvePoint, coordinates: [Taylor; 3]) -> f64 {
        let orders = point.orders();
        let differences = coordinates.iter().enumerate().flat_map(|(axis, coordinate)| {
            (0..5).map(move |order| (orders[order][axis] - coordinate.derivative(order)).abs())
        });
        differences.fold(0.0, f64::max)
    }
}
