//! Law for a vehicle with body-rate commands, against a vehicle with lags that is measured without error.

use control_law::adaptive::offset::hanging_offset;
use control_law::adaptive::rate_law::AdaptiveLaw;
use control_law::law::Moment;
use control_law::rate_controller::RateController;
use control_law::{Acting, Estimates, Measured, Reference};
use nalgebra::Vector3;
use scenario::{Curve, GRAVITY, Hover, Path, RateCommand, Scenario, Vehicle};
use shared_types::path_stop::Coasted;
use shared_types::rotation;

/// H, s: the paper's radio.
pub(crate) const HOLD: f64 = 0.022;
pub(crate) const MASS: f64 = 0.2;

pub(crate) fn scenario(delta: f64, remove_offset: bool, rates: RateCommand) -> Scenario {
    let hover = Curve::Hover(Hover { position: [0.0; 3] });
    let mut scenario = Scenario::new(60.0, Vehicle::new(MASS, [6.5e-4; 3]), Path::new(hover));
    scenario.schedule.period = [("path_generator", HOLD), ("controller", HOLD)]
        .map(|(name, period)| (name.to_owned(), period))
        .into();
    scenario.controller.delta = delta;
    scenario.controller.remove_offset = remove_offset;
    scenario.controller.rates = Some(rates);
    scenario
}

/// Vehicle whose thrust and body rates follow with first-order lags.
pub(crate) struct Rig {
    pub(crate) motion: Measured,
    thrust: f64,
    pub(crate) disturbance: Vector3<f64>,
}

impl Rig {
    pub(crate) fn new(position: [f64; 3], attitude: [f64; 3]) -> Self {
        Self {
            motion: Measured {
                position_world: position.into(),
                world_from_body: rotation::from_roll_pitch_yaw(attitude),
                velocity_body: Vector3::zeros(),
                angular_velocity_body: Vector3::zeros(),
            },
            thrust: MASS * GRAVITY,
            disturbance: Vector3::new(0.3, -0.5, 0.2),
        }
    }

    pub(crate) fn acting(&self) -> Acting {
        Acting {
            thrust: self.thrust,
            acceleration_world: self.acceleration(),
        }
    }

    /// The inputs of a step, one hold after the one before.
    pub(crate) fn moment<'a>(&self, reference: &'a Reference, yaw: f64) -> Moment<'a> {
        Moment {
            measured: self.motion,
            acting: self.acting(),
            reference,
            yaw,
            elapsed: HOLD,
            may_adapt: true,
        }
    }

    fn acceleration(&self) -> Vector3<f64> {
        let thrust_axis = self.motion.world_from_body.column(2).into_owned();
        Vector3::z() * GRAVITY + self.disturbance - thrust_axis * (self.thrust / MASS)
    }

    pub(crate) fn fly(&mut self, thrust: f64, rates: &Vector3<f64>) {
        let steps = 220;
        let h = HOLD / f64::from(steps);
        let mut velocity = self.motion.world_from_body * self.motion.velocity_body;
        for _ in 0..steps {
            let acceleration = self.acceleration();
            let motion = &mut self.motion;
            motion.position_world += velocity * h + acceleration * (0.5 * h * h);
            velocity += acceleration * h;
            motion.world_from_body *= rotation::exp(&(motion.angular_velocity_body * h));
            motion.angular_velocity_body += (rates - motion.angular_velocity_body) * (h / 0.02);
            self.thrust += (thrust - self.thrust) * (h / 0.03);
        }
        let motion = &mut self.motion;
        motion.velocity_body = motion.world_from_body.tr_mul(&velocity);
    }
}

pub(crate) fn resting_reference() -> Reference {
    let zero = Vector3::zeros();
    Reference {
        gamma: 0.0,
        gamma_dot: 1.0,
        gamma_ddot: 0.0,
        gamma_dot_desired: 1.0,
        gamma_dddot_constant: 0.0,
        gamma_dddot_slope: 0.0,
        position_world: zero,
        derivative1_world: zero,
        derivative2_world: zero,
        derivative3_world: zero,
    }
}

