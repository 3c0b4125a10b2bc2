//! Gusts of the Dryden model (MIL-F-8785C), exact over a tick.
//!
//! White noise n through a first-order filter along the mean wind and two second-order filters across it, τ = L/V:
//!
//! ```text
//!     u = σ √(2τ) / (1 + τs) n            v, w = σ √τ (1 + √3 τs)/(1 + τs)² n
//! ```
//!
//! σ standard deviation, m/s; L length, m; V mean wind, m/s, which carries the frozen turbulence past the vehicle. A
//! transverse filter has the states x1 = n/(1 + τs) and x2 = x1/(1 + τs), and v = σ √τ (√3 x1 + (1 − √3) x2). Over a tick,
//! θ = h/τ, x1 ← e^−θ x1 + e1 and x2 ← e^−θ (x2 + θ x1) + e2. The covariances of e1 and e2 follow from the integrals of
//! e^−2u, u e^−2u and u² e^−2u from 0 to θ; the initial states have those from 0 to ∞, the stationary ones.

use nalgebra::{Matrix3, Vector3};
use shared_types::noise::{Draws, Noise};
use vehicle_model::lag::Lag;

/// Gusts along and across a mean wind.
#[derive(Clone, Debug)]
pub struct Dryden {
    /// Rotation to {I} from the wind frame, whose first axis is along the mean wind.
    world_from_wind: Matrix3<f64>,
    along: Longitudinal,
    across: [Transverse; 2],
    noise: Noise,
    /// States of the filters: one longitudinal, two of each transverse one.
    states: [f64; 5],
}

#[derive(Clone, Copy, Debug)]
struct Longitudinal {
    decay: f64,
    noise_gain: f64,
}

#[derive(Clone, Copy, Debug)]
struct Transverse {
    /// θ.
    theta: f64,
    decay: f64,
    /// σ; the states are in units of 1/√τ.
    deviation: f64,
    /// Lower triangle of the Cholesky factor of the covariance of e1 and e2.
    noise_gain: [f64; 3],
}

impl Dryden {
    /// Makes the gusts about a mean wind (in {I}, m/s; not 0) at tick 0, with ticks of `tick` s.
    #[must_use]
    pub fn new(config: &scenario::Dryden, mean: &Vector3<f64>, tick: f64, mut noise: Noise) -> Self {
        let speed = mean.norm();
        let [tau_along, tau_side, tau_vertical] = config.length.map(|length| length / speed);
        let [along, side, vertical] = config.deviation;
        let lag = Lag::new(tau_along);
        let across = [
            Transverse::new(side, tick / tau_side),
            Transverse::new(vertical, tick / tau_vertical),
        ];
        let mut draws = noise.at(0);
        let [first, _] = draws.normal_pair();
        // An infinite θ gives the stationary covariance.
        let [side_state, vertical_state] =
            across.map(|_| correlated(&covariance_factor(f64::INFINITY), &mut draws));
        Self {
            world_from_wind: along_first(mean),
            along: Longitudinal {
                decay: lag.remaining(tick),
                noise_gain: along * lag.covered(2.0 * tick).sqrt(),
            },
            across,
            states: [
                along * first,
                side_state[0],
                side_state[1],
                vertical_state[0],
                vertical_state[1],
            ],
            noise,
        }
    }

    /// Advances by a tick, to `tick`.
    pub fn advance(&mut self, tick: u64) {
        let mut draws = self.noise.at(tick);
        let [first, _] = draws.normal_pair();
        let [along, across @ ..] = &mut self.states;
        *along = *along * self.along.decay + self.along.noise_gain * first;
        for (filter, state) in self.across.iter().zip(across.chunks_exact_mut(2)) {
            let [e1, e2] = correlated(&filter.noise_gain, &mut draws);
            let [x1, x2] = [state[0], state[1]];
            state[0] = filter.decay * x1 + e1;
            state[1] = filter.decay * (x2 + filter.theta * x1) + e2;
        }
    }

    /// Returns the gust in {I}, m/s.
    #[must_use]
    pub fn value(&self) -> Vector3<f64> {
        let [along, y1, y2, z1, z2] = self.states;
        let [y, z] = [[y1, y2], [z1, z2]];
        self.world_from_wind * Vector3::new(along, self.across[0].gust(y), self.across[1].gust(z))
    }

    /// Returns the states of the filters.
    #[must_use]
    pub fn states(&self) -> [f64; 5] {
        self.states
    }

    /// Restores the states of the filters.
    pub fn restore(&mut self, states: [f64; 5]) {
        self.states = states;
    }
}

impl Transverse {
    fn new(deviation: f64, theta: f64) -> Self {
        Self {
            theta,
            decay: libm::exp(-theta),
            deviation,
            noise_gain: covariance_factor(theta),
        }
    }

    fn gust(&self, [x1, x2]: [f64; 2]) -> f64 {
        let root = 3.0_f64.sqrt();
        self.deviation * (root * x1 + (1.0 - root) * x2)
    }
}

/// Returns elements 11, 21 and 22 of the Cholesky factor of the covariance of e1 and e2 over θ, in units of 1/τ.
fn covariance_factor(theta: f64) -> [f64; 3] {
    let (left, gone) = if theta.is_finite() {
        (libm::exp(-2.0 * theta), -libm::expm1(-2.0 * theta))
    } else {
        (0.0, 1.0)
    };
    let once = if left > 0.0 { 2.0 * theta * left } else { 0.0 };
    let twice = if left > 0.0 {
        2.0 * theta * theta * left
    } else {
        0.0
    };
    let variance = gone / 2.0;
    let covariance = (gone - once) / 4.0;
    let second = (gone - once - twice) / 4.0;
    let first = variance.sqrt();
    let mixed = covariance / first;
    [first, mixed, (second - mixed * mixed).max(0.0).sqrt()]
}

fn correlated([first, mixed, second]: &[f64; 3], draws: &mut Draws<'_>) -> [f64; 2] {
    let [a, b] = draws.normal_pair();
    [first * a, mixed * a + second * b]
}

/// Returns a frame whose first axis is along a direction and whose second is horizontal.
fn along_first(direction: &Vector3<f64>) -> Matrix3<f64> {
    let x = direction.normalize();
    let level = Vector3::z().cross(&x);
    let y = level.try_normalize(1e-9).unwrap_or_else(Vector3::y);
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}
