//! Failsafe stages: commands by the age of the vehicle's state, when it is too old for the law.
//!
//! | stage | command |
//! | --- | --- |
//! | nominal | the law's, on a predicted state ([`crate::dead_reckoning`]) if the measured one is late |
//! | hold | the last command again: the best for a tenth of a second |
//! | level | the vehicle levels out and neither climbs nor sinks |
//! | descend | level, with a thrust below the weight: it accelerates downwards by [`DESCENT`] |
//! | failsafe | the motors stop |
//!
//! The scenario states the stages and their ages; a stage begins when the state is *older* than its age. Level means R
//! e3 = e3. With n = Rᵀe3 and V = 1 − e3ᵀn, the body rates ω = k (e3 × n) make V̇ = −k‖e3 × n‖²: the vehicle levels out
//! from every attitude but upside down, and does not yaw. Attitude, rates and velocity are the predicted ones; the
//! thrust of the stage *level* is m̂(g + b̂z + push + kv vz)/n3, which makes vz 0.
//!
//! No measurement shows a blind vehicle how fast it sinks. A constant speed of descent would be that of the prediction
//! alone: with a thrust 2.5 % above the predicted one the vehicle would climb by 0.25 m/s more every second, and one that
//! has touched the ground meanwhile, where the prediction sinks on, would lift off again. So the stage *descend* is open
//! loop, m̂(g + b̂z + push − a)/n3: a/g = 3 % below the weight. The vehicle goes down whatever its velocity, as long as the
//! thrust that carried it is known to 3 %; it is measured in flight, see [`crate::dead_reckoning`]. From a height h in m,
//! in air that does not brake, that takes √(2h/a) and ends at √(2ah): 0.95 m/s from 1.5 m. PX4 descends without a vertical
//! velocity at the same 0.3 m/s² (`FlightTaskDescend`).
//!
//! **A landing** enters this stage early, `COASTS` after the last detection by the cameras on the straight way down:
//! neither the stage *level* nor the law on a predicted state is safe where the vehicle may stand on the ground.
//!
//! Failure policy: without a last command to hold, as after a cold start of the controller, the vehicle levels out
//! instead. Before the first good state the controller commands nothing. No stage is final: the next good state returns
//! to the law.

use nalgebra::Vector3;
use scenario::{GRAVITY, InputSafety};
use shared_types::flight_phase::DESCENT;
use shared_types::samples::ControlAdaptation;
use shared_types::service::nanoseconds;
use vehicle_model::rigid_body::gyroscopic_torque;

use crate::dead_reckoning::{ModelEstimate, Reckoned};
use control_law::signals::Commanded;

/// Time without a detection by the cameras after which a landing enters the descent, s.
const COASTS: f64 = 0.1;
/// k, gain of the body rates on the tilt, 1/s.
const LEVELLING: f64 = 5.0;
/// kv, gain of the thrust on the vertical velocity, 1/s.
const BRAKING: f64 = 2.0;
/// Gain of the torque on the body rates, 1/s, and its largest product with the time between two commands.
const TURNING: f64 = 20.0;
const LARGEST_GAIN: f64 = 0.5;
/// Smallest n3 that the thrust compensates: 60 degrees.
const LEAST_UPRIGHTNESS: f64 = 0.5;
/// Largest thrust, as a multiple of the weight.
const MOST_THRUST: f64 = 1.5;

/// Source of the commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FailsafeStage {
    /// The law, on a recent state.
    Nominal,
    /// The last command.
    Hold,
    /// Level, neither rising nor sinking.
    Level,
    /// Level, sinking.
    Descend,
    /// The motors stop.
    Failsafe,
}

