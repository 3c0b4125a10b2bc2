//! Closed loop in continuous time: vehicle (1) to (4), path, timing law, law and estimators.

use control_law::adaptive::evaluation::evaluate_composite;
use control_law::adaptive::harmonics::{AdaptationSignal, FUNCTIONS, Harmonics, MAX_COUNT};
use control_law::adaptive::lyapunov::TrueParameters;
use control_law::adaptive::parameters::Projections;
use control_law::adaptive::projection::Projection;
use control_law::adaptive::saturation::Saturation;
use control_law::signals::EstimateRates;
use control_law::{Estimates, Evaluation, Measured, Parameters, Reference};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;
use scenario::{Curve, GRAVITY, Path, Scenario, TiltedEight, Vehicle};
use shared_types::rotation::{self, skew};

use super::dual::Dual;
use super::path::tilted_eight;
use super::timing_law::TimingLaw;

/// Constants of a flow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ClosedLoop {
    pub(crate) parameters: Parameters,
    pub(crate) timing_law: TimingLaw,
    pub(crate) actual: TrueParameters,
    /// λa of the harmonics.
    pub(crate) lambda_harmonics: f64,
    /// ak, the true amplitudes of what repeats with the path.
    pub(crate) amplitudes_world: [Vector3<f64>; FUNCTIONS],
}

/// State of a flow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State {
    pub(crate) measured: Measured,
    pub(crate) gamma: f64,
    pub(crate) gamma_dot: f64,
    pub(crate) estimates: Estimates,
    pub(crate) harmonics: Harmonics,
}

/// Rate of change of the state.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rates {
    pub(crate) position_world: Vector3<f64>,
    pub(crate) world_from_body: Matrix3<f64>,
    pub(crate) velocity_body: Vector3<f64>,
    pub(crate) angular_velocity_body: Vector3<f64>,
    pub(crate) gamma: f64,
    pub(crate) gamma_dot: f64,
    pub(crate) estimates: EstimateRates,
    pub(crate) signal: AdaptationSignal,
}

/// φ and φ′ of the harmonics of the paper's eight, from their definition.
pub(crate) fn functions(gamma: f64) -> [[f64; 2]; FUNCTIONS] {
    let w = TiltedEight::default().frequency;
    std::array::from_fn(|index| {
        let order = (index / 2 + 1) as f64;
        let angle = order * w * gamma;
        if index % 2 == 0 {
            [libm::cos(angle), -order * w * libm::sin(angle)]
        } else {
            [libm::sin(angle), order * w * libm::cos(angle)]
        }
    })
}

/// Σ φk ak.
fn sum(gamma: f64, amplitudes: &[Vector3<f64>; FUNCTIONS]) -> Vector3<f64> {
    let parts = functions(gamma).into_iter().zip(amplitudes);
    parts.map(|([value, _], amplitude)| amplitude * value).sum()
}

impl ClosedLoop {
    /// Returns the paper's simulation: its gains, its vehicle and its path.
    pub(crate) fn paper() -> Self {
        let curve = Curve::TiltedEight(TiltedEight::default());
        let vehicle = Vehicle::new(0.2, [6.5e-4, 6.5e-4, 13.0e-4]);
        Self {
            parameters: Parameters::from(&Scenario::new(60.0, vehicle, Path::new(curve))),
            timing_law: TimingLaw::PAPER,
            actual: TrueParameters {
                inertia: Vector3::new(6.5e-4, 6.5e-4, 13e-4),
                eta: 1.0 / 0.2,
                disturbance_world: Vector3::new(0.3, 0.2, 0.1),
            },
            lambda_harmonics: 0.0,
            amplitudes_world: [Vector3::zeros(); FUNCTIONS],
        }
    }

    /// Returns b + Σ φk(γ) ak, the true disturbance.
    pub(crate) fn disturbance(&self, state: &State) -> Vector3<f64> {
        self.actual.disturbance_world + sum(state.gamma, &self.amplitudes_world)
    }

