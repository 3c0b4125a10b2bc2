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

use crate::adaptive::evaluation::Evaluation;
use crate::adaptive::repeating::{InertiaTimesDisturbance, Repeating};
use crate::law::{MEMORY, Memory};

/// Largest number of harmonics N.
pub const MOST: usize = 8;

/// Largest number of the functions φ.
pub const FUNCTIONS: usize = 2 * MOST;

/// First of the elements of w that hold J1 b, J2 b and J3 b.
const OF_DISTURBANCE: usize = 6;

/// Estimates, and what they learn: γ, z2 + κε and the rate of w.
const _: () = assert!(12 * FUNCTIONS + 13 <= MEMORY);

/// What a moment of the flight teaches; held until the next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lesson {
    /// γ of the moment.
    pub gamma: f64,
    /// z2 + κε in {I}, m/s.
    pub learned: Vector3<f64>,
    /// β Λw Wbᵀ z3.
    pub w_rate: InertiaTimesDisturbance,
}

impl Lesson {
    /// Nothing to learn.
    pub const NOTHING: Self = Self {
        gamma: 0.0,
        learned: Vector3::new(0.0, 0.0, 0.0),
        w_rate: Repeating::NOTHING.w,
    };

    /// Returns the lesson of an evaluation at γ.
    #[must_use]
    pub fn of(evaluation: &Evaluation, gamma: f64) -> Self {
        Self {
            gamma,
            learned: evaluation.learned,
            w_rate: evaluation.rates.w.fixed_rows::<9>(OF_DISTURBANCE).into(),
        }
    }
}

/// Estimators of the harmonics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Harmonics {
    /// N.
    pub count: usize,
    /// w, rad per unit of γ.
    pub frequency: f64,
    /// λa.
    pub gain: f64,
    /// Largest ‖z1‖ at which they learn, m: farther away, or where the path slows down, the motion does not repeat.
    pub learns_within: f64,
    /// âk in {I}, m/s².
    pub amplitudes_world: [Vector3<f64>; FUNCTIONS],
    /// ŵk.
    pub w: [InertiaTimesDisturbance; FUNCTIONS],
    /// What the last step teaches until the next.
    pub lesson: Lesson,
}

impl Harmonics {
    /// Makes estimators that know nothing yet: `count` harmonics of `frequency` (rad per unit of γ), with the gain λa.
    #[must_use]
    pub fn new(count: usize, frequency: f64, gain: f64) -> Self {
        Self {
            count: count.min(MOST),
            frequency,
            gain,
            learns_within: f64::INFINITY,
            amplitudes_world: [Vector3::zeros(); FUNCTIONS],
            w: [Repeating::NOTHING.w; FUNCTIONS],
            lesson: Lesson::NOTHING,
        }
    }

    /// Makes those of a checked scenario; `None` if it states none.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Option<Self> {
        let stated = scenario.controller.harmonics.as_ref()?;
        let frequency = scenario.path.curve.frequency()?;
        Some(Self {
            learns_within: stated.within.min(scenario.path.alpha1),
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

    /// Keeps what an evaluation at γ teaches until the next step; nothing far from the path.
    pub fn teach(&mut self, evaluation: &Evaluation, gamma: f64) {
        self.lesson = if evaluation.z1.norm() > self.learns_within {
            Lesson::NOTHING
        } else {
            Lesson::of(evaluation, gamma)
        };
    }

    /// Drops what the last step teaches.
    pub fn unlearn(&mut self) {
        self.lesson = Lesson::NOTHING;
    }

    /// Learns for `elapsed` seconds what the last step teaches.
    pub fn advance(&mut self, elapsed: f64) {
        let lesson = self.lesson;
        self.learn(&lesson, elapsed);
        self.unlearn();
    }

    /// The numbers of the state, in their order.
    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let Lesson {
            gamma,
            learned,
            w_rate,
        } = &mut self.lesson;
        let estimates = self.amplitudes_world.iter_mut().flatten();
        estimates
            .chain(self.w.iter_mut().flatten())
            .chain([gamma])
            .chain(learned.iter_mut())
            .chain(w_rate.iter_mut())
    }

    /// Writes the state.
    pub fn save(&self, memory: &mut Memory) {
        let mut state = *self;
        for (kept, number) in memory.iter_mut().zip(state.numbers()) {
            *kept = *number;
        }
    }

    /// Restores a saved state.
    pub fn restore(&mut self, memory: &Memory) {
        for (number, kept) in self.numbers().zip(memory) {
            *number = *kept;
        }
    }

    /// Returns the repeating part at γ, while the path goes on at γ̇.
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

    /// Learns from a lesson for `elapsed` seconds: a step of the explicit Euler method. Estimates that would not be finite
    /// stay.
    pub fn learn(&mut self, lesson: &Lesson, elapsed: f64) {
        let before = *self;
        let functions = self.functions(lesson.gamma);
        let estimates = self.amplitudes_world.iter_mut().zip(&mut self.w);
        for ([value, _], (amplitude, w)) in functions.zip(estimates) {
            *amplitude += lesson.learned * (self.gain * value * elapsed);
            *w += lesson.w_rate * (value * elapsed);
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
