//! Phases of a flight from the ground to the path and back, and the references in each of them.
//!
//! The phases and their transitions are those of [`shared_types::flight_phase`]. This module computes their conditions
//! from the inputs of the path generator, the estimated state and the sent frames:
//! * *ready*: the newest valid state is recent, tracked, not coasting, its `position_sigma` is within the scenario's limit,
//!   and the vehicle stands level; the newest frame and its transmitter's inputs are recent, and it has no demand
//!   ([`NotReady`]);
//! * *airborne*: the vehicle has risen by [`LIFTED`] above the position where it was armed;
//! * *touched down*: in a descent the vehicle did not sink for [`STANDING`] seconds while the reference continued to sink, and
//!   the commanded thrust was below [`UNLOADED`] of the thrust in flight. Meanwhile the vehicle does not count as airborne;
//! * *found flying*: at the first steps after a cold start of the path generator, frames have at least the thrust that the
//!   lightest vehicle needs to fly. The reference then starts at the vehicle and moves to the path, as in a take-off;
//! * *stranded*: after dead reckoning the vehicle is found on the ground, and the landing continues there. If it is slower than
//!   [`AT_REST`], it has landed and is disarmed. Only an estimate whose standard deviation is below [`LIFTED`] tells the ground
//!   from the air;
//! * *strayed*: after dead reckoning, or after a gap of the steps, the vehicle is found farther than [`STRAYED`] from the
//!   reference, or with a velocity that differs from the reference's by more than [`STRAYED_BY_SPEED`]; or the reference of a
//!   landing has [left behind](LEFT_BEHIND) a tracked vehicle in the air. The reference then restarts at the vehicle: the
//!   controller would respond to such an error with more tilt than it can recover from.
//!
//! The reference is a function of a parameter, which moves along the path by the timing law, and along straight
//! [segments](crate::transition_segments) as time does. A landing stops the parameter at any position, and the descent
//! begins there. On the path and on the way to it the parameter also stops, within [`BRAKE`], once the state has been
//! dead-reckoned for [`BRAKE_AFTER`] or is unknown: the vehicle stops while the estimate is still good, because later
//! errors of its velocity cannot be corrected. A slower stop in progress is replaced by one of this kind.
//!
//! Failure policy: while the position of the vehicle is unknown, the parameter rests after its stop, and no condition of
//! motion becomes true. A request to arm is valid only in the state in which it was made: for one change from disarmed to
//! armed, at most [`ARM_WITHIN`] later. After `armed` was left for any cause, or after a cold start of the path generator,
//! the operator must arm again.

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::flight_phase::{
    ARM_WITHIN, Cause, Conditions, FlightPhase, NotReady, ReadyLimits, Row, SINKING, STANDING, UNLOADED,
    airborne_thrust,
};
use shared_types::path_stop::{BRAKE, BRAKE_AFTER, Coasted, Stop};
use shared_types::sample::Flag;
use shared_types::samples::{PathReference, RcFrame, VehicleState};
use shared_types::service::{Operator, nanoseconds};
use shared_types::{Now, ServiceId};
use zerocopy::FromZeros;

use crate::curve::CurvePoint;
use crate::speed_profile::SpeedProfile;
use crate::timing_law::PathRates;
use crate::transition_segments::{Descent, Leg, SlowDown};

/// Rise of an airborne vehicle, m.
pub const LIFTED: f64 = 0.05;
/// Distance from the beginning of the path within which the vehicle has arrived, m.
pub const ARRIVED: f64 = 0.3;
/// Distance from the reference above which a vehicle has strayed when it is tracked again, m.
pub const STRAYED: f64 = 0.2;
/// Distance of a tracked vehicle from the reference of a landing above which it is left behind, m: an obstacle or a fault of
/// the controller prevents the descent.
pub const LEFT_BEHIND: f64 = 0.5;
/// Difference from the reference's velocity above which it has strayed, m/s: velocity errors cause tilt as well.
pub const STRAYED_BY_SPEED: f64 = 0.4;
/// Maximum speed of a landed vehicle that is found on the ground, m/s.
pub const AT_REST: f64 = 0.3;
/// Duration of dead reckoning after which a vehicle that was not landing may have reached the ground, s.
pub const DOWN_AFTER: f64 = 0.5;
/// Timeout of a take-off for the arrival of the vehicle at the end of a leg, s.
pub const ARRIVAL_TIMEOUT: f64 = 5.0;
/// Rise from which a vehicle is off the ground and can turn, m.
pub const OFF_THE_GROUND: f64 = 0.01;
/// Duration of the turn of `flight.yaw_test` from then on, s.
pub const YAW_TEST: f64 = 0.8;
/// Time constant of the mean thrust in flight, s.
const CARRYING: f64 = 1.0;
/// Maximum time that one observation of the vehicle accounts for, s: after a restart the time since the last step may be
/// long.
const MAX_OBSERVATION: f64 = 0.1;

