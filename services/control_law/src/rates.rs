//! Roll-out of a law for a vehicle with commands of thrust and body rates instead of torque (section VI of the paper).
//!
//! The law turns an angular velocity, which is the command of the vehicle's rate loop: the paper's law an *artificial*
//! one by its torque ([`AdaptiveLaw`](crate::adaptive::rate_law::AdaptiveLaw)). Its third component is free in (20) and
//! follows the yaw law (28).
//!
//! A command is held for a whole frame, over which the continuous law would change it. So the law is *rolled out* over the
//! hold: vehicle, path and artificial ω move along in small steps, each with a new torque. The command is the mean of ω
//! over the hold, and the thrust at its end. This is the exact discretisation of the continuous loop: the attitude
//! loop's sampled gain saturates at one. A direct command of ω would have a gain of (g/δ)H, unstable above 2.
//!
//! In the roll-out the vehicle flies by the estimates of mass and disturbance, and by the measured acceleration that
//! they do not explain, which is held. Without that acceleration the law would rely, at the hold's end, on a motion back to
//! the path that a push not yet in the estimates prevents: every push would act by a factor of about 1 + (k1 + k2)H more.
//!
//! The vehicle follows with first-order lags, for which the command compensates: a lag with time constant τ that is
//! held at x̂ + (x − x̂)/(1 − e^(−H/τ)) brings x̂ to x at the end of the hold H.

use nalgebra::Vector3;
use scenario::{Model, RateCommand};
use shared_types::path_stop::Coasted;
use shared_types::rotation;
use vehicle_model::integrator::travelled;
use vehicle_model::lag::Lag;

use crate::law::RollOutLaw;
use crate::signals::{Acting, Measured, Reference};

/// Roll-out with its model of vehicle and link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollOut {
    /// H, duration of a hold, s.
    pub hold: f64,
    /// Number of steps of a hold.
    pub steps: u32,
    /// `true` if vehicle and path move along.
    pub moves: bool,
    /// `true` if an acceleration that the estimates do not explain acts on the vehicle as well.
    pub is_pushed: bool,
    /// `true` if the commands compensate for the lags.
    pub inverts_lags: bool,
    /// Lag of the thrust.
    pub thrust_lag: Lag,
    /// Lag of the body rates.
    pub rate_lag: Lag,
}

/// Inputs at the beginning of a hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldStart<'a> {
    /// The measured state; its ω is that of the vehicle, not the artificial one.
    pub measured: &'a Measured,
    /// The reference.
    pub reference: &'a Reference,
    /// The artificial ω at the end of the hold before, rad/s.
    pub artificial_omega: Vector3<f64>,
    /// ωz of the yaw law, rad/s.
    pub yaw_rate: f64,
    /// Thrust and acceleration that act on the vehicle.
    pub acting: &'a Acting,
}

/// Command of a hold, with the state that it leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateOutput<E> {
    /// T to be sent, N.
    pub thrust: f64,
    /// Body rates to be sent, rad/s.
    pub rates_body: Vector3<f64>,
    /// The artificial ω at the end of the hold, rad/s.
    pub artificial_omega: Vector3<f64>,
    /// The law at the beginning of the hold.
    pub first: E,
}