    /// Returns the path's reference for the controller.
    pub(crate) fn reference(&self, state: &State) -> Reference {
        let Measured {
            position_world: p,
            world_from_body: r,
            velocity_body: v,
            ..
        } = state.measured;
        let (law, gamma_dot) = (&self.timing_law, state.gamma_dot);
        let pd = tilted_eight(state.gamma);
        let z1 = p - pd[0];
        let distance = z1.norm();
        // Where ψ is flat the rate of the distance has no effect, and at z1 = 0 there is none.
        let distance_rate = if distance > law.alpha1 {
            z1.dot(&(r * v - pd[1] * gamma_dot)) / distance
        } else {
            0.0
        };
        let gamma_ddot = law.gamma_ddot(
            Dual::constant(distance),
            Dual::constant(distance_rate),
            Dual::constant(gamma_dot),
        );
        let (c0, c1) = law.gamma_dddot(distance, distance_rate, gamma_dot);
        Reference {
            gamma: state.gamma,
            gamma_dot,
            gamma_ddot: gamma_ddot.value,
            gamma_dot_desired: law.gamma_dot_desired(distance),
            gamma_dddot_constant: c0,
            gamma_dddot_slope: c1,
            position_world: pd[0],
            derivative1_world: pd[1],
            derivative2_world: pd[2],
            derivative3_world: pd[3],
        }
    }

    /// Evaluates the law in a state.
    pub(crate) fn evaluate(&self, state: &State) -> Evaluation {
        let (parameters, measured, estimates) = (&self.parameters, &state.measured, &state.estimates);
        let reference = self.reference(state);
        // The thrust, and with it the prediction error, do not depend on that error.
        let repeating = state.harmonics.at(state.gamma, state.gamma_dot);
        let with =
            |error| evaluate_composite(parameters, measured, &reference, estimates, &repeating, &error);
        let thrust = with(Vector3::zeros()).thrust;
        with(self.prediction_error(state, thrust))
    }

    /// ε under a thrust: the true acceleration less that of the estimates, in {I}.
    pub(crate) fn prediction_error(&self, state: &State, thrust: f64) -> Vector3<f64> {
        let estimated = self.parameters.projections.of(&state.estimates.vehicle());
        let axis = state.measured.world_from_body.column(2);
        self.disturbance(state)
            - estimated.disturbance_world
            - sum(state.gamma, &state.harmonics.amplitudes_world)
            - axis * ((self.actual.eta - estimated.eta) * thrust)
    }

    /// Returns the vector field, with a command held at the law's.
    pub(crate) fn rates(&self, state: &State, evaluation: &Evaluation) -> Rates {
        let Measured {
            world_from_body: r,
            velocity_body: v,
            angular_velocity_body: omega,
            ..
        } = state.measured;
        let TrueParameters { inertia, eta, .. } = self.actual;
        let b = self.disturbance(state);
        let e3 = Vector3::z();
        let momentum = inertia.component_mul(&omega);
        Rates {
            position_world: r * v,             // (1)
            world_from_body: r * skew(&omega), // (2)
            velocity_body: -omega.cross(&v) - e3 * (evaluation.thrust * eta)
                + r.transpose() * (e3 * GRAVITY + b), // (3)
            angular_velocity_body: (evaluation.torque - omega.cross(&momentum)).component_div(&inertia), // (4)
            gamma: state.gamma_dot,
            gamma_dot: self.reference(state).gamma_ddot,
            estimates: evaluation.rates,
            signal: AdaptationSignal::new(evaluation, state.gamma),
        }
    }

    /// ωd with its rate along the flow, from the definition (18) in dual numbers.
    pub(crate) fn omega_desired(&self, state: &State, rates: &Rates) -> Dual<Vector3<f64>> {
        let zeta = self.zeta(state, rates);
        let scale = 1.0 / self.parameters.delta;
        Dual::from_elements([
            zeta.element(1) * -scale,
            zeta.element(0) * scale,
            Dual::constant(0.0),
        ])
    }

    /// z2 with its rate along the flow, from the definition (9) in dual numbers.
    pub(crate) fn z2(&self, state: &State, rates: &Rates) -> Dual<Vector3<f64>> {
        let (z1, z1_dot) = self.position_error(state, rates);
        let r = rotation(state, rates);
        z1_dot + self.sigma(z1) * self.parameters.k1
            - r * Dual::constant(Vector3::z() * self.parameters.delta)
    }