shared_types::sample! {
    /// State of the phases; all zero in a flight without them, and before the first arming.
    pub struct PhasesMemory {
        /// Begin of the phase, ns.
        pub began_ns: u64,
        /// Begin of the segment in {I}, m.
        pub from_world: [f64; 3],
        /// End of the segment in {I}, m.
        pub to_world: [f64; 3],
        /// Velocity in {I} with which the vehicle was met at the begin of the segment, m/s.
        pub met_velocity: [f64; 3],
        /// Time on the segment, s.
        pub along: f64,
        /// Rate of that time.
        pub along_rate: f64,
        /// Its derivative, 1/s.
        pub along_acceleration: f64,
        /// Wait for the vehicle at the end of a leg so far, s.
        pub waited: f64,
        /// Rate of the parameter when its stop began, 1/s.
        pub stop_rate: f64,
        /// Its derivative then, 1/s².
        pub stop_acceleration: f64,
        /// Duration of the stop so far, s.
        pub stopping_for: f64,
        /// Duration of the whole stop, s.
        pub stop_duration: f64,
        /// Duration of dead reckoning, or without a known place of the vehicle, s.
        pub unseen_for: f64,
        /// Time at which the path went on after it, ns.
        pub resumed_ns: u64,
        /// Time since which a request to arm has waited for readiness, ns.
        pub waiting_since_ns: u64,
        /// Length of the last gap of the steps, s, until the vehicle is seen after it; else 0.
        pub away_for: f64,
        /// z of the vehicle in {I} when it was armed, m.
        pub ground: f64,
        /// Time at which it left the ground in a take-off, ns; 0 before.
        pub lifted_ns: u64,
        /// Mean of the thrust that carries the vehicle, N.
        pub carrying_thrust: f64,
        /// Time for which the vehicle has not sunk although it should, s.
        pub standing_for: f64,
        /// Code of the phase.
        pub phase: u8,
        #[values(WAY_PATH = 0, WAY_RISE = 1, WAY_TRANSIT = 2, WAY_DESCENT = 3)]
        /// Code of the curve that the parameter moves along.
        pub way: u8,
        /// `true` if the vehicle is airborne.
        pub airborne: Flag,
        /// `true` if the parameter is being brought to rest.
        pub stopping: Flag,
        /// `true` if the first step has decided if the vehicle was in the air.
        pub begun: Flag,
        /// Cause of the phase, as references state it.
        pub cause: u8,
        /// `true` after the first step.
        pub stepped: Flag,
        /// Number of the newest request to arm that has been used or has lapsed.
        pub spent: u8,
        /// Number of the request to arm that waits for readiness.
        pub waiting: u8,
        /// `true` if the path is being brought to rest, or rests, for a loss of sight.
        pub braking: Flag,
        /// `true` if `ground` is known: the vehicle was armed there.
        pub ground_known: Flag,
        /// Explicit padding.
        pub pad0: [u8; 5],
    }
}

/// Inputs of a step.
#[derive(Clone, Copy, Debug)]
pub struct PhaseInput<'a> {
    /// The last good state, if the place of the vehicle is known.
    pub vehicle: Option<&'a VehicleState>,
    /// The last good state, also of a vehicle whose place is not known.
    pub state: Option<&'a VehicleState>,
    /// Its age, ns.
    pub vehicle_age_ns: u64,
    /// The last good frame.
    pub frame: Option<&'a RcFrame>,
    /// Its age, ns.
    pub frame_age_ns: u64,
    /// Place of the path in {I}, m.
    pub path: Vector3<f64>,
    /// Velocity of that place in {I}, m/s.
    pub path_velocity: Vector3<f64>,
    /// γ̇ and γ̈ of the path.
    pub path_rates: [f64; 2],
}

