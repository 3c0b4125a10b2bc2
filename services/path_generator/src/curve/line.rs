//! An infinite straight line.

use nalgebra::Vector3;

use super::CurvePoint;

/// pd(γ) = start + direction γ.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    start: Vector3<f64>,
    direction: Vector3<f64>,
}

impl Line {
    #[must_use]
    pub fn new(parameters: &scenario::Line) -> Self {
        Self {
            start: Vector3::from(parameters.start),
            direction: Vector3::from(parameters.direction),
        }
    }

    /// Returns pd(γ) and its derivatives.
    #[must_use]
    pub fn at(&self, gamma: f64) -> CurvePoint {
        CurvePoint {
            derivative1: self.direction,
            ..CurvePoint::at_rest(self.start + self.direction * gamma)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::testing::distance_to_taylor;
    use crate::taylor::Taylor;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_derivatives_are_those_of_the_line(
            gamma in -1e3..1e3f64,
            start in proptest::array::uniform3(-1e3..1e3f64),
            direction in proptest::array::uniform3(-1e3..1e3f64),
        ) {
            let expected = [0, 1, 2].map(|axis| {
                Taylor::variable(gamma) * direction[axis] + Taylor::constant(start[axis])
            });
            let line = Line::new(&scenario::Line { start, direction });
            prop_assert_eq!(distance_to_taylor(&line.at(gamma), expected), 0.0);
        }
    }
}
