//! A point to hover at.

use nalgebra::Vector3;

use super::CurvePoint;

/// pd(γ) = position, for all γ.
#[derive(Clone, Debug, PartialEq)]
pub struct Hover {
    position: Vector3<f64>,
}

impl Hover {
    #[must_use]
    pub fn new(parameters: &scenario::Hover) -> Self {
        Self {
            position: Vector3::from(parameters.position),
        }
    }

    /// Returns pd(γ) and its derivatives, which are zero.
    #[must_use]
    pub fn at(&self, _gamma: f64) -> CurvePoint {
        CurvePoint::at_rest(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn hovering_stays_at_the_point(gamma: f64, position: [f64; 3]) {
            let orders = Hover::new(&scenario::Hover { position }).at(gamma).orders();
            prop_assert_eq!(orders[0], Vector3::from(position));
            prop_assert_eq!(&orders[1..], &[Vector3::zeros(); 4]);
        }
    }
}