impl RollOut {
    /// Makes a roll-out for commands that are held for `hold` seconds.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a rounded ratio of checked times, at least 1"
    )]
    pub fn new(rates: &RateCommand, model: &Model, hold: f64) -> Self {
        Self {
            hold,
            steps: rates.steps(hold) as u32,
            moves: rates.roll_out,
            is_pushed: rates.unexplained,
            inverts_lags: rates.lag_inversion,
            thrust_lag: Lag::new(model.thrust_lag),
            rate_lag: Lag::new(model.rate_lag),
        }
    }

    /// Rolls a law out over a hold.
    #[must_use]
    pub fn command<L: RollOutLaw>(&self, law: &L, start: &HoldStart<'_>) -> RateOutput<L::Evaluation> {
        let HoldStart {
            measured,
            reference,
            artificial_omega,
            yaw_rate,
            acting,
        } = *start;
        let h = self.hold / f64::from(self.steps);
        let mut flight = Flight {
            vehicle: Measured {
                angular_velocity_body: Vector3::new(artificial_omega.x, artificial_omega.y, yaw_rate),
                ..*measured
            },
            reference: *reference,
            push: if self.is_pushed {
                acting.acceleration_world - law.acceleration(measured, reference, acting.thrust)
            } else {
                Vector3::zeros()
            },
        };
        let first = flight.evaluate(law);
        let mut evaluation = first;
        let mut mean = Vector3::zeros();
        for _ in 0..self.steps {
            let before = flight.vehicle.angular_velocity_body;
            if self.moves {
                flight.move_vehicle(law, law.thrust(&evaluation), h);
                flight.reference = flight.reference.ahead(h);
            }
            law.turn(&mut flight.vehicle.angular_velocity_body, &evaluation, h);
            mean += (before + flight.vehicle.angular_velocity_body) * (0.5 / f64::from(self.steps));
            evaluation = flight.evaluate(law);
        }
        debug_assert!(
            rotation::is_rotation(&flight.vehicle.world_from_body)
                || !rotation::is_rotation(&measured.world_from_body),
            "{:?}",
            flight.vehicle
        );
        let omega_end = flight.vehicle.angular_velocity_body;
        RateOutput {
            thrust: self.thrust_for(acting.thrust, law.thrust(&evaluation)),
            rates_body: self.rates_for(&measured.angular_velocity_body, &omega_end, &mean),
            artificial_omega: omega_end,
            first,
        }
    }

    /// Returns the T to send so that the lagging thrust goes from `now` to `end`.
    fn thrust_for(&self, now: f64, end: f64) -> f64 {
        if self.inverts_lags {
            self.thrust_lag.target(now, end, self.hold)
        } else {
            end
        }
    }

    /// Returns the rates to send: half way between those with the right mean without a lag, and those that bring the
    /// lagging rates to the right end, which alone would ring.
    fn rates_for(&self, now: &Vector3<f64>, end: &Vector3<f64>, mean: &Vector3<f64>) -> Vector3<f64> {
        if !self.inverts_lags || self.rate_lag.is_instant() {
            return *mean;
        }
        let reaching = now.zip_map(end, |now, end| self.rate_lag.target(now, end, self.hold));
        (mean + reaching) * 0.5
    }
}

/// Vehicle and path in the roll-out.
struct Flight {
    vehicle: Measured,
    reference: Reference,
    /// Acceleration of the vehicle that the law's model does not explain, in {I}, m/s².
    push: Vector3<f64>,
}

impl Flight {
    #[inline]
    fn evaluate<L: RollOutLaw>(&self, law: &L) -> L::Evaluation {
        law.evaluate(&self.vehicle, &self.reference, &self.push)
    }

    /// Steps (1)–(3) by `h` seconds.
    #[inline]
    fn move_vehicle<L: RollOutLaw>(&mut self, law: &L, thrust: f64, h: f64) {
        let acceleration = law.acceleration(&self.vehicle, &self.reference, thrust) + self.push;
        let vehicle = &mut self.vehicle;
        let r = vehicle.world_from_body;
        let velocity = vehicle.velocity_world();
        let (position, velocity_after) = travelled(&vehicle.position_world, &velocity, &acceleration, h);
        vehicle.position_world = position;
        vehicle.world_from_body = r * rotation::exp(&(vehicle.angular_velocity_body * h));
        vehicle.velocity_body = vehicle.world_from_body.tr_mul(&velocity_after);
    }
}

impl Reference {
    /// Returns the reference `h` seconds later, at constant γ̈ and by the Taylor series of the curve.
    #[must_use]
    #[inline]
    pub fn ahead(&self, h: f64) -> Self {
        Self {
            gamma_dot: self.gamma_dot + h * self.gamma_ddot,
            ..self.moved(h * (self.gamma_dot + 0.5 * h * self.gamma_ddot))
        }
    }

    /// Returns the reference `elapsed` seconds later without a newer one: the path continues for a time (s) and then stops.
    #[must_use]
    pub fn coasted(&self, elapsed: f64, continues_for: f64) -> Self {
        let rates = [self.gamma_dot, self.gamma_ddot];
        let Coasted { way, rates, .. } = Coasted::after(elapsed, rates, continues_for);
        let [gamma_dot, gamma_ddot, gamma_dddot] = rates;
        Self {
            gamma_dot,
            gamma_ddot,
            gamma_dot_desired: gamma_dot,
            gamma_dddot_constant: gamma_dddot,
            gamma_dddot_slope: 0.0,
            ..self.moved(way)
        }
    }

    /// Returns the reference farther along the curve by its Taylor series, with γ̇ and γ̈ as they are.
    #[inline]
    fn moved(&self, way: f64) -> Self {
        let [d1, d2, d3] = [
            self.derivative1_world,
            self.derivative2_world,
            self.derivative3_world,
        ];
        Self {
            gamma: self.gamma + way,
            position_world: self.position_world
                + d1 * way
                + d2 * (way * way / 2.0)
                + d3 * (way * way * way / 6.0),
            derivative1_world: d1 + d2 * way + d3 * (way * way / 2.0),
            derivative2_world: d2 + d3 * way,
            ..*self
        }
    }
}