impl PhaseInput<'_> {
    /// Returns whether the vehicle is tracked: its position is known, and not by dead reckoning.
    fn is_seen(&self) -> bool {
        self.vehicle.is_some_and(|vehicle| !vehicle.coasting.is_set())
    }
}

/// Source of the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathRateCommand {
    /// The path, at a profile.
    Path(SpeedProfile),
    /// The path, with γ̇, γ̈ and γ⃛ as stated.
    PathAt([f64; 3]),
    /// A segment: its point, and its parameter with its rates.
    Line(CurvePoint, f64, PathRates),
}

/// The phases of a flight.
#[derive(Clone, Debug)]
pub struct Phases {
    stated: scenario::Flight,
    /// Limits for arming.
    limits: ReadyLimits,
    /// Minimum thrust of a flying vehicle, N: that of the lightest one.
    airborne_thrust: f64,
    /// Tick of the first step of a flight. A later first step of the service is a cold start.
    first_tick: u64,
    /// State of the phases.
    pub persistent: PhasesMemory,
}

impl PhasesMemory {
    fn begin_stop(&mut self, rates: [f64; 2], duration: f64) {
        [self.stop_rate, self.stop_acceleration] = Stop::new(rates, duration).begin();
        (self.stopping_for, self.stop_duration) = (0.0, duration);
    }

    fn stop(&self) -> Stop {
        Stop::new([self.stop_rate, self.stop_acceleration], self.stop_duration)
    }
}

