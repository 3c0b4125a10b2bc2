//! Step function of the plant.
//!
//! `truth(k)` is the state at time k·h. Over [(k−1)·h, k·h) the newest frame received by tick k acts, on the body
//! and in the air that are in force from tick k−1. A change at tick k is published in `truth(k)` and acts from
//! k·h on. The published motion is that of the body's origin; the state is that of the centre of mass.
//!
//! A frame with a number that is not finite, or with an unknown mode, is dropped like a frame with a wrong checksum: the
//! previous frame stays in effect.

use std::ops::Range;

use nalgebra::Vector3;
use scenario::{InitialState, Scenario};
use shared_types::rotation::{from_roll_pitch_yaw, from_row_major, to_row_major};
use shared_types::sample::Flag;
use shared_types::samples::{RcFrame, VehicleTruth};
use shared_types::wiring::{PlantInputs, PlantOutputs};
use shared_types::{Now, Service, ServiceId};
use vehicle_model::integrator::{Stage, advanced};
use vehicle_model::rigid_body::{Body, Motion, Wrench};
use zerocopy::FromZeros;

use crate::actuators::{Actuators, Drive, ideal_wrench};
use crate::air::{Air, Gusts, Wind};
use crate::cameras::CameraModel;
use crate::changes::Changes;
use crate::dynamics::Dynamics;
use crate::ground::Ground;
use crate::sensors::{SensorState, Sensors, Truth};

