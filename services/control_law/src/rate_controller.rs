//! Rate controller: commands of thrust and body rates, from hold to hold, by the roll-out and the yaw law.

use nalgebra::Vector3;
use scenario::{GRAVITY, RateCommand, Scenario, Vector};

use crate::adaptive::harmonics::Harmonics;
use crate::adaptive::parameters::Parameters;
use crate::adaptive::rate_law::AdaptiveLaw;
use crate::law::{Law, LawOutput, Moment, Telemetry};
use crate::rates::{HoldStart, RollOut};
use crate::signals::Commanded;
use crate::signals::{Acting, Estimates};
use crate::yaw::YawLaw;

/// Controller of thrust and body rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateController {
    roll_out: RollOut,
    yaw: YawLaw,
    /// Smallest and largest thrust that the link carries, N.
    thrust_limits: [f64; 2],
    /// Thrust below which even the lightest vehicle cannot fly, N.
    airborne_thrust: f64,
    /// State that is kept from hold to hold.
    pub memory: RateControllerState,
}

/// State that is kept from hold to hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateControllerState {
    /// The artificial ω at the end of the last hold, rad/s.
    pub artificial_omega: Vector3<f64>,
    /// Integral term of the yaw law, rad/s.
    pub yaw_integral: f64,
}

impl RateControllerState {
    /// State before the first hold.
    pub const NONE: Self = Self {
        artificial_omega: Vector3::new(0.0, 0.0, 0.0),
        yaw_integral: 0.0,
    };
}

/// Command of thrust and body rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateCommandOutput<E> {
    /// T, N, before the limits of the link.
    pub thrust: f64,
    /// T as the link will carry it, N.
    pub limited_thrust: f64,
    /// Body rates, rad/s.
    pub rates_body: Vector3<f64>,
    /// The law at the beginning of the hold.
    pub law: E,
    /// `true` if the vehicle can follow the law's command, so that the estimates may learn from its motion.
    pub is_telling: bool,
}

impl<E> RateCommandOutput<E> {
    /// Returns the command with what is recorded of the law.
    #[must_use]
    pub fn told(&self, telemetry: Telemetry) -> LawOutput {
        LawOutput {
            command: Commanded {
                thrust: self.thrust,
                rates_body: self.rates_body.into(),
                ..Commanded::NOTHING
            },
            limited_thrust: self.limited_thrust,
            telemetry,
            is_telling: self.is_telling,
        }
    }
}

impl RateController {
    /// Makes the rate controller of a checked scenario, for commands of body rates.
    #[must_use]
    pub fn new(scenario: &Scenario, rates: &RateCommand) -> Self {
        let model = scenario.model.clone().unwrap_or_default();
        let (thrust_limits, rate_limits) = link_limits(scenario);
        Self {
            roll_out: RollOut::new(rates, &model, scenario.command_hold()),
            yaw: YawLaw::new(rates, rate_limits[2]),
            thrust_limits,
            airborne_thrust: 0.5 * scenario.controller.bounds.mass_min * GRAVITY,
            memory: RateControllerState::NONE,
        }
    }

    /// Returns the adaptive law for the vehicle of the roll-out.
    #[must_use]
    pub fn adaptive_law<'a>(
        &self,
        parameters: &'a Parameters,
        estimates: &'a Estimates,
        harmonics: Option<&'a Harmonics>,
    ) -> AdaptiveLaw<'a> {
        AdaptiveLaw {
            parameters,
            estimates,
            harmonics,
            inertia: self.roll_out.inertia,
        }
    }

    /// Returns whether the thrust that acts can carry even the lightest vehicle.
    #[must_use]
    pub fn is_airborne(&self, acting: &Acting) -> bool {
        acting.thrust >= self.airborne_thrust
    }

    /// Returns whether the vehicle can follow a thrust (N), so that its motion tells of the vehicle.
    #[must_use]
    pub fn is_telling(&self, thrust: f64, acting: &Acting) -> bool {
        let [least, largest] = self.thrust_limits;
        (least..=largest).contains(&thrust) && self.is_airborne(acting)
    }

    /// Returns ωz of the yaw law for the coming hold, rad/s.
    pub fn yaw_rate(&mut self, moment: &Moment<'_>) -> f64 {
        let Moment {
            measured,
            yaw,
            elapsed,
            ..
        } = moment;
        let integral = self.memory.yaw_integral;
        let yaw = self
            .yaw
            .command(&measured.world_from_body, *yaw, integral, *elapsed);
        self.memory.yaw_integral = yaw.integral;
        yaw.rate
    }

    /// Returns a law's command for the coming hold.
    pub fn fly<L: Law>(&mut self, law: &L, moment: &Moment<'_>) -> RateCommandOutput<L::Evaluation> {
        let acting = &moment.acting;
        let start = HoldStart {
            measured: &moment.measured,
            reference: moment.reference,
            artificial_omega: self.memory.artificial_omega,
            yaw_rate: self.yaw_rate(moment),
            acting,
        };
        let output = self.roll_out.command(law, &start);
        self.memory.artificial_omega = output.artificial_omega;
        let [least, largest] = self.thrust_limits;
        RateCommandOutput {
            thrust: output.thrust,
            limited_thrust: output.thrust.clamp(least, largest),
            rates_body: output.rates_body,
            law: output.first,
            is_telling: self.is_telling(law.thrust(&output.first), acting),
        }
    }
}

/// Returns the smallest and largest thrust (N), and the largest body rates (rad/s), of the link; an ideal link carries
/// all.
#[must_use]
pub fn link_limits(scenario: &Scenario) -> ([f64; 2], Vector) {
    let link = scenario.rc_output.as_ref();
    link.map_or(([0.0, f64::INFINITY], [f64::INFINITY; 3]), |link| {
        (link.thrust_limits(), link.rate_limits())
    })
}
