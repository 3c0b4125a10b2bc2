//! Rate controller: commands of thrust and body rates, from hold to hold, by the roll-out and the yaw law.

use nalgebra::Vector3;
use scenario::{Scenario, Vector};
use shared_types::flight_phase::airborne_thrust;
use zerocopy::FromZeros;

use crate::law::{LawOutput, Moment, RollOutLaw};
use crate::rates::{HoldStart, RollOut};
use crate::signals::{Acting, Commanded};
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
    /// State from hold to hold.
    pub state: RateControllerState,
}

shared_types::sample! {
    /// State from hold to hold.
    pub struct RateControllerState {
        /// The artificial ω at the end of the last hold, rad/s.
        pub artificial_omega: [f64; 3],
        /// Integral term of the yaw law, rad/s.
        pub yaw_integral: f64,
    }
}

impl RateController {
    /// Makes the rate controller of a checked scenario with commands of body rates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let rates = scenario.controller.rates.clone().unwrap_or_default();
        let model = scenario.model.clone().unwrap_or_default();
        let (thrust_limits, rate_limits) = link_limits(scenario);
        Self {
            roll_out: RollOut::new(&rates, &model, scenario.command_hold()),
            yaw: YawLaw::new(&rates, rate_limits[2]),
            thrust_limits,
            airborne_thrust: airborne_thrust(scenario.controller.bounds.mass_min),
            state: RateControllerState::new_zeroed(),
        }
    }

    /// Returns whether the thrust that acts can carry even the lightest vehicle.
    #[must_use]
    pub fn is_airborne(&self, acting: &Acting) -> bool {
        acting.thrust >= self.airborne_thrust
    }

    /// Returns whether the vehicle can follow a thrust (N), so that its motion is that of the law's model.
    #[must_use]
    pub fn is_feasible(&self, thrust: f64, acting: &Acting) -> bool {
        let [least, largest] = self.thrust_limits;
        (least..=largest).contains(&thrust) && self.is_airborne(acting)
    }

    /// Returns to the state before the first hold.
    pub fn reset(&mut self) {
        self.state = RateControllerState::new_zeroed();
    }

    /// Continues after commands that were not the law's, with ω of the vehicle (in {B}, rad/s).
    pub fn resume(&mut self, omega: Vector3<f64>) {
        self.state.artificial_omega = omega.into();
    }

    /// Returns ωz of the yaw law for the coming hold, rad/s.
    pub fn yaw_rate(&mut self, moment: &Moment<'_>) -> f64 {
        let Moment {
            measured,
            yaw,
            elapsed,
            ..
        } = moment;
        let integral = self.state.yaw_integral;
        let yaw = self
            .yaw
            .command(&measured.world_from_body, *yaw, integral, *elapsed);
        self.state.yaw_integral = yaw.integral;
        yaw.rate
    }

    /// Returns a law's command for the coming hold, and the law at its beginning.
    #[inline]
    pub fn command<L: RollOutLaw>(&mut self, law: &L, moment: &Moment<'_>) -> (LawOutput, L::Evaluation) {
        let acting = &moment.acting;
        let start = HoldStart {
            measured: &moment.measured,
            reference: moment.reference,
            artificial_omega: self.state.artificial_omega.into(),
            yaw_rate: self.yaw_rate(moment),
            acting,
        };
        let hold = self.roll_out.command(law, &start);
        self.state.artificial_omega = hold.artificial_omega.into();
        let [least, largest] = self.thrust_limits;
        let output = LawOutput {
            command: Commanded {
                thrust: hold.thrust,
                rates_body: hold.rates_body.into(),
                ..Commanded::NOTHING
            },
            limited_thrust: hold.thrust.clamp(least, largest),
            telemetry: law.telemetry(&hold.first),
            is_feasible: self.is_feasible(law.thrust(&hold.first), acting),
        };
        (output, hold.first)
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
