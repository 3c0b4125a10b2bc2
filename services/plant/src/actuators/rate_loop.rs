//! Vehicle with motors that respond with a lag, an on-board rate loop, and a receiver that loses frames.
//!
//! ```text
//! Ṫ = (T* − T)/τT         T* = clamp(kT · u² · T_frame, 0, Tmax)        u = 1 − fade q − droop T/T0, q̇ = T/(T0 endurance)
//! ω̇i = (ωi* − ωi)/τωi     ωi* = clamp(kωi · ωi_frame + ω0i, −ωmaxi, ωmaxi)
//! ```
//!
//! T thrust, N; ω angular velocity in {B}, rad/s; τ time constants, s, with a separate one for falling thrust; k
//! calibration errors as factors; T_frame the thrust that the channel means as calibrated; u battery voltage relative to the open-circuit voltage at full charge; q spent share
//! of the charge; T0 initial thrust; ω0 bias of the rate gyros. In section VI of the paper the vehicle receives thrust
//! and body rates, and its rate loop is assumed to be fast. Here loop and motors have first-order lags.

use nalgebra::Vector3;
use shared_types::noise::{Noise, Stream};
use shared_types::samples::RcFrame;
use vehicle_model::integrator::Stage;
use vehicle_model::lag::{Lag, LagOverStep};
use vehicle_model::rigid_body::Body;

use crate::actuators::{Drive, Turning};

/// Motors, rate loop and receiver.
#[derive(Clone, Debug)]
pub struct RateLoop {
    config: scenario::Actuators,
    thrust_lag: LagOverStep,
    thrust_lag_down: LagOverStep,
    rate_lags: [LagOverStep; 3],
    losses: Noise,
    /// T at the end of the last tick, N.
    thrust: f64,
    /// q.
    charge_spent: f64,
    /// Length of a tick, s.
    tick: f64,
    /// The newest frame that was not lost.
    received: Option<RcFrame>,
}

impl RateLoop {
    /// Makes the rate loop of a scenario before the first frame, with ticks of `tick` s.
    #[must_use]
    pub fn new(config: &scenario::Actuators, seed: u64, tick: f64) -> Self {
        let lag = |time_constant| Lag::new(time_constant).over(tick);
        Self {
            config: config.clone(),
            thrust_lag: lag(config.thrust_lag),
            thrust_lag_down: lag(config.thrust_lag_down.unwrap_or(config.thrust_lag)),
            rate_lags: config.rate_lag.map(lag),
            losses: Noise::new(seed, Stream::RadioLoss),
            thrust: config.initial_thrust,
            charge_spent: 0.0,
            tick,
            received: None,
        }
    }

    /// Returns T, N.
    #[must_use]
    pub fn thrust(&self) -> f64 {
        self.thrust
    }

    /// Returns q, the share of the battery's charge that is spent.
    #[must_use]
    pub fn charge_spent(&self) -> f64 {
        self.charge_spent
    }

    /// Returns the frame in effect, if one was received.
    #[must_use]
    pub fn received(&self) -> Option<&RcFrame> {
        self.received.as_ref()
    }

    /// Restores thrust (N), spent charge and the frame in effect.
    pub fn restore(&mut self, thrust: f64, charge_spent: f64, received: Option<RcFrame>) {
        (self.thrust, self.charge_spent, self.received) = (thrust, charge_spent, received);
    }

    /// Returns the action over a tick on a body that rotates with `omega` at its start, and advances the thrust to its
    /// end.
    #[must_use]
    pub fn drive(&mut self, newest: Option<&RcFrame>, body: &Body, omega: &Vector3<f64>) -> Drive {
        if let Some(frame) = newest {
            self.receive(frame);
        }
        let target = self.thrust_target();
        let lag = if target < self.thrust {
            &self.thrust_lag_down
        } else {
            &self.thrust_lag
        };
        let thrust = lag.approach(self.thrust, target);
        if let Some(battery) = &self.config.battery {
            self.charge_spent += self.tick * self.thrust / (self.config.initial_thrust * battery.endurance);
        }
        self.thrust = thrust.value(Stage::End);
        Drive::Lagged {
            thrust,
            turning: self.turning(body, omega),
        }
    }

    /// Accepts a frame unless it is lost. After a loss the previous frame stays in effect.
    ///
    /// The loss depends only on the frame's sequence number, so every query gives the same result.
    fn receive(&mut self, frame: &RcFrame) {
        let seq = frame.header.seq;
        let is_received = self.received.is_some_and(|received| received.header.seq == seq);
        if !is_received && !self.is_lost(seq) {
            self.received = Some(*frame);
        }
    }

    fn is_lost(&mut self, seq: u64) -> bool {
        self.config.frame_loss > 0.0 && self.losses.at(seq).uniform() < self.config.frame_loss
    }

    /// Returns T*: zero for a failsafe frame, the initial thrust before the first frame.
    fn thrust_target(&self) -> f64 {
        match &self.received {
            None => self.config.initial_thrust,
            Some(frame) if frame.failsafe.is_set() => 0.0,
            Some(frame) => (self.config.thrust_factor * self.voltage_squared() * frame.calibrated_thrust())
                .min(self.config.thrust_max)
                .max(0.0),
        }
    }

    /// Returns u², with u ≥ 0.
    fn voltage_squared(&self) -> f64 {
        self.config.battery.as_ref().map_or(1.0, |battery| {
            let load = self.thrust / self.config.initial_thrust;
            let voltage = battery.voltage_share(self.charge_spent, load);
            voltage * voltage
        })
    }

    fn turning(&self, body: &Body, omega: &Vector3<f64>) -> Turning {
        let commanded = match &self.received {
            None => [0.0; 3],
            Some(frame) if frame.mode == RcFrame::MODE_RATES => frame.rates_body,
            Some(frame) => {
                return Turning::Torque {
                    torque_body: frame.torque_body.into(),
                    thrust_lever: body.thrust_lever(),
                };
            }
        };
        Turning::Rates(std::array::from_fn(|axis| {
            let target = self.rate_target(axis, commanded[axis]);
            self.rate_lags[axis].approach(omega[axis], target)
        }))
    }

    /// Returns ωi* about an axis.
    fn rate_target(&self, axis: usize, commanded: f64) -> f64 {
        let limit = self.config.rate_max[axis];
        (self.config.rate_factor[axis] * commanded + self.config.rate_bias[axis])
            .min(limit)
            .max(-limit)
    }
}