impl Phases {
    /// Makes the phases of a checked scenario, at its start; `None` without phases.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Option<Self> {
        scenario
            .flight
            .as_ref()
            .zip(scenario.ready_limits())
            .map(|(stated, limits)| Self {
                stated: stated.clone(),
                limits,
                airborne_thrust: airborne_thrust(scenario.controller.bounds.mass_min),
                first_tick: first_tick(scenario),
                persistent: PhasesMemory::new_zeroed(),
            })
    }

    #[must_use]
    pub fn phase(&self) -> FlightPhase {
        FlightPhase::from_code(self.persistent.phase)
    }

    /// Returns the cause of the phase, as references state it.
    #[must_use]
    pub fn cause(&self) -> u8 {
        self.persistent.cause
    }

    /// Returns whether the vehicle is airborne, by its motion.
    #[must_use]
    pub fn is_airborne(&self) -> bool {
        self.persistent.airborne.is_set() && self.persistent.standing_for == 0.0
    }

    /// Updates the phase with the current inputs.
    pub fn advance(&mut self, now: &Now, input: &PhaseInput<'_>) {
        let elapsed = now.elapsed();
        if let Some(vehicle) = input.vehicle {
            self.detect_contact(elapsed, vehicle, input.frame);
            self.detect_lift(now, vehicle);
        } else {
            self.persistent.standing_for = 0.0;
        }
        self.change_segment(elapsed, input);
        if !self.persistent.stepped.is_set() {
            self.persistent.stepped = true.into();
            if now.tick > self.first_tick {
                // The lost state may have used this request.
                self.persistent.spent = now.operator.arm_count;
            }
        }
        let before = self.phase();
        let not_ready = self.not_ready(input);
        let conditions = self.conditions(now, input, not_ready);
        self.update_tracking_loss(now, input);
        let row = before.transition(&conditions);
        let has_seen =
            input.frame.is_some_and(|frame| frame.failsafe.is_set()) || self.persistent.begun.is_set();
        self.persistent.begun = (has_seen || conditions.found_flying).into();
        if let Some(row) = row {
            self.enter(now, row, input, &conditions);
            self.persistent.cause = published_cause(row, now, input, not_ready);
        }
        self.spend_arming(now, before, &conditions, not_ready);
        if input.is_seen() {
            self.persistent.away_for = 0.0;
        }
    }

    /// Measures the duration of dead reckoning, and begins to stop the parameter after [`BRAKE_AFTER`]. The stop is completed
    /// in any case. Then the parameter resumes from rest when the vehicle is tracked, in the step after the one that has
    /// commanded the rest.
    fn update_tracking_loss(&mut self, now: &Now, input: &PhaseInput<'_>) {
        let is_seen = input.is_seen();
        let may_stop = self.follows_reference() && self.persistent.way != PhasesMemory::WAY_DESCENT;
        let rates = self.rates(input);
        let persistent = &mut self.persistent;
        persistent.unseen_for = if is_seen {
            0.0
        } else {
            persistent.unseen_for + now.elapsed()
        };
        if persistent.braking.is_set() {
            // A descent continues without tracking.
            let may_go_on = is_seen || persistent.way == PhasesMemory::WAY_DESCENT;
            if may_go_on && persistent.stopping_for >= BRAKE {
                persistent.braking = false.into();
                persistent.resumed_ns = now.time_ns;
            }
            persistent.stopping_for += now.elapsed();
        } else if may_stop && (persistent.unseen_for > BRAKE_AFTER || input.vehicle.is_none()) {
            if !persistent.stopping.is_set() {
                persistent.braking = true.into();
                persistent.begin_stop(rates, BRAKE);
            } else if persistent.stop_duration - persistent.stopping_for > BRAKE {
                let [rate, acceleration, _] = persistent.stop().at(persistent.stopping_for);
                persistent.begin_stop([rate, acceleration], BRAKE);
            }
        }
    }

    /// Returns the rate of the parameter and its derivative.
    fn rates(&self, input: &PhaseInput<'_>) -> [f64; 2] {
        if self.persistent.way == PhasesMemory::WAY_PATH {
            input.path_rates
        } else {
            [self.persistent.along_rate, self.persistent.along_acceleration]
        }
    }

    /// Advances along the segment by the time since the last step.
    pub fn advance_segment(&mut self, elapsed: f64) {
        let persistent = &mut self.persistent;
        persistent.along += elapsed * persistent.along_rate;
        if persistent.stopping.is_set() {
            persistent.stopping_for += elapsed;
        }
    }

    /// Resumes from the position to which the controller has moved the path or the segment, `elapsed` s after its last
    /// reference. A stop by the controller is completed; an interrupted stop of this service starts again.
    pub fn coast(&mut self, now: &Now, path: &Coasted, elapsed: f64, goes_on_for: f64) {
        if !self.follows_reference() {
            return;
        }
        let persistent = &mut self.persistent;
        persistent.away_for = elapsed;
        let coasted = if persistent.way == PhasesMemory::WAY_PATH {
            *path
        } else {
            let rates = [persistent.along_rate, persistent.along_acceleration];
            let coasted = Coasted::after(elapsed, rates, goes_on_for);
            persistent.along += coasted.way;
            [persistent.along_rate, persistent.along_acceleration, _] = coasted.rates;
            coasted
        };
        let [rate, acceleration, _] = coasted.rates;
        let is_brought_to_rest = persistent.stopping.is_set() || persistent.braking.is_set();
        match coasted.stop {
            Some((stop, since_begin)) if since_begin < BRAKE => {
                persistent.begin_stop(stop.begin(), BRAKE);
                persistent.stopping_for = since_begin;
                persistent.braking = (!persistent.stopping.is_set()).into();
            }
            None if rate != 0.0 => {
                if is_brought_to_rest {
                    persistent.begin_stop([rate, acceleration], BRAKE);
                }
            }
            Some(_) | None => {
                persistent.begin_stop([0.0; 2], BRAKE);
                persistent.stopping_for = BRAKE;
                persistent.resumed_ns = now.time_ns;
            }
        }
        if persistent.braking.is_set() && rate != 0.0 {
            // `update_tracking_loss` adds the time of this step.
            persistent.stopping_for -= now.elapsed();
        }
    }

    /// Invalidates a request to arm that was made in another state than disarmed, that has armed, or that has waited for
    /// [`ARM_WITHIN`].
    fn spend_arming(
        &mut self,
        now: &Now,
        before: FlightPhase,
        conditions: &Conditions,
        not_ready: Option<NotReady>,
    ) {
        let count = now.operator.arm_count;
        let is_on_the_ground = before == FlightPhase::Disarmed && self.phase() == FlightPhase::Disarmed;
        if !is_on_the_ground || conditions.killed || conditions.land || !conditions.armed {
            self.persistent.spent = count;
        }
        if self.persistent.spent == count {
            (self.persistent.waiting, self.persistent.waiting_since_ns) = (count, now.time_ns);
            return;
        }
        if self.persistent.waiting != count {
            (self.persistent.waiting, self.persistent.waiting_since_ns) = (count, now.time_ns);
        }
        if now.time_ns - self.persistent.waiting_since_ns >= nanoseconds(ARM_WITHIN) {
            self.persistent.spent = count;
            self.persistent.cause = cause_of(not_ready);
        }
    }

    /// Returns the source of the reference; `known` states whether the position of the vehicle is known.
    #[must_use]
    pub fn reference_source(&mut self, now: &Now, known: bool) -> PathRateCommand {
        let is_brought_to_rest = self.persistent.stopping.is_set() || self.persistent.braking.is_set();
        let stop = self.persistent.stop().at(self.persistent.stopping_for);
        if let Some(point) = self.line_point() {
            let rates = match (self.follows_reference(), is_brought_to_rest) {
                (true, true) => stop,
                (true, false) if known => self.segment_rates(now),
                (true, false) | (false, _) => [0.0; 3],
            };
            [self.persistent.along_rate, self.persistent.along_acceleration, _] = rates;
            return PathRateCommand::Line(point, self.persistent.along, PathRates::stated(rates));
        }
        match (self.follows_reference(), is_brought_to_rest) {
            (true, true) => PathRateCommand::PathAt(stop),
            (true, false) => PathRateCommand::Path(self.profile(now)),
            (false, _) => PathRateCommand::PathAt([0.0; 3]),
        }
    }

    /// Notes when the vehicle leaves the ground: one that stands on its legs cannot turn.
    fn detect_lift(&mut self, now: &Now, vehicle: &VehicleState) {
        let [.., z] = vehicle.position_world;
        let is_off = self.rises_from_the_ground() && z < self.persistent.ground - OFF_THE_GROUND;
        if is_off && self.persistent.lifted_ns == 0 {
            self.persistent.lifted_ns = now.time_ns;
        }
    }

    fn rises_from_the_ground(&self) -> bool {
        self.phase() == FlightPhase::TakeOff && self.persistent.way == PhasesMemory::WAY_RISE
    }

    /// Returns the angle of `flight.yaw_test` at a time of its turn, rad, which is added to the desired yaw; otherwise 0.
    #[must_use]
    pub fn yaw_test(&self, now: &Now) -> f64 {
        let lifted_ns = self.persistent.lifted_ns;
        let turns = lifted_ns != 0
            && self.rises_from_the_ground()
            && now.time_ns.saturating_sub(lifted_ns) < nanoseconds(YAW_TEST);
        self.stated.yaw_test.filter(|_| turns).unwrap_or(0.0)
    }

    /// Returns whether the vehicle follows the reference.
    fn follows_reference(&self) -> bool {
        !matches!(self.phase(), FlightPhase::Disarmed | FlightPhase::Armed)
    }

    /// Returns the rate of the parameter on a segment and its first two derivatives: 1 unless it was stopped there.
    fn segment_rates(&self, now: &Now) -> [f64; 3] {
        if self.persistent.resumed_ns == 0 {
            return [1.0, 0.0, 0.0];
        }
        let profile = self.profile(now);
        [profile.value, profile.rate, profile.acceleration]
    }

    /// Returns the speed profile from rest, since the beginning of the phase or the end of the last stop.
    fn profile(&self, now: &Now) -> SpeedProfile {
        let start_ns = self.persistent.began_ns.max(self.persistent.resumed_ns);
        let since = now.time_ns.saturating_sub(start_ns);
        SpeedProfile::from_rest(shared_types::service::seconds(since), self.stated.transition_time)
    }

    /// Detects take-off and touch-down by the vehicle's motion and the commanded thrust. One observation after a gap gives no
    /// information on the gap.
    fn detect_contact(&mut self, elapsed: f64, vehicle: &VehicleState, frame: Option<&RcFrame>) {
        let (phase, elapsed) = (self.phase(), elapsed.min(MAX_OBSERVATION));
        let sinks = self.line_point().map_or(0.0, |point| point.derivative1.z);
        let persistent = &mut self.persistent;
        let [.., z] = vehicle.position_world;
        let thrust = frame.map_or(0.0, |frame| frame.thrust);
        if phase == FlightPhase::TakeOff && !persistent.airborne.is_set() && z < persistent.ground - LIFTED {
            persistent.airborne = true.into();
            persistent.carrying_thrust = thrust;
        }
        if !persistent.airborne.is_set() {
            return;
        }
        let velocity = vehicle.velocity_world();
        // Also a vehicle that was found sinking, whose reference continues down while it decelerates.
        let should_sink =
            persistent.way == PhasesMemory::WAY_DESCENT && sinks > 2.0 * SINKING * self.stated.landing_speed;
        let stands = should_sink
            && velocity.z < SINKING * self.stated.landing_speed
            && thrust < UNLOADED * persistent.carrying_thrust;
        persistent.standing_for = if stands {
            persistent.standing_for + elapsed
        } else {
            0.0
        };
        if !should_sink {
            let share = (elapsed / CARRYING).min(1.0);
            persistent.carrying_thrust += (thrust - persistent.carrying_thrust) * share;
        }
    }

    /// Changes to the next segment after the end of one.
    fn change_segment(&mut self, elapsed: f64, input: &PhaseInput<'_>) {
        let at_end = self
            .leg()
            .is_some_and(|leg| self.persistent.along >= leg.duration());
        if at_end && !self.persistent.stopping.is_set() {
            self.persistent.waited += elapsed;
            if self.persistent.way == PhasesMemory::WAY_RISE && self.persistent.airborne.is_set() {
                let from = Vector3::from(self.persistent.to_world);
                self.begin(PhasesMemory::WAY_TRANSIT, from, input.path);
            }
        }
        let has_stopped = self.persistent.stopping.is_set()
            && self.persistent.stopping_for >= self.persistent.stop_duration;
        if has_stopped && self.persistent.way != PhasesMemory::WAY_DESCENT {
            let from = self.reference(input);
            self.begin(PhasesMemory::WAY_DESCENT, from, from);
        }
    }

    fn conditions(&self, now: &Now, input: &PhaseInput<'_>, not_ready: Option<NotReady>) -> Conditions {
        let Operator {
            armed,
            arm_count,
            land,
            killed,
        } = now.operator;
        let persistent = &self.persistent;
        let action = input.frame.map_or(RcFrame::ACTION_NONE, |frame| frame.action);
        let in_phase = now.time_ns.saturating_sub(persistent.began_ns);
        let way_from = |place: Vector3<f64>| {
            let position = |vehicle: &VehicleState| Vector3::from(vehicle.position_world);
            input.vehicle.map(|vehicle| (position(vehicle) - place).norm())
        };
        // The vehicle is tracked at this step; both times are still those of the previous steps.
        let not_looked_for = persistent.unseen_for.max(persistent.away_for);
        let is_found = not_looked_for > BRAKE_AFTER && input.is_seen();
        // A position from satellites alone is wrong by metres: a vehicle on it is on the ground only by its thrust.
        let is_on_the_ground = input.vehicle.is_some_and(|vehicle| {
            let [.., z] = vehicle.position_world;
            let is_level = (z - persistent.ground).abs() < LIFTED && vehicle.position_sigma < LIFTED;
            persistent.ground_known.is_set() && is_level
        });
        // Without tracking only a landing descends at once.
        let falls_after = if self.phase() == FlightPhase::Land {
            BRAKE_AFTER
        } else {
            DOWN_AFTER
        };
        Conditions {
            armed,
            killed: killed || action == RcFrame::ACTION_KILL,
            arming_is_new: armed && arm_count != persistent.spent,
            land: land || action == RcFrame::ACTION_LAND,
            ready: not_ready.is_none(),
            spooled_up: in_phase >= nanoseconds(self.stated.spool_up),
            airborne: persistent.airborne.is_set(),
            arrived: persistent.way == PhasesMemory::WAY_TRANSIT
                && persistent.waited > 0.0
                && way_from(input.path).is_some_and(|way| way <= ARRIVED),
            overdue: persistent.waited > ARRIVAL_TIMEOUT,
            touched_down: persistent.standing_for >= STANDING,
            strayed: if is_found {
                way_from(self.reference(input)).is_some_and(|way| way > STRAYED)
                    || self.speed_from_reference(input) > STRAYED_BY_SPEED
            } else {
                self.phase() == FlightPhase::Land && self.is_left_behind(input)
            },
            stranded: is_found && is_on_the_ground,
            rests: is_found
                && not_looked_for > falls_after
                && is_on_the_ground
                && input.vehicle.is_some_and(|vehicle| self.is_at_rest(vehicle)),
            found_flying: !persistent.begun.is_set()
                && input.vehicle.is_some()
                && input.frame_age_ns <= self.limits.frame_age_ns
                && input
                    .frame
                    .is_some_and(|frame| !frame.failsafe.is_set() && frame.thrust >= self.airborne_thrust),
        }
    }

    /// Returns whether the reference of a landing has left a vehicle behind in the air. A vehicle on the ground does not
    /// count: a soft law reduces its thrust only when the reference is far below.
    fn is_left_behind(&self, input: &PhaseInput<'_>) -> bool {
        let Some((point, vehicle)) = self.line_point().zip(input.vehicle.filter(|_| input.is_seen())) else {
            return false;
        };
        let place = Vector3::from(vehicle.position_world);
        let is_high = self.persistent.ground_known.is_set() && place.z < self.persistent.ground - STRAYED;
        is_high && (place - point.position).norm() > LEFT_BEHIND
    }

    /// Returns whether the vehicle is slower than one that descends past the height of its stand.
    fn is_at_rest(&self, vehicle: &VehicleState) -> bool {
        let velocity = vehicle.velocity_world();
        velocity.norm() < AT_REST && velocity.z.abs() < SINKING * self.stated.landing_speed
    }

    fn not_ready(&self, input: &PhaseInput<'_>) -> Option<NotReady> {
        let state = input.state.map(|state| (state, input.vehicle_age_ns));
        let frame = input.frame.map(|frame| (frame, input.frame_age_ns));
        NotReady::find(&self.limits, state, frame)
    }

    fn enter(&mut self, now: &Now, row: &Row, input: &PhaseInput<'_>, conditions: &Conditions) {
        let (before, phase) = (row.from, row.to);
        self.persistent.phase = phase.code();
        self.persistent.began_ns = now.time_ns;
        match phase {
            FlightPhase::Disarmed => {
                self.persistent = PhasesMemory {
                    began_ns: now.time_ns,
                    begun: true.into(),
                    stepped: true.into(),
                    ..PhasesMemory::new_zeroed()
                };
            }
            FlightPhase::Armed => {
                let place = input.vehicle.map_or([0.0; 3], |vehicle| vehicle.position_world);
                self.persistent.ground = place[2];
                self.persistent.ground_known = true.into();
            }
            FlightPhase::TakeOff => {
                if before == FlightPhase::Disarmed {
                    self.persistent.airborne = true.into();
                    self.persistent.carrying_thrust = input.frame.map_or(0.0, |frame| frame.thrust);
                }
                if before == FlightPhase::Armed {
                    let from = input
                        .vehicle
                        .map_or(input.path, |vehicle| Vector3::from(vehicle.position_world));
                    let to = from - Vector3::z() * self.stated.takeoff_height;
                    self.begin(PhasesMemory::WAY_RISE, from, to);
                } else {
                    self.intercept(PhasesMemory::WAY_TRANSIT, input);
                }
            }
            FlightPhase::Fly => {
                self.persistent.way = PhasesMemory::WAY_PATH;
                // After a stop on the way to the path, the path rests.
                (self.persistent.stop_rate, self.persistent.stop_acceleration) = (0.0, 0.0);
            }
            // Takes precedence over other causes of a landing at this step.
            FlightPhase::Land if conditions.strayed || conditions.stranded => {
                self.intercept(PhasesMemory::WAY_DESCENT, input);
            }
            FlightPhase::Land => {
                self.persistent.stopping = true.into();
                // A stop in progress continues: another one would move the parameter backwards.
                if !self.persistent.braking.is_set() {
                    self.persistent
                        .begin_stop(self.rates(input), self.stated.transition_time);
                }
                self.persistent.braking = false.into();
            }
        }
    }

    fn begin(&mut self, way: u8, from: Vector3<f64>, to: Vector3<f64>) {
        let persistent = &mut self.persistent;
        (persistent.way, persistent.from_world, persistent.to_world) = (way, from.into(), to.into());
        (
            persistent.along,
            persistent.along_rate,
            persistent.along_acceleration,
        ) = (0.0, 1.0, 0.0);
        persistent.waited = 0.0;
        (persistent.stopping, persistent.braking) = (false.into(), false.into());
        (persistent.met_velocity, persistent.resumed_ns) = ([0.0; 3], 0);
    }

    /// Begins a segment, to the path or down, at the point where the moving vehicle can stop.
    fn intercept(&mut self, way: u8, input: &PhaseInput<'_>) {
        let Some(vehicle) = input.vehicle else {
            return self.begin(way, input.path, input.path);
        };
        let velocity = vehicle.velocity_world();
        let from = Vector3::from(vehicle.position_world) + SlowDown { velocity }.way();
        self.begin(way, from, input.path);
        self.persistent.met_velocity = velocity.into();
    }

    fn leg(&self) -> Option<Leg> {
        let is_leg = matches!(
            self.persistent.way,
            PhasesMemory::WAY_RISE | PhasesMemory::WAY_TRANSIT
        );
        is_leg.then(|| Leg {
            from: self.persistent.from_world.into(),
            to: self.persistent.to_world.into(),
            speed: self.stated.takeoff_speed,
        })
    }

    /// Returns the position of the reference in {I}, m.
    fn reference(&self, input: &PhaseInput<'_>) -> Vector3<f64> {
        self.line_point().map_or(input.path, |point| point.position)
    }

    /// Returns the difference of the vehicle's velocity from that of the reference, m/s; 0 if the position is unknown.
    fn speed_from_reference(&self, input: &PhaseInput<'_>) -> f64 {
        let along = self.line_point();
        let velocity = along.map_or(input.path_velocity, |point| {
            point.derivative1 * self.persistent.along_rate
        });
        input
            .vehicle
            .map_or(0.0, |vehicle| (vehicle.velocity_world() - velocity).norm())
    }

    fn line_point(&self) -> Option<CurvePoint> {
        let velocity = self.persistent.met_velocity.into();
        let point = self.segment_point()?;
        Some(SlowDown { velocity }.before(point, self.persistent.along))
    }

    fn segment_point(&self) -> Option<CurvePoint> {
        if self.persistent.way == PhasesMemory::WAY_DESCENT {
            let descent = Descent {
                from: self.persistent.from_world.into(),
                speed: self.stated.landing_speed,
            };
            return Some(descent.at(self.persistent.along));
        }
        self.leg().map(|leg| leg.at(self.persistent.along))
    }
}

