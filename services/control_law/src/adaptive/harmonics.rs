//! Harmonics: the part of the disturbance that repeats with the path (not in the paper).
//!
//! b(γ) = b0 + Σ φk(γ) ak, with φ2j−1 = cos(j w γ) and φ2j = sin(j w γ) for j = 1 … N, w the frequency of the path, and ak
//! constant. The law uses π(b̂) + Σ φk âk for b, and the estimators are
//!
//! ```text
//!     dâk/dt = λa φk (z2 + κε)                          dŵk/dt = β Λw φk Wbᵀ z3
//! ```
//!
//! where Wb are the columns of W in (20) that belong to J1 b, J2 b and J3 b, and ŵk estimates J1 ak, J2 ak and J3 ak. Their
//! terms cancel in V̇n as those of b̂ and ŵ do, so that Theorem 1 stands.

use nalgebra::Vector3;
use scenario::Scenario;
use zerocopy::FromZeros;

use crate::adaptive::evaluation::Evaluation;
use crate::adaptive::repeating::{InertiaTimesDisturbance, Repeating};

/// Largest number of harmonics N.
pub const MAX_COUNT: usize = scenario::Harmonics::MAX as usize;

/// Largest number of the functions φ.
pub const FUNCTIONS: usize = 2 * MAX_COUNT;

/// First of the elements of w that hold J1 b, J2 b and J3 b.
const OF_DISTURBANCE: usize = 6;

/// Estimators of the harmonics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Harmonics {
    /// N.
    pub count: usize,
    /// w, rad per unit of γ.
    pub frequency: f64,
    /// λa.
    pub gain: f64,
    /// Largest ‖z1‖ at which they adapt, m: farther away, or where the path slows down, the motion does not repeat.
    pub radius: f64,
    /// âk in {I}, m/s².
    pub amplitudes_world: [Vector3<f64>; FUNCTIONS],
    /// ŵk.
    pub w: [InertiaTimesDisturbance; FUNCTIONS],
    /// Input since the last step.
    pub signal: AdaptationSignal,
}

shared_types::sample! {
    /// State of the estimators.
    pub struct HarmonicsState {
        /// Estimates of each function.
        pub estimates: [HarmonicEstimate; FUNCTIONS],
        /// Input since the last step.
        pub signal: AdaptationSignal,
    }

    /// Estimates of a function φk.
    pub struct HarmonicEstimate {
        /// âk in {I}, m/s².
        pub amplitude_world: [f64; 3],
        /// ŵk.
        pub w: [f64; 9],
    }

    /// Input of the estimators; held until the next step. With zeros the estimates stay.
    pub struct AdaptationSignal {
        /// γ.
        pub gamma: f64,
        /// z2 + κε in {I}, m/s.
        pub composite_error_world: [f64; 3],
        /// β Λw Wbᵀ z3.
        pub w_rate: [f64; 9],
    }
}

impl AdaptationSignal {
    /// Returns the signal of an evaluation at γ.
    #[must_use]
    pub fn new(evaluation: &Evaluation, gamma: f64) -> Self {
        Self {
            gamma,
            composite_error_world: evaluation.composite_error.into(),
            w_rate: InertiaTimesDisturbance::from(evaluation.rates.w.fixed_rows::<9>(OF_DISTURBANCE)).into(),
        }
    }
}

impl From<&Harmonics> for HarmonicsState {
    fn from(harmonics: &Harmonics) -> Self {
        let Harmonics {
            amplitudes_world,
            w,
            signal,
            ..
        } = harmonics;
        Self {
            estimates: std::array::from_fn(|index| HarmonicEstimate {
                amplitude_world: amplitudes_world[index].into(),
                w: w[index].into(),
            }),
            signal: *signal,
        }
    }
}