    /// ζ with its rate: Rᵀ(g e3 − p̈d + k1 dσ(z1)/dt + k2 σ(z2) + π(b̂)).
    fn zeta(&self, state: &State, rates: &Rates) -> Dual<Vector3<f64>> {
        let Parameters {
            k1, k2, projections, ..
        } = self.parameters;
        let (z1, z1_dot) = self.position_error(state, rates);
        let sigma_z1_dot = self.sigma_slope(z1).component_mul(z1_dot);
        let b_hat = Dual {
            value: state.estimates.disturbance_world,
            rate: rates.estimates.disturbance_world,
        };
        let projected = b_hat.map(|b| Dual {
            value: projections.disturbance.value(b.value),
            rate: projections.disturbance.slope(b.value) * b.rate,
        });
        let u = Dual::constant(Vector3::z() * GRAVITY) - self.path_acceleration(state, rates)
            + sigma_z1_dot * k1
            + self.sigma(self.z2(state, rates)) * k2
            + projected
            + self.repeating(state, rates);
        rotation(state, rates).transpose() * u
    }

    /// Rate of ½ Σ ‖âk − ak‖²/λa + ½ Σ ‖ŵk − wk‖²/Λw, with wk = (J1 ak, J2 ak, J3 ak).
    pub(crate) fn of_harmonics(&self, state: &State, rates: &Rates) -> f64 {
        let AdaptationSignal {
            composite_error_world,
            w_rate,
            ..
        } = rates.signal;
        let estimates = state.harmonics.amplitudes_world.iter().zip(&state.harmonics.w);
        let parts = functions(state.gamma)
            .into_iter()
            .zip(&self.amplitudes_world)
            .zip(estimates);
        parts
            .map(|(([value, _], true_amplitude), (amplitude, w))| {
                let of_w = (0..9).map(|at| {
                    let true_w = self.actual.inertia[at / 3] * true_amplitude[at % 3];
                    (w[at] - true_w) * w_rate[at] * value / self.parameters.lambda_inertia
                });
                (amplitude - true_amplitude).dot(&Vector3::from(composite_error_world)) * value
                    + of_w.sum::<f64>()
            })
            .sum()
    }

    /// Σ φk âk with its rate.
    fn repeating(&self, state: &State, rates: &Rates) -> Dual<Vector3<f64>> {
        let amplitude_rate = Vector3::from(rates.signal.composite_error_world) * self.lambda_harmonics;
        let estimates = functions(state.gamma)
            .into_iter()
            .zip(&state.harmonics.amplitudes_world);
        Dual {
            value: sum(state.gamma, &state.harmonics.amplitudes_world),
            rate: estimates
                .map(|([value, slope], amplitude)| {
                    amplitude_rate * (value * value) + amplitude * (slope * rates.gamma)
                })
                .sum(),
        }
    }

    /// z1 and ż1 with their rates.
    fn position_error(&self, state: &State, rates: &Rates) -> (Dual<Vector3<f64>>, Dual<Vector3<f64>>) {
        let p = Dual {
            value: state.measured.position_world,
            rate: rates.position_world,
        };
        let v = Dual {
            value: state.measured.velocity_body,
            rate: rates.velocity_body,
        };
        let [pd, pd_slope, _] = path(state, rates);
        (
            p - pd,
            rotation(state, rates) * v - pd_slope * gamma_dot(state, rates),
        )
    }

    /// p̈d = pd″γ̇² + pd′γ̈ with its rate, through the timing law.
    fn path_acceleration(&self, state: &State, rates: &Rates) -> Dual<Vector3<f64>> {
        let (z1, z1_dot) = self.position_error(state, rates);
        let gamma_dot = gamma_dot(state, rates);
        let inside = z1.value.norm() <= self.timing_law.alpha1;
        let (distance, distance_rate) = if inside {
            (Dual::constant(0.0), Dual::constant(0.0)) // ψ is flat there and z1 may be 0
        } else {
            let distance = z1.dot(z1).sqrt();
            (distance, z1.dot(z1_dot) * distance.reciprocal())
        };
        let gamma_ddot = self.timing_law.gamma_ddot(distance, distance_rate, gamma_dot);
        let [_, pd_slope, pd_curvature] = path(state, rates);
        pd_curvature * (gamma_dot * gamma_dot) + pd_slope * gamma_ddot
    }