impl FailsafeStage {
    /// Returns the stage's code in telemetry.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Nominal => ControlAdaptation::STAGE_LAW,
            Self::Hold => ControlAdaptation::STAGE_HOLD,
            Self::Level => ControlAdaptation::STAGE_LEVEL,
            Self::Descend => ControlAdaptation::STAGE_DESCEND,
            Self::Failsafe => ControlAdaptation::STAGE_FAILSAFE,
        }
    }

    /// Returns the stage of a code; nominal for an unknown code.
    #[must_use]
    pub fn from_code(code: u8) -> Self {
        let stages = [Self::Hold, Self::Level, Self::Descend, Self::Failsafe];
        stages
            .into_iter()
            .find(|stage| stage.code() == code)
            .unwrap_or(Self::Nominal)
    }
}

/// Ages at which the stages begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FailsafeStages {
    /// Each stage after the nominal one with the age above which it applies, ns, in their order.
    begins: [(FailsafeStage, Option<u64>); 4],
}

impl FailsafeStages {
    /// Returns the stages of a scenario.
    #[must_use]
    pub fn new(safety: &InputSafety) -> Self {
        let [hold, level, descend, failsafe] = safety.ages().map(|(_, age)| age.map(nanoseconds));
        Self {
            begins: [
                (FailsafeStage::Hold, hold),
                (FailsafeStage::Level, level),
                (FailsafeStage::Descend, descend),
                (FailsafeStage::Failsafe, failsafe),
            ],
        }
    }

    /// Returns the stage for an age, ns.
    #[must_use]
    pub fn at(&self, age_ns: u64) -> FailsafeStage {
        let begun =
            |&&(_, begins): &&(FailsafeStage, Option<u64>)| begins.is_some_and(|begins| age_ns > begins);
        self.begins
            .iter()
            .rfind(begun)
            .map_or(FailsafeStage::Nominal, |&(stage, _)| stage)
    }

    /// Returns the stage for an age, ns, on the straight way down of a landing without a detection by the cameras for a
    /// time, ns.
    #[must_use]
    pub fn at_landing(&self, age_ns: u64, unseen_ns: u64) -> FailsafeStage {
        let [_, _, (descend, begins), _] = self.begins;
        let stage = self.at(age_ns);
        if begins.is_some() && unseen_ns > nanoseconds(COASTS) {
            stage.max(descend)
        } else {
            stage
        }
    }
}

/// Leveler of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leveler {
    inertia: Vector3<f64>,
    /// Gain of the torque on the body rates, 1/s.
    turning: f64,
}

impl Leveler {
    /// Makes a leveler for a vehicle with J = Diag(`inertia`) (kg m²) and commands that are held for `hold` seconds.
    #[must_use]
    pub fn new(inertia: Vector3<f64>, hold: f64) -> Self {
        Self {
            inertia,
            turning: TURNING.min(LARGEST_GAIN / hold),
        }
    }

    /// Returns the command that levels a vehicle and makes it neither climb nor sink.
    #[must_use]
    pub fn level(&self, vehicle: &Reckoned, estimate: &ModelEstimate) -> Commanded {
        let [.., vertical] = vehicle.velocity_world;
        self.command(vehicle, estimate, -BRAKING * vertical)
    }

    /// Returns the command that levels a vehicle and makes it go down.
    #[must_use]
    pub fn descend(&self, vehicle: &Reckoned, estimate: &ModelEstimate) -> Commanded {
        self.command(vehicle, estimate, DESCENT)
    }

