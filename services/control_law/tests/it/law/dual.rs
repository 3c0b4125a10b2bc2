//! Dual numbers: quantities of a flow with their rates of change, by the exact product and chain rules. Derivatives by
//! them have no truncation error.

use std::ops::{Add, Mul, Neg, Sub};

use nalgebra::{Matrix3, Vector3};

/// A quantity and its rate of change: a number, a vector or a matrix.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual<T> {
    pub(crate) value: T,
    pub(crate) rate: T,
}

impl<T: Copy + Mul<f64, Output = T>> Dual<T> {
    /// Makes a quantity that does not change.
    pub(crate) fn constant(value: T) -> Self {
        Self {
            value,
            rate: value * 0.0,
        }
    }
}

impl<T: Add<Output = T>> Add for Dual<T> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            rate: self.rate + other.rate,
        }
    }
}

impl<T: Sub<Output = T>> Sub for Dual<T> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self {
            value: self.value - other.value,
            rate: self.rate - other.rate,
        }
    }
}

impl<T: Neg<Output = T>> Neg for Dual<T> {
    type Output = Self;
    fn neg(self) -> Self {
        Self {
            value: -self.value,
            rate: -self.rate,
        }
    }
}

/// The product rule, for every product there is.
impl<A: Copy + Mul<B, Output = C>, B: Copy, C: Add<Output = C>> Mul<Dual<B>> for Dual<A> {
    type Output = Dual<C>;
    fn mul(self, other: Dual<B>) -> Dual<C> {
        Dual {
            value: self.value * other.value,
            rate: self.rate * other.value + self.value * other.rate,
        }
    }
}

/// A product with a constant number.
impl<T: Mul<f64, Output = T>> Mul<f64> for Dual<T> {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self {
            value: self.value * factor,
            rate: self.rate * factor,
        }
    }
}

impl Dual<f64> {
    pub(crate) fn reciprocal(self) -> Self {
        let value = 1.0 / self.value;
        Self {
            value,
            rate: -self.rate * value * value,
        }
    }

    pub(crate) fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Self {
            value,
            rate: 0.5 * self.rate / value,
        }
    }

    pub(crate) fn tanh(self) -> Self {
        Self {
            value: libm::tanh(self.value),
            rate: self.rate * sech_squared(self.value),
        }
    }

    /// 1/cosh².
    pub(crate) fn sech_squared(self) -> Self {
        let value = sech_squared(self.value);
        Self {
            value,
            rate: -2.0 * self.rate * value * libm::tanh(self.value),
        }
    }
}

impl Dual<Vector3<f64>> {
    pub(crate) fn dot(self, other: Self) -> Dual<f64> {
        Dual {
            value: self.value.dot(&other.value),
            rate: self.rate.dot(&other.value) + self.value.dot(&other.rate),
        }
    }

    pub(crate) fn component_mul(self, other: Self) -> Self {
        Self {
            value: self.value.component_mul(&other.value),
            rate: self.rate.component_mul(&other.value) + self.value.component_mul(&other.rate),
        }
    }

    pub(crate) fn element(self, axis: usize) -> Dual<f64> {
        Dual {
            value: self.value[axis],
            rate: self.rate[axis],
        }
    }

    pub(crate) fn from_elements(elements: [Dual<f64>; 3]) -> Self {
        Self {
            value: Vector3::from(elements.map(|element| element.value)),
            rate: Vector3::from(elements.map(|element| element.rate)),
        }
    }

    pub(crate) fn map(self, function: impl Fn(Dual<f64>) -> Dual<f64>) -> Self {
        Self::from_elements([0, 1, 2].map(|axis| function(self.element(axis))))
    }
}

impl Dual<Matrix3<f64>> {
    pub(crate) fn transpose(self) -> Self {
        Self {
            value: self.value.transpose(),
            rate: self.rate.transpose(),
        }
    }
}

/// 1/cosh²(x) without the cancellation of 1 − tanh²(x).
fn sech_squared(x: f64) -> f64 {
    let decay = libm::exp(-2.0 * x.abs());
    4.0 * decay / ((1.0 + decay) * (1.0 + decay))
}