impl Harmonics {
    /// Makes estimators that begin with zero: `count` harmonics of `frequency` (rad per unit of γ), with the gain λa.
    #[must_use]
    pub fn new(count: usize, frequency: f64, gain: f64) -> Self {
        Self {
            count: count.min(MAX_COUNT),
            frequency,
            gain,
            radius: f64::INFINITY,
            amplitudes_world: [Vector3::zeros(); FUNCTIONS],
            w: [Repeating::NOTHING.w; FUNCTIONS],
            signal: AdaptationSignal::new_zeroed(),
        }
    }

    /// Makes those of a checked scenario; `None` if it states none.
    #[must_use]
    pub fn from_scenario(scenario: &Scenario) -> Option<Self> {
        let stated = scenario.controller.harmonics.as_ref()?;
        let frequency = scenario.path.curve.frequency()?;
        Some(Self {
            radius: stated.within.min(scenario.path.alpha1),
            ..Self::new(usize::from(stated.count), frequency, stated.gain)
        })
    }

    /// Returns φ and φ′ of each function, in their order.
    fn functions(&self, gamma: f64) -> impl Iterator<Item = [f64; 2]> + use<> {
        let (sine, cosine) = libm::sincos(self.frequency * gamma);
        let frequency = self.frequency;
        let mut turn = [1.0, 0.0];
        (1..=self.count).flat_map(move |order| {
            let [c, s] = turn;
            turn = [c * cosine - s * sine, s * cosine + c * sine];
            let [c, s] = turn;
            let slope = frequency * order as f64;
            [[c, -slope * s], [s, slope * c]]
        })
    }

    /// Sets the signal to that of an evaluation at γ, or far from the path to zero.
    pub fn set_signal(&mut self, evaluation: &Evaluation, gamma: f64) {
        self.signal = if evaluation.z1.norm() > self.radius {
            AdaptationSignal::new_zeroed()
        } else {
            AdaptationSignal::new(evaluation, gamma)
        };
    }

    /// Discards the signal of the last step.
    pub fn discard(&mut self) {
        self.signal = AdaptationSignal::new_zeroed();
    }

    /// Steps over the `elapsed` seconds since the last step, whose signal ends.
    pub fn advance(&mut self, elapsed: f64) {
        let signal = self.signal;
        self.integrate(&signal, elapsed);
        self.discard();
    }

    /// Restores a saved state.
    pub fn restore(&mut self, state: &HarmonicsState) {
        self.amplitudes_world = state.estimates.map(|estimate| estimate.amplitude_world.into());
        self.w = state.estimates.map(|estimate| estimate.w.into());
        self.signal = state.signal;
    }

    /// Returns the repeating part at γ, while the path advances at γ̇.
    #[must_use]
    pub fn at(&self, gamma: f64, gamma_dot: f64) -> Repeating {
        let mut part = Repeating {
            gain: self.gain * self.count as f64,
            ..Repeating::NOTHING
        };
        let estimates = self.amplitudes_world.iter().zip(&self.w);
        for ([value, slope], (amplitude, w)) in self.functions(gamma).zip(estimates) {
            part.disturbance_world += amplitude * value;
            part.rate_world += amplitude * (slope * gamma_dot);
            part.w += w * value;
        }
        part
    }

    /// Steps by `elapsed` seconds with a signal: a step of the explicit Euler method. Estimates that would not be finite
    /// stay.
    pub fn integrate(&mut self, signal: &AdaptationSignal, elapsed: f64) {
        let before = *self;
        let composite_error = Vector3::from(signal.composite_error_world);
        let w_rate = InertiaTimesDisturbance::from(signal.w_rate);
        let functions = self.functions(signal.gamma);
        let estimates = self.amplitudes_world.iter_mut().zip(&mut self.w);
        for ([value, _], (amplitude, w)) in functions.zip(estimates) {
            *amplitude += composite_error * (self.gain * value * elapsed);
            *w += w_rate * (value * elapsed);
        }
        let is_finite = |numbers: &[f64]| numbers.iter().all(|number| number.is_finite());
        let estimates = self.amplitudes_world.iter().zip(&self.w);
        if !estimates
            .into_iter()
            .all(|(a, w)| is_finite(a.as_slice()) && is_finite(w.as_slice()))
        {
            *self = before;
        }
    }
}