/// Flies to a point. Returns the largest distance from it in the last seconds, and the estimates.
fn flown(scenario: &Scenario, rig: &mut Rig, seconds: f64, last: f64, yaw: f64) -> (f64, Estimates) {
    let mut rate_controller = RateController::new(scenario);
    let mut law = AdaptiveLaw::new(scenario);
    let (mut time, mut farthest) = (0.0, 0.0_f64);
    while time < seconds {
        let (output, evaluation) = rate_controller.command(&law, &rig.moment(&resting_reference(), yaw));
        assert!(output.is_feasible);
        rig.fly(output.command.thrust.max(0.0), &output.command.rates_body.into());
        law.estimates = law.estimates.advanced(&evaluation.rates, HOLD);
        time += HOLD;
        if time > seconds - last {
            farthest = farthest.max(rig.motion.position_world.norm());
        }
    }
    (farthest, law.estimates)
}

#[test]
fn the_paper_s_delta_flies_at_the_radio_s_rate_and_hangs_by_the_known_offset() {
    let scenario = scenario(0.1, false, RateCommand::default());
    let mut rig = Rig::new([0.3, -0.2, 0.1], [0.0, 0.0, 0.3]);
    let (_, estimates) = flown(&scenario, &mut rig, 60.0, 5.0, 0.0);
    let offset = hanging_offset(
        &AdaptiveLaw::new(&scenario).parameters,
        &rig.motion.world_from_body,
    );
    assert!(
        (rig.motion.position_world - offset).norm() < 5e-4,
        "{}",
        rig.motion.position_world
    );
    let seen = Vector3::z() * GRAVITY + rig.disturbance;
    let estimate = Vector3::z() * GRAVITY + estimates.disturbance_world;
    // Mass and vertical disturbance cannot be distinguished; the rest can.
    assert!((seen - estimate).xy().norm() < 0.02, "{estimate}");
}

#[test]
fn without_the_offset_the_vehicle_hangs_on_the_path() {
    let scenario = scenario(0.25, true, RateCommand::default());
    let mut rig = Rig::new([0.3, -0.2, 0.1], [0.0, 0.0, 0.3]);
    let (farthest, _) = flown(&scenario, &mut rig, 60.0, 5.0, 0.0);
    assert!(farthest < 1e-3, "{farthest}");
}

#[test]
fn the_roll_out_commands_smaller_body_rates() {
    let latched = RateCommand {
        roll_out: false,
        ..RateCommand::default()
    };
    let [rolled_out, latched] = [RateCommand::default(), latched].map(|rates| {
        let scenario = scenario(0.1, true, rates);
        let mut rate_controller = RateController::new(&scenario);
        let law = AdaptiveLaw::new(&scenario);
        let mut rig = Rig::new([0.3, 0.0, 0.0], [0.0; 3]);
        let mut squares = 0.0;
        for _ in 0..50 {
            let (output, _) = rate_controller.command(&law, &rig.moment(&resting_reference(), 0.0));
            let rates_body = Vector3::from(output.command.rates_body);
            rig.fly(output.command.thrust.max(0.0), &rates_body);
            squares += rates_body.norm_squared();
        }
        squares.sqrt()
    });
    assert!(rolled_out < 0.7 * latched, "{rolled_out} {latched}");
}

#[test]
fn a_measured_push_moves_the_vehicle_less_before_it_is_in_the_estimates() {
    let farthest = |unexplained: bool| {
        let rates = RateCommand {
            unexplained,
            ..RateCommand::default()
        };
        let mut scenario = scenario(0.25, true, rates);
        scenario.controller.initial.disturbance = [0.3, -0.5, 0.2];
        let mut rig = Rig::new([0.0; 3], [0.0; 3]);
        rig.disturbance.z += 1.7;
        flown(&scenario, &mut rig, 3.0, 3.0, 0.0).0
    };
    let (seen, unseen) = (farthest(true), farthest(false));
    assert!(seen < 0.9 * unseen, "{seen} {unseen}");
}