    fn sigma(&self, x: Dual<Vector3<f64>>) -> Dual<Vector3<f64>> {
        x.map(|x| x.tanh() * self.parameters.saturation.level)
    }

    fn sigma_slope(&self, x: Dual<Vector3<f64>>) -> Dual<Vector3<f64>> {
        x.map(|x| x.sech_squared() * self.parameters.saturation.level)
    }
}

fn rotation(state: &State, rates: &Rates) -> Dual<Matrix3<f64>> {
    Dual {
        value: state.measured.world_from_body,
        rate: rates.world_from_body,
    }
}

fn gamma_dot(state: &State, rates: &Rates) -> Dual<f64> {
    Dual {
        value: state.gamma_dot,
        rate: rates.gamma_dot,
    }
}

/// pd, pd′ and pd″ with their rates.
fn path(state: &State, rates: &Rates) -> [Dual<Vector3<f64>>; 3] {
    let pd = tilted_eight(state.gamma);
    [0, 1, 2].map(|order| Dual {
        value: pd[order],
        rate: pd[order + 1] * rates.gamma,
    })
}

impl State {
    /// The same state with harmonics that adapt with the gain λa.
    pub(crate) fn with_gain(self, gain: f64) -> Self {
        let Harmonics {
            amplitudes_world, w, ..
        } = self.harmonics;
        let harmonics = Harmonics::new(MAX_COUNT, TiltedEight::default().frequency, gain);
        Self {
            harmonics: Harmonics {
                amplitudes_world,
                w,
                ..harmonics
            },
            ..self
        }
    }

    /// The state after `time` seconds at constant rates.
    pub(crate) fn moved(&self, rates: &Rates, time: f64) -> Self {
        let measured = &self.measured;
        let mut harmonics = self.harmonics;
        harmonics.integrate(&rates.signal, time);
        Self {
            harmonics,
            measured: Measured {
                position_world: measured.position_world + rates.position_world * time,
                world_from_body: measured.world_from_body + rates.world_from_body * time,
                velocity_body: measured.velocity_body + rates.velocity_body * time,
                angular_velocity_body: measured.angular_velocity_body + rates.angular_velocity_body * time,
            },
            gamma: self.gamma + rates.gamma * time,
            gamma_dot: self.gamma_dot + rates.gamma_dot * time,
            estimates: self.estimates.advanced(&rates.estimates, time),
        }
    }
}

impl ClosedLoop {
    /// A step of the classical Runge–Kutta method, with the integral over it of a function of the evaluation.
    pub(crate) fn step(
        &self,
        state: &State,
        time: f64,
        integrand: impl Fn(&Evaluation) -> f64,
    ) -> (State, f64) {
        let stage = |state: &State| {
            let evaluation = self.evaluate(state);
            (self.rates(state, &evaluation), integrand(&evaluation))
        };
        let (k1, f1) = stage(state);
        let (k2, f2) = stage(&state.moved(&k1, 0.5 * time));
        let (k3, f3) = stage(&state.moved(&k2, 0.5 * time));
        let (k4, f4) = stage(&state.moved(&k3, time));
        let next = [(k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)]
            .iter()
            .fold(*state, |state, (rates, weight)| {
                state.moved(rates, time * weight / 6.0)
            });
        (next, time * (f1 + 2.0 * f2 + 2.0 * f3 + f4) / 6.0)
    }
}

/// The paper's law: no harmonics.
pub(crate) fn no_harmonics() -> Harmonics {
    Harmonics::new(0, TiltedEight::default().frequency, 0.0)
}

pub(crate) fn vector(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
    [-bound..bound, -bound..bound, -bound..bound].prop_map(Vector3::from)
}

fn direction() -> impl Strategy<Value = Vector3<f64>> {
    vector(1.0)
        .prop_filter("a direction needs a length", |v| v.norm() > 0.1)
        .prop_map(|v| v.normalize())
}

/// ‖z1‖: half of the time in the transition zone of the paper's timing law, and at or near its ends.
fn distance() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => 0.5..1.5f64,
        1 => prop_oneof![Just(0.5), Just(1.5), 0.499..0.501f64, 1.499..1.501f64],
        3 => 0.0..0.5f64,
        2 => 1.5..30.0f64,
    ]
}