shared_types::sample! {
    /// State of the plant between steps.
    pub struct PlantState {
        /// p, position of the centre of mass in {I}, m.
        pub position_world: [f64; 3],
        /// R, body to inertial, row-major.
        pub world_from_body: [f64; 9],
        /// Rv, linear velocity of the centre of mass in {I}, m/s.
        pub velocity_world: [f64; 3],
        /// ω, angular velocity in {B}, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// T of a vehicle with a rate loop, N.
        pub thrust: f64,
        /// Share of the battery's charge that is spent.
        pub charge_spent: f64,
        /// The frame that acts, all zero before the first.
        pub received: RcFrame,
        /// Turbulence of the air, an acceleration in {I}, m/s².
        pub turbulence_world: [f64; 3],
        /// Gust of the wind in {I}, m/s.
        pub wind_world: [f64; 3],
        /// States of the Dryden gusts.
        pub dryden: [f64; 5],
        /// Fluctuation of the fan's jet in {I}, as a share of its force.
        pub jet_fluctuation_world: [f64; 3],
        /// State of the sensors of flight outdoors; all zero without them.
        pub sensors: SensorState,
        /// `true` if a frame was received.
        pub has_received: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

/// Simulated vehicle as a service.
#[derive(Clone, Debug)]
pub struct PlantService {
    /// h, base tick, s.
    tick: f64,
    changes: Changes,
    actuators: Actuators,
    air: Option<Air>,
    ground: Option<Ground>,
    cameras: CameraModel,
    sensors: Option<Box<Sensors>>,
    /// Motion of the centre of mass.
    motion: Motion,
    /// The last valid frame of ideal actuators; a [`RateLoop`](crate::actuators::RateLoop) stores its own.
    received: Option<RcFrame>,
}

impl PlantService {
    /// Makes the plant of a checked scenario, in its initial state.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let changes = Changes::new(scenario);
        let origin = initial_motion(&scenario.vehicle.initial);
        Self {
            tick: scenario.schedule.tick,
            motion: changes.at(0).center_of(&origin),
            changes,
            actuators: Actuators::new(scenario),
            air: Air::new(scenario),
            ground: Ground::new(scenario),
            cameras: CameraModel::new(scenario),
            sensors: Sensors::new(scenario),
            received: None,
        }
    }

    /// Advances from the previous step to `now`, tick by tick, so that a change acts exactly at its tick and the
    /// integration error does not depend on the period of the plant's steps. Returns the action over the last tick.
    fn advance(&mut self, now: &Now, newest: Option<&RcFrame>) -> Drive {
        let count = libm::round(now.elapsed() / self.tick).max(1.0);
        let h = now.elapsed() / count;
        let ticks = now.tick.saturating_sub(whole(count))..now.tick;
        let received = newest.filter(|frame| frame.is_whole());
        if let Actuators::RateLoop(_) = self.actuators {
            return self.advance_with_all_models(ticks, h, received);
        }
        let acting = received.or(self.received.as_ref());
        let drive = if self.air.is_none() && self.ground.is_none() {
            let wrench = ideal_wrench(acting);
            self.advance_ideal(ticks, h, &wrench)
        } else {
            let acting = acting.copied();
            self.advance_with_all_models(ticks, h, acting.as_ref())
        };
        if let Some(frame) = received {
            self.received = Some(*frame);
        }
        drive
    }

    /// Advances a vehicle with ideal actuators in still air, without the cost of the other models.
    #[inline]
    fn advance_ideal(&mut self, ticks: Range<u64>, h: f64, exerted: &Wrench) -> Drive {
        let mut wrench = *exerted;
        for tick in ticks {
            let body = self.changes.at(tick);
            wrench = body.about_center(exerted);
            self.motion = advanced(&self.motion, h, |motion, _| body.motion_rate(motion, &wrench));
            self.shift_center(tick, tick + 1);
        }
        Drive::Held(wrench)
    }

    /// Advances a vehicle with all models: actuators, air and ground.
    #[inline(never)]
    fn advance_with_all_models(&mut self, ticks: Range<u64>, h: f64, newest: Option<&RcFrame>) -> Drive {
        let mut drive = self.actuators.at_start();
        for tick in ticks {
            let (body, wind) = (self.changes.at(tick), self.wind(tick));
            drive = self
                .actuators
                .drive(newest, body, &self.motion.angular_velocity_body);
            let dynamics = Dynamics {
                body,
                drive: &drive,
                wind: wind.as_ref(),
            };
            self.motion = match &self.ground {
                None => dynamics.advanced(&self.motion, h),
                Some(ground) => ground.advanced(&dynamics, &self.motion, h),
            };
            if let Some(air) = &mut self.air {
                air.advance(tick + 1);
            }
            self.shift_center(tick, tick + 1);
        }
        drive
    }

    #[inline]
    fn shift_center(&mut self, from: u64, to: u64) {
        if self.changes.center_moves() {
            self.motion = self.changes.with_center_at(&self.motion, from, to);
        }
    }

    /// Returns the air at the tick to which its random processes have advanced.
    #[inline]
    fn wind(&self, tick: u64) -> Option<Wind> {
        #[expect(clippy::cast_precision_loss, reason = "no flight has 2^53 ticks")]
        let time = tick as f64 * self.tick;
        self.air.as_ref().map(|air| air.wind(time))
    }

    /// Returns the origin's current acceleration in {I}, m/s², under the last action.
    fn origin_acceleration(&self, acted: &Drive, now: &Now) -> Vector3<f64> {
        let body = self.changes.at(now.tick.saturating_sub(1));
        let wind = self.wind(now.tick);
        let dynamics = Dynamics {
            body,
            drive: acted,
            wind: wind.as_ref(),
        };
        let rate = dynamics.motion_rate(&self.motion, Stage::End);
        if let Some(ground) = &self.ground
            && ground.holds(&dynamics, &self.motion, &rate)
        {
            return Vector3::zeros();
        }
        body.origin_acceleration(&self.motion, &rate)
    }

    /// Writes the samples of the sensors that are due.
    fn measure(&mut self, origin: &Motion, acted: &Drive, now: &Now, outputs: &mut PlantOutputs<'_>) {
        if self.sensors.is_none() {
            return;
        }
        let truth = Truth {
            motion: *origin,
            thrust: acted.wrench(Stage::End).thrust,
            wind_world: self
                .wind(now.tick)
                .and_then(|wind| wind.velocity_world)
                .unwrap_or_else(Vector3::zeros),
        };
        if let Some(sensors) = &mut self.sensors {
            sensors.measure(&truth, now, outputs);
        }
    }
}

impl Service for PlantService {
    const ID: ServiceId = ServiceId::Plant;
    type Inputs<'a> = PlantInputs<'a>;
    type Outputs<'a> = PlantOutputs<'a>;
    type State = PlantState;

    /// The first step publishes the initial state unchanged.
    fn step(&mut self, now: &Now, inputs: &PlantInputs<'_>, outputs: &mut PlantOutputs<'_>) {
        let acted = if now.elapsed_ns > 0 {
            self.advance(now, inputs.frame.newest())
        } else {
            self.shift_center(0, now.tick);
            self.actuators.at_start()
        };
        let body = self.changes.at(now.tick);
        let origin = body.origin_of(&self.motion).into_owned();
        if let Some(truth) = outputs.truth.due() {
            write_motion(&origin, truth);
            let wrench = acted.wrench(Stage::End);
            write_wrench(&wrench, truth);
            write_body(body, truth);
            if let Some(wind) = self.wind(now.tick) {
                let air_acceleration = wind.acceleration(&self.motion, wrench.thrust, body.mass);
                truth.disturbance_world = (body.disturbance_world + air_acceleration).into();
            }
        }
        if let Some(pose) = outputs.pose.due() {
            // Only cameras with trigger jitter use the acceleration.
            let acceleration_world = match self.cameras {
                CameraModel::Ideal => Vector3::zeros(),
                CameraModel::Imperfect(_) => self.origin_acceleration(&acted, now),
            };
            self.cameras.capture(&origin, &acceleration_world, now, pose);
        }
        self.measure(&origin, &acted, now, outputs);
    }

    fn save(&self) -> PlantState {
        let (thrust, charge_spent, received) = match &self.actuators {
            Actuators::Ideal => (0.0, 0.0, self.received.as_ref()),
            Actuators::RateLoop(rate_loop) => {
                (rate_loop.thrust(), rate_loop.charge_spent(), rate_loop.received())
            }
        };
        let gusts = self.air.as_ref().map(Air::gusts).unwrap_or_default();
        PlantState {
            position_world: self.motion.position_world.into(),
            world_from_body: to_row_major(&self.motion.world_from_body),
            velocity_world: self.motion.velocity_world.into(),
            angular_velocity_body: self.motion.angular_velocity_body.into(),
            thrust,
            charge_spent,
            received: received.copied().unwrap_or_else(RcFrame::new_zeroed),
            turbulence_world: gusts.turbulence_world.into(),
            wind_world: gusts.wind_world.into(),
            dryden: gusts.dryden,
            jet_fluctuation_world: gusts.jet_fluctuation_world.into(),
            sensors: self
                .sensors
                .as_ref()
                .map_or_else(SensorState::new_zeroed, |sensors| sensors.save()),
            has_received: received.is_some().into(),
            pad0: [0; 7],
        }
    }

    fn restore(&mut self, state: &PlantState) {
        self.motion = Motion {
            position_world: state.position_world.into(),
            world_from_body: from_row_major(&state.world_from_body),
            velocity_world: state.velocity_world.into(),
            angular_velocity_body: state.angular_velocity_body.into(),
        };
        if let Some(sensors) = &mut self.sensors {
            sensors.restore(&state.sensors);
        }
        let received = state.has_received.is_set().then_some(state.received);
        match &mut self.actuators {
            Actuators::Ideal => self.received = received,
            Actuators::RateLoop(rate_loop) => rate_loop.restore(state.thrust, state.charge_spent, received),
        }
        if let Some(air) = &mut self.air {
            air.restore(&Gusts {
                turbulence_world: state.turbulence_world.into(),
                wind_world: state.wind_world.into(),
                dryden: state.dryden,
                jet_fluctuation_world: state.jet_fluctuation_world.into(),
            });
        }
    }
}

/// Returns the origin's motion at the start of the flight.
fn initial_motion(initial: &InitialState) -> Motion {
    let world_from_body = from_roll_pitch_yaw(initial.roll_pitch_yaw);
    Motion {
        position_world: initial.position.into(),
        world_from_body,
        velocity_world: world_from_body * Vector3::from(initial.velocity_body),
        angular_velocity_body: initial.angular_velocity_body.into(),
    }
}

fn write_motion(origin: &Motion, truth: &mut VehicleTruth) {
    truth.position_world = origin.position_world.into();
    truth.world_from_body = to_row_major(&origin.world_from_body);
    truth.velocity_body = origin.velocity_body().into();
    truth.angular_velocity_body = origin.angular_velocity_body.into();
}

/// Writes the wrench that acted until now, about the centre of mass.
fn write_wrench(wrench: &Wrench, truth: &mut VehicleTruth) {
    truth.thrust = wrench.thrust;
    truth.torque_body = wrench.torque_body.into();
}

/// Writes the body in force from now on, in still air.
fn write_body(body: &Body, truth: &mut VehicleTruth) {
    truth.mass = body.mass;
    truth.inertia = body.inertia.into();
    truth.disturbance_world = body.disturbance_world.into();
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a rounded ratio of times, at least 1"
)]
fn whole(ticks: f64) -> u64 {
    ticks as u64
}