/// Returns the code of the cause that a vehicle was not ready.
fn cause_of(not_ready: Option<NotReady>) -> u8 {
    not_ready.map_or(PathReference::CAUSE_NOT_READY, NotReady::cause)
}

/// Returns the tick of the first step of the path generator in a flight without failures.
fn first_tick(scenario: &Scenario) -> u64 {
    let schedule = scenario.schedule();
    schedule.map_or(0, |schedule| {
        schedule.service_rate(ServiceId::PathGenerator).phase
    })
}

/// Returns the code of the cause of a transition: the row's, with the origin of a demand. A kill or landing that the newest
/// frame demands because of a limit is attributed to the envelope, on which the transmitter has acted before.
fn published_cause(row: &Row, now: &Now, input: &PhaseInput<'_>, not_ready: Option<NotReady>) -> u8 {
    let of_envelope = |action: u8, base: u8| {
        let frame = input.frame.filter(|frame| frame.action == action)?;
        (frame.limit != RcFrame::LIMIT_NONE).then_some(base | (frame.limit % 16))
    };
    match row.cause {
        Cause::Progress => PathReference::CAUSE_NONE,
        Cause::FoundFlying => PathReference::CAUSE_FOUND_FLYING,
        Cause::Disarmed => PathReference::CAUSE_OPERATOR_DISARMS,
        Cause::NotReady => cause_of(not_ready),
        Cause::Overdue => PathReference::CAUSE_OVERDUE,
        Cause::Strayed => PathReference::CAUSE_STRAYED,
        Cause::TouchedDown => PathReference::CAUSE_TOUCHED_DOWN,
        Cause::Killed => of_envelope(RcFrame::ACTION_KILL, PathReference::CAUSE_ENVELOPE_KILLS)
            .unwrap_or(PathReference::CAUSE_OPERATOR_KILLS),
        Cause::LandingDemanded => of_envelope(RcFrame::ACTION_LAND, PathReference::CAUSE_ENVELOPE_LANDS)
            .filter(|_| !now.operator.land)
            .unwrap_or(PathReference::CAUSE_OPERATOR_LANDS),
    }
}