    /// Returns the command that levels a vehicle, with an acceleration downwards, m/s².
    fn command(&self, vehicle: &Reckoned, estimate: &ModelEstimate, down: f64) -> Commanded {
        let motion = vehicle.motion();
        let omega = motion.angular_velocity_body;
        let n = motion.world_from_body.row(2).transpose(); // Rᵀ e3
        let rates = Vector3::z().cross(&n) * LEVELLING;
        let turning = self.inertia.component_mul(&(rates - omega)) * self.turning;
        let torque = turning + gyroscopic_torque(&self.inertia, &omega);
        let [.., push] = vehicle.push_world;
        let pull = GRAVITY + estimate.disturbance_world.z + push - down;
        let thrust = estimate.mass * pull / n.z.max(LEAST_UPRIGHTNESS);
        Commanded {
            thrust: thrust.clamp(0.0, MOST_THRUST * estimate.mass * GRAVITY),
            torque_body: torque.into(),
            rates_body: rates.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dead_reckoning::DeadReckoning;
    use crate::dead_reckoning::tests::scenario;
    use proptest::prelude::*;
    use shared_types::rotation;
    use shared_types::samples::VehicleState;
    use zerocopy::FromZeros;

    const BELIEVED: ModelEstimate = ModelEstimate {
        mass: 0.2,
        disturbance_world: Vector3::new(0.0, 0.0, 0.3),
    };

    proptest! {
        #[test]
        fn the_vehicle_levels_out_from_any_tilt_and_holds_its_height_or_goes_down_ever_faster(
            tilt in 0.0..2.5f64, direction in 0.0..6.3f64, yaw in -3.0..3.0f64, vertical in -1.0..1.0f64,
            turns in [-2.0..2.0f64, -2.0..2.0f64, -2.0..2.0f64], descends in any::<bool>(),
            rates in any::<bool>(), hold in prop_oneof![Just(0.001), Just(0.022)],
        ) {
            let dead_reckoning = DeadReckoning::new(&scenario(rates));
            let leveller = Leveler::new(dead_reckoning.inertia, hold);
            let (sine, cosine) = libm::sincos(direction);
            let tilted = rotation::exp(&(Vector3::new(cosine, sine, 0.0) * tilt));
            let attitude = tilted * rotation::exp(&(Vector3::z() * yaw));
            let mut state = VehicleState::new_zeroed();
            state.world_from_body = rotation::to_row_major(&attitude);
            state.velocity_body = attitude.tr_mul(&Vector3::new(0.5, 0.0, vertical)).into();
            (state.angular_velocity_body, state.thrust) = (turns, 1.9);
            state.acceleration_world = (Vector3::z() * (GRAVITY + 0.3) - attitude.column(2) * (1.9 / 0.2)).into();
            let mut vehicle = dead_reckoning.begin(&Reckoned::NOTHING, &state, &Commanded::NOTHING, &BELIEVED, false);
            let (mut time, mut before) = (0.0, 0.0);
            while time < 5.0 {
                if time < 4.0 {
                    before = vehicle.velocity_world[2];
                }
                let command = if descends {
                    leveller.descend(&vehicle, &BELIEVED)
                } else {
                    leveller.level(&vehicle, &BELIEVED)
                };
                vehicle = dead_reckoning.advanced(&vehicle, &command, &BELIEVED, hold);
                time += hold;
            }
            let r = rotation::from_row_major(&vehicle.world_from_body);
            prop_assert!(r[(2, 2)] > 0.9999, "level: {}", r[(2, 2)]);
            let expected = if descends { before + DESCENT } else { 0.0 };
            prop_assert!((vehicle.velocity_world[2] - expected).abs() < 0.02, "{:?}", vehicle.velocity_world);
        }
    }

    #[test]
    fn an_unstated_stage_is_left_out() {
        let safety = InputSafety {
            descend: Some(0.3),
            ..InputSafety::new(0.1)
        };
        let stages = FailsafeStages::new(&safety);
        let at = |time: f64| stages.at(nanoseconds(time));
        assert_eq!([at(0.0), at(0.1)], [FailsafeStage::Nominal; 2]);
        assert_eq!([at(0.101), at(0.3)], [FailsafeStage::Hold; 2]);
        assert_eq!([at(0.301), at(1e3)], [FailsafeStage::Descend; 2]);
    }

    #[test]
    fn a_stage_returns_from_its_code() {
        for stage in [
            FailsafeStage::Nominal,
            FailsafeStage::Hold,
            FailsafeStage::Level,
            FailsafeStage::Descend,
            FailsafeStage::Failsafe,
        ] {
            assert_eq!(FailsafeStage::from_code(stage.code()), stage);
        }
    }
}