prop_compose! {
    fn parameters()(
        k in [0.5..6.0f64, 0.5..6.0, 1.0..20.0],
        beta in 1.0..200.0f64,
        delta in prop_oneof![0.05..0.4f64, -0.4..-0.05f64],
        level in 1.0..3.0f64,
        lambda_mass in 0.05..2.0f64,
        lambda_disturbance in [0.1..8.0f64, 0.1..8.0, 0.1..8.0],
        lambda_inertia in 1e-9..1e-7f64,
        prediction_gain in prop_oneof![Just(0.0), 0.1..3.0f64],
    ) -> Parameters {
        Parameters {
            k1: k[0],
            k2: k[1],
            k3: k[2],
            beta,
            delta,
            saturation: Saturation { level },
            lambda_mass,
            lambda_disturbance: Vector3::from(lambda_disturbance),
            lambda_inertia,
            prediction_gain,
            observes_disturbance: false,
            projections: Projections {
                eta: Projection { minimum: 1.0 / 0.6, maximum: 10.0, epsilon: 0.01 },
                disturbance: Projection { minimum: -3.0, maximum: 3.0, epsilon: 0.1 },
            },
            removes_offset: false,
        }
    }
}

prop_compose! {
    fn actual()(
        inertia in [1e-4..3e-3f64, 1e-4..3e-3, 1e-4..3e-3],
        mass in 0.1..0.6f64,
        disturbance_world in vector(3.0),
    ) -> TrueParameters {
        TrueParameters { inertia: Vector3::from(inertia), eta: 1.0 / mass, disturbance_world }
    }
}

prop_compose! {
    /// A closed loop of any gains and vehicle; now and then it tracks a trajectory (k4 = 0, ψ = 1 for ever).
    pub(crate) fn closed_loop()(
        parameters in parameters(),
        actual in actual(),
        lambda_harmonics in 0.1..3.0f64,
        amplitudes in proptest::collection::vec(vector(0.5), FUNCTIONS),
        timing_law in prop_oneof![
            5 => (0.2..2.0f64, 0.2..3.0f64).prop_map(|(speed, k4)| TimingLaw { speed, k4, ..TimingLaw::PAPER }),
            1 => (0.2..2.0f64).prop_map(|speed| TimingLaw { speed, k4: 0.0, alpha1: 1e6, alpha2: 2e6 }),
        ],
    ) -> ClosedLoop {
        let amplitudes_world = std::array::from_fn(|index| amplitudes[index]);
        ClosedLoop { parameters, timing_law, actual, lambda_harmonics, amplitudes_world }
    }
}

prop_compose! {
    /// A state anywhere, with estimates within their bounds and up to a few ε beyond them.
    pub(crate) fn state()(
        z1 in (direction(), distance()),
        attitude in vector(3.0),
        velocities in (vector(2.0), vector(3.0)),
        gamma in (-12.0..12.0f64, -0.5..2.0f64),
        estimates in (1.63..10.04f64, vector(3.3)),
        w in proptest::collection::vec(-1e-3..1e-3f64, 15),
        harmonics in proptest::collection::vec((vector(0.5), proptest::array::uniform9(-1e-3..1e-3f64)), FUNCTIONS),
    ) -> State {
        let (direction, distance) = z1;
        State {
            measured: Measured {
                position_world: tilted_eight(gamma.0)[0] + direction * distance,
                world_from_body: rotation::exp(&attitude),
                velocity_body: velocities.0,
                angular_velocity_body: velocities.1,
            },
            gamma: gamma.0,
            gamma_dot: gamma.1,
            estimates: Estimates {
                eta: estimates.0,
                disturbance_world: estimates.1,
                w: control_law::adaptive::parameter_vector::ParameterVector::from_row_slice(&w),
            },
            harmonics: Harmonics {
                amplitudes_world: std::array::from_fn(|index| harmonics[index].0),
                w: std::array::from_fn(|index| harmonics[index].1.into()),
                ..Harmonics::new(MAX_COUNT, TiltedEight::default().frequency, 0.0)
            },
        }
    }
}
