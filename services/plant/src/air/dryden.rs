//! Gusts of the Dryden model (MIL-F-8785C), exact over a tick.
//!
//! Along the mean wind a first-order filter of white noise n, across it two second-order ones, τ = L/V:
//!
//! ```text
//!     u = σ √(2τ) / (1 + τs) n            v, w = σ √τ (1 + √3 τs)/(1 + τs)² n
//! ```
//!
//! σ standard deviation, m/s; L length, m; V mean wind, m/s, with which the frozen air passes the vehicle. A filter across
//! has the states x1 = n/(1 + τs) and x2 = x1/(1 + τs), and v = σ √τ (√3 x1 + (1 − √3) x2). Over a tick of θ = h/τ they are
//! x1 ← e^−θ x1 + e1, x2 ← e^−θ (x2 + θ x1) + e2, where e1 and e2 have the covariances that follow from the integrals of
//! e^−2u, u e^−2u and u² e^−2u over θ; at the start of the flight those over ∞, the stationary ones.

use nalgebra::{Matrix3, Vector3};
use shared_types::noise::{Draws, Noise};
use vehicle_model::lag::Lag;

/// Gusts along and across a mean wind.
#[derive(Clone, Debug)]
pub struct Dryden {
    /// Frame of the mean wind, its first axis along it, to {I}.
    world_from_wind: Matrix3<f64>,
    along: Along,
    across: [Across; 2],
    noise: Noise,
    /// States of the filters: one along, two of each across.
    states: [f64; 5],
}

#[derive(Clone, Copy, Debug)]
struct Along {
    decay: f64,
    kick: f64,
}

#[derive(Clone, Copy, Debug)]
struct Across {
    /// θ.
    way: f64,
    decay: f64,
    /// σ; the states are in units of 1/√τ.
    deviation: f64,
    /// Lower triangle of the factor of the covariance of e1, e2.
    kick: [f64; 3],
}

impl Dryden {
    /// Makes the gusts about a mean wind (in {I}, m/s; not 0) at tick 0, with ticks of `tick` s.
    #[must_use]
    pub fn new(stated: &scenario::Dryden, mean: &Vector3<f64>, tick: f64, mut noise: Noise) -> Self {
        let speed = mean.norm();
        let [tau_along, tau_side, tau_vertical] = stated.length.map(|length| length / speed);
        let [along, side, vertical] = stated.deviation;
        let lag = Lag::new(tau_along);
        let across = [
            Across::new(side, tick / tau_side),
            Across::new(vertical, tick / tau_vertical),
        ];
        let mut draws = noise.at(0);
        let [first, _] = draws.normal_pair();
        // Stationary: the covariance over all time.
        let [side_state, vertical_state] = across.map(|_| correlated(&factor(f64::INFINITY), &mut draws));
        Self {
            world_from_wind: along_first(mean),
            along: Along {
                decay: lag.left(tick),
                kick: along * lag.gone(2.0 * tick).sqrt(),
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
        *along = *along * self.along.decay + self.along.kick * first;
        for (filter, state) in self.across.iter().zip(across.chunks_exact_mut(2)) {
            let [e1, e2] = correlated(&filter.kick, &mut draws);
            let [x1, x2] = [state[0], state[1]];
            state[0] = filter.decay * x1 + e1;
            state[1] = filter.decay * (x2 + filter.way * x1) + e2;
        }
    }

    /// Returns the gust in {I}, m/s.
    #[must_use]
    pub fn value(&self) -> Vector3<f64> {
        let [along, y1, y2, z1, z2] = self.states;
        let [y, z] = [[y1, y2], [z1, z2]];
        self.world_from_wind * Vector3::new(along, self.across[0].gust(y), self.across[1].gust(z))
    }

    /// Returns the states.
    #[must_use]
    pub fn states(&self) -> [f64; 5] {
        self.states
    }

    /// Continues from states.
    pub fn restore(&mut self, states: [f64; 5]) {
        self.states = states;
    }
}

impl Across {
    fn new(deviation: f64, way: f64) -> Self {
        Self {
            way,
            decay: libm::exp(-way),
            deviation,
            kick: factor(way),
        }
    }

    fn gust(&self, [x1, x2]: [f64; 2]) -> f64 {
        let root = 3.0_f64.sqrt();
        self.deviation * (root * x1 + (1.0 - root) * x2)
    }
}

/// Factor of the covariance of e1 and e2 over θ, in units of 1/τ: elements 11, 21 and 22.
fn factor(way: f64) -> [f64; 3] {
    let (left, gone) = if way.is_finite() {
        (libm::exp(-2.0 * way), -libm::expm1(-2.0 * way))
    } else {
        (0.0, 1.0)
    };
    let once = if left > 0.0 { 2.0 * way * left } else { 0.0 };
    let twice = if left > 0.0 { 2.0 * way * way * left } else { 0.0 };
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

/// A frame whose first axis is along a direction and whose second is level.
fn along_first(direction: &Vector3<f64>) -> Matrix3<f64> {
    let x = direction.normalize();
    let level = Vector3::z().cross(&x);
    let y = level.try_normalize(1e-9).unwrap_or_else(Vector3::y);
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}
