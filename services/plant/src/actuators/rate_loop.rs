//! Vehicle with motors that respond with a lag, an on-board rate loop, and a receiver that loses frames.
//!
//! ```text
//! Ṫ = (T* − T)/τT         T* = clamp(kT · u² · T_frame, 0, Tmax)        u = 1 − fade q − droop T/T0, q̇ = T/(T0 endurance)
//! ω̇i = (ωi* − ωi)/τωi     ωi* = clamp(kωi · ωi_frame + ω0i, −ωmaxi, ωmaxi)
//! ```
//!
//! T thrust, N; ω angular velocity in {B}, rad/s; τ time constants, s, of the thrust another one where it falls; k factors
//! of a wrong calibration; u voltage of the battery over that of a full one without a load, of which the share q is
//! spent; T0 thrust at the start; ω0 bias of the rate gyros. It is the model of section VI of the paper: the vehicle takes thrust and body rates, and its rate loop
//! is assumed to be fast. Here it has the first-order lags of such loops and motors.

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
    stated: scenario::Actuators,
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
    /// Makes the rate loop of a scenario, in a flight of that seed with ticks of `tick` s, before the first frame.
    #[must_use]
    pub fn new(stated: &scenario::Actuators, seed: u64, tick: f64) -> Self {
        let lag = |time_constant| Lag::new(time_constant).over(tick);
        Self {
            stated: stated.clone(),
            thrust_lag: lag(stated.thrust_lag),
            thrust_lag_down: lag(stated.thrust_lag_down.unwrap_or(stated.thrust_lag)),
            rate_lags: stated.rate_lag.map(lag),
            losses: Noise::new(seed, Stream::RadioLoss),
            thrust: stated.initial_thrust,
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

    /// Returns the frame that acts, if one was received.
    #[must_use]
    pub fn received(&self) -> Option<&RcFrame> {
        self.received.as_ref()
    }

    /// Continues with a thrust (N), the charge that is spent, and the frame that acts.
    pub fn restore(&mut self, thrust: f64, charge_spent: f64, received: Option<RcFrame>) {
        (self.thrust, self.charge_spent, self.received) = (thrust, charge_spent, received);
    }

    /// Returns the action over a tick on a body that turns with `omega` at its begin; the thrust advances to the tick's
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
        if let Some(battery) = &self.stated.battery {
            self.charge_spent += self.tick * self.thrust / (self.stated.initial_thrust * battery.endurance);
        }
        self.thrust = thrust.value(Stage::End);
        Drive::Lagged {
            thrust,
            turning: self.turning(body, omega),
        }
    }

    /// Takes a frame unless it is lost; then the one before goes on acting.
    ///
    /// The loss depends only on the frame's number, so it is the same at every query.
    fn receive(&mut self, frame: &RcFrame) {
        let seq = frame.header.seq;
        let known = self.received.is_some_and(|received| received.header.seq == seq);
        if !known && !self.is_lost(seq) {
            self.received = Some(*frame);
        }
    }

    fn is_lost(&mut self, seq: u64) -> bool {
        self.stated.frame_loss > 0.0 && self.losses.at(seq).uniform() < self.stated.frame_loss
    }

    /// Returns T*; a failsafe frame sets it to zero, and until the first frame it stays at its initial value.
    fn thrust_target(&self) -> f64 {
        match &self.received {
            None => self.stated.initial_thrust,
            Some(frame) if frame.failsafe.is_set() => 0.0,
            Some(frame) => (self.stated.thrust_factor * self.voltage_squared() * frame.thrust)
                .min(self.stated.thrust_max)
                .max(0.0),
        }
    }

    /// Returns u²; u is 0 where fade and droop leave nothing.
    fn voltage_squared(&self) -> f64 {
        self.stated.battery.as_ref().map_or(1.0, |battery| {
            let load = self.thrust / self.stated.initial_thrust;
            let voltage = (1.0 - battery.fade * self.charge_spent - battery.droop * load).max(0.0);
            voltage * voltage
        })
    }

    fn turning(&self, body: &Body, omega: &Vector3<f64>) -> Turning {
        let asked = match &self.received {
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
            let target = self.rate_target(axis, asked[axis]);
            self.rate_lags[axis].approach(omega[axis], target)
        }))
    }

    /// Returns ωi* about an axis.
    fn rate_target(&self, axis: usize, asked: f64) -> f64 {
        let limit = self.stated.rate_max[axis];
        (self.stated.rate_factor[axis] * asked + self.stated.rate_bias[axis])
            .min(limit)
            .max(-limit)
    }
}