#[test]
fn the_vehicle_turns_to_the_desired_yaw_without_leaving_its_place() {
    let scenario = scenario(0.25, true, RateCommand::default());
    let mut rig = Rig::new([0.0; 3], [0.0; 3]);
    flown(&scenario, &mut rig, 40.0, 1.0, 0.0);
    let (farthest, _) = flown(&scenario, &mut rig, 40.0, 40.0, 0.7);
    let [_, _, yaw] = rotation::roll_pitch_yaw(&rig.motion.world_from_body);
    assert!((yaw - 0.7).abs() < 2e-3, "{yaw}");
    assert!(farthest < 0.03, "{farthest}");
}

#[test]
fn the_first_step_of_the_roll_out_is_the_law_itself() {
    let scenario = scenario(0.25, false, RateCommand::default());
    let mut rate_controller = RateController::new(&scenario);
    let rig = Rig::new([0.1, 0.2, 0.3], [0.1, -0.2, 0.0]);
    let law = AdaptiveLaw::new(&scenario);
    let (_, first) = rate_controller.command(&law, &rig.moment(&resting_reference(), 0.0));
    assert_eq!(
        first,
        control_law::evaluate(&law.parameters, &rig.motion, &resting_reference(), &law.estimates)
    );
}

#[test]
fn a_command_is_not_feasible_on_the_ground_or_beyond_the_link_s_thrust() {
    let mut scenario = scenario(0.25, false, RateCommand::default());
    scenario.rc_output = Some(Default::default());
    scenario.controller.initial.mass = 0.5;
    let law = AdaptiveLaw::new(&scenario);
    let is_feasible = |depth: f64, thrust: f64| {
        let mut rate_controller = RateController::new(&scenario);
        let rig = Rig {
            thrust,
            ..Rig::new([0.0, 0.0, depth], [0.0; 3])
        };
        let (output, _) = rate_controller.command(&law, &rig.moment(&resting_reference(), 0.0));
        output.is_feasible
    };
    assert!(is_feasible(0.0, 1.96));
    assert!(!is_feasible(0.0, 0.1), "not airborne");
    assert!(
        !is_feasible(20.0, 1.96),
        "the law commands more than the link carries"
    );
}

#[test]
fn the_reference_ahead_is_the_curve_ahead() {
    // A cubic in γ, which its Taylor series holds exactly, at constant γ̈.
    let [c1, c2, c3] = [
        Vector3::new(1.0, 2.0, -1.0),
        Vector3::new(0.5, -0.3, 0.2),
        Vector3::new(-0.1, 0.4, 0.3),
    ];
    let at = |gamma: f64, gamma_dot: f64| Reference {
        gamma,
        gamma_dot,
        gamma_ddot: -0.4,
        position_world: c1 * gamma + c2 * (gamma * gamma) + c3 * (gamma * gamma * gamma),
        derivative1_world: c1 + c2 * (2.0 * gamma) + c3 * (3.0 * gamma * gamma),
        derivative2_world: c2 * 2.0 + c3 * (6.0 * gamma),
        derivative3_world: c3 * 6.0,
        ..resting_reference()
    };
    let coasted = Coasted::after(0.3, [1.2, -0.4], 0.1);
    let [rate, acceleration, _] = coasted.rates;
    let stopped = Reference {
        gamma_ddot: acceleration,
        ..at(0.7 + coasted.way, rate)
    };
    for (moved, wanted) in [
        (at(0.7, 1.2).ahead(0.1), at(0.7 + 0.12 - 0.002, 1.16)),
        (at(0.7, 1.2).coasted(0.3, 0.1), stopped),
    ] {
        for (moved, wanted) in [
            (moved.position_world, wanted.position_world),
            (moved.derivative1_world, wanted.derivative1_world),
            (moved.derivative2_world, wanted.derivative2_world),
            (moved.derivative3_world, wanted.derivative3_world),
        ] {
            assert!((moved - wanted).norm() < 1e-14, "{moved} {wanted}");
        }
        assert!((moved.gamma_dot - wanted.gamma_dot).abs() < 1e-15);
        assert!((moved.gamma_ddot - wanted.gamma_ddot).abs() < 1e-15);
    }
}
