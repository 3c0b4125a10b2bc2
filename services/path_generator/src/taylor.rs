//! Taylor arithmetic for tests: a function's value and first four derivatives, exact to rounding.
//!
//! A law written in these numbers exactly as in the paper yields its derivatives without a derivation by hand.

use std::ops::{Add, Div, Mul, Sub};

const TERMS: usize = 5;

/// The coefficients f⁽ᵏ⁾/k! of a function at a point, k = 0..4.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taylor([f64; TERMS]);

impl Taylor {
    pub(crate) fn constant(value: f64) -> Self {
        Self([value, 0.0, 0.0, 0.0, 0.0])
    }

    /// Makes the variable of the derivatives.
    pub(crate) fn variable(value: f64) -> Self {
        Self([value, 1.0, 0.0, 0.0, 0.0])
    }

    /// Returns the derivative of an order; of order 0 the value.
    pub(crate) fn derivative(&self, order: usize) -> f64 {
        [1.0, 1.0, 2.0, 6.0, 24.0][order] * self.0[order]
    }

    /// Returns coefficient `order` of the function y with y′ = w x′, where x is `self`.
    fn chain(&self, w: &Self, order: usize) -> f64 {
        let terms = (1..=order).map(|k| k as f64 * self.0[k] * w.0[order - k]);
        terms.sum::<f64>() / order as f64
    }

    pub(crate) fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = libm::sincos(self.0[0]);
        let (mut sine, mut cosine) = (Self::constant(sine), Self::constant(cosine));
        for order in 1..TERMS {
            (sine.0[order], cosine.0[order]) = (self.chain(&cosine, order), -self.chain(&sine, order));
        }
        (sine, cosine)
    }

    /// Returns tanh, of full relative accuracy also in the derivatives: w = 1/cosh² has no cancellation.
    pub(crate) fn tanh(self) -> Self {
        let cosh = libm::cosh(self.0[0]);
        let (mut y, mut w) = (
            Self::constant(libm::tanh(self.0[0])),
            Self::constant(1.0 / (cosh * cosh)),
        );
        for order in 1..TERMS {
            y.0[order] = self.chain(&w, order);
            w.0[order] = self.chain(&(y * w * -2.0), order);
        }
        y
    }
}

impl Add for Taylor {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }
}

impl Sub for Taylor {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] - other.0[k]))
    }
}

impl Mul<f64> for Taylor {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self(self.0.map(|coefficient| coefficient * factor))
    }
}

impl Mul for Taylor {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|order| {
            (0..=order).map(|k| self.0[k] * other.0[order - k]).sum()
        }))
    }
}

impl Div for Taylor {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let mut quotient = [0.0; TERMS];
        for order in 0..TERMS {
            let known: f64 = (0..order).map(|k| quotient[k] * other.0[order - k]).sum();
            quotient[order] = (self.0[order] - known) / other.0[0];
        }
        Self(quotient)
    }
}
