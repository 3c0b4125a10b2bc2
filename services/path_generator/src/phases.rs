//! Phases of a flight from the ground to the path and back, and the references in each of them.
//!
//! The phases and their transitions are those of [`shared_types::flight_phase`]. This module computes their conditions
//! from the inputs of the path generator, the estimated state and the sent frames:
//! * *ready*: the newest good state is recent, tracked, does not coast, its `position_sigma` is within the scenario's
//!   limit, and the vehicle stands level; the newest frame is recent, its transmitter's inputs are too, and it demands
//!   nothing ([`NotReady`]);
//! * *airborne*: the vehicle has risen by [`LIFTED`] above the place where it was armed;
//! * *touched down*: on its way down the vehicle did not sink for [`STANDING`] seconds while the reference went on
//!   sinking, and the frames commanded less than [`UNLOADED`] of the thrust that carried it. As long as that lasts the
//!   vehicle no longer counts as airborne;
//! * *found flying*: at its first steps after a cold start, the path generator finds frames with as much thrust as the
//!   lightest vehicle needs. It then leads the vehicle from its place to the path, as in a take-off;
//! * *stranded*: after dead reckoning the vehicle is seen again on the ground, where it lands; one that *rests* there, slower
//!   than [`AT_REST`], has landed, and is disarmed;
//! * *strayed*: the vehicle is seen again after dead reckoning, or after a gap of the steps, farther than
//!   [`STRAYED`] from the reference, or with a velocity that differs from the reference's by more than [`STRAYED_BY_SPEED`].
//!   So has one that a landing has [left behind](LEFT_BEHIND) in the air, although it is seen.
//!   The reference then starts again at the vehicle: the controller would answer such an error with more tilt than it can
//!   recover from.
//!
//! The reference follows a parameter: along the path by the timing law, along straight
//! [segments](crate::transition_segments) like time. A landing brings the parameter to rest, wherever it is, and a
//! descent begins there. On the path and on the way to it the parameter comes to rest as well, within [`BRAKE`], once the
//! state has been dead-reckoned for [`BRAKE_AFTER`] or is not known any more: while the estimate is still good, the vehicle
//! stops, since without sight it keeps the velocity that it had. A slower stop that is under way becomes one of that kind.
//!
//! Failure policy: while the place of the vehicle is not known, everything stands still, once it has come to rest, and no
//! condition of motion becomes true. A request to arm is valid in the state in which it was made: for one change from
//! disarmed to armed, at most [`ARM_WITHIN`] later. Once `armed` has been left, for whatever cause, the operator must arm again; so must the
//! operator of a path generator that has lost its state.

use nalgebra::Vector3;
use scenario::{GRAVITY, Scenario};
use shared_types::flight_phase::{
    ARM_WITHIN, Cause, Conditions, FlightPhase, NotReady, ReadyLimits, Row, SINKING, STANDING, UNLOADED,
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

/// Rise after which the vehicle counts as airborne, m.
pub const LIFTED: f64 = 0.05;
/// Distance from the path's begin at which the vehicle has arrived, m.
pub const ARRIVED: f64 = 0.3;
/// Distance from the reference at which a vehicle that is seen again has strayed, m.
pub const STRAYED: f64 = 0.2;
/// Distance from the reference of a landing that leaves behind a vehicle which is seen all the time, m: something keeps the
/// vehicle from following, or its controller from the reference.
pub const LEFT_BEHIND: f64 = 0.5;
/// Difference from its velocity at which one has, m/s: the controller answers an error of velocity with tilt, too.
pub const STRAYED_BY_SPEED: f64 = 0.4;
/// Speed below which a vehicle that is seen again on the ground rests there, m/s.
pub const AT_REST: f64 = 0.3;
/// Duration of dead reckoning after which a vehicle that was not landing can have come down, s.
pub const DOWN_AFTER: f64 = 0.5;
/// Longest wait of a take-off for the vehicle at the end of a leg, s.
pub const PATIENCE: f64 = 5.0;
/// Time constant of the mean of the thrust that carries the vehicle, s.
const CARRYING: f64 = 1.0;
/// Longest time for which one look at the vehicle stands, s: steps are milliseconds apart, but for those after a restart.
const LONGEST_LOOK: f64 = 0.1;

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
    /// Returns whether cameras show the vehicle now: its place is known, and not by dead reckoning.
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
    /// Limits of readiness.
    limits: ReadyLimits,
    /// Thrust below which even the lightest vehicle cannot fly, N.
    airborne_thrust: f64,
    /// Tick of the first step of a flight. A first step after it is a cold start.
    first_tick: u64,
    /// State of the phases.
    pub memory: PhasesMemory,
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
    /// Makes the phases of a checked scenario, at its start; `None` if it has none.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Option<Self> {
        scenario
            .flight
            .as_ref()
            .zip(scenario.ready_limits())
            .map(|(stated, limits)| Self {
                stated: stated.clone(),
                limits,
                airborne_thrust: 0.5 * scenario.controller.bounds.mass_min * GRAVITY,
                first_tick: first_tick(scenario),
                memory: PhasesMemory::new_zeroed(),
            })
    }

    /// Returns the phase.
    #[must_use]
    pub fn phase(&self) -> FlightPhase {
        FlightPhase::from_code(self.memory.phase)
    }

    /// Returns the cause of the phase, as references state it.
    #[must_use]
    pub fn cause(&self) -> u8 {
        self.memory.cause
    }

    /// Returns whether the vehicle is airborne, as far as its motion shows.
    #[must_use]
    pub fn is_airborne(&self) -> bool {
        self.memory.airborne.is_set() && self.memory.standing_for == 0.0
    }

    /// Advances to now, with the present inputs.
    pub fn advance(&mut self, now: &Now, sight: &PhaseInput<'_>) {
        let elapsed = now.elapsed();
        if let Some(vehicle) = sight.vehicle {
            self.feel(elapsed, vehicle, sight.frame);
        } else {
            self.memory.standing_for = 0.0;
        }
        self.go_along(elapsed, sight);
        if !self.memory.stepped.is_set() {
            self.memory.stepped = true.into();
            if now.tick > self.first_tick {
                // A request that the lost state may have used.
                self.memory.spent = now.operator.arm_count;
            }
        }
        let before = self.phase();
        let not_ready = self.not_ready(sight);
        let conditions = self.conditions(now, sight, not_ready);
        self.watch_sight(now, sight);
        let row = before.transition(&conditions);
        let has_seen = sight.frame.is_some_and(|frame| frame.failsafe.is_set()) || self.memory.begun.is_set();
        self.memory.begun = (has_seen || conditions.found_flying).into();
        if let Some(row) = row {
            self.enter(now, row, sight, &conditions);
            self.memory.cause = published_cause(row, now, sight, not_ready);
        }
        self.spend_arming(now, before, &conditions, not_ready);
        if sight.is_seen() {
            self.memory.away_for = 0.0;
        }
    }

    /// Measures the dead reckoning, and begins to bring the parameter to rest when it has lasted. That stop is flown to its
    /// end, and the parameter goes on from rest once the vehicle is seen: in the step after the one that has commanded the
    /// rest.
    fn watch_sight(&mut self, now: &Now, sight: &PhaseInput<'_>) {
        let is_seen = sight.is_seen();
        let may_stop = self.is_led() && self.memory.way != PhasesMemory::WAY_DESCENT;
        let rates = self.rates(sight);
        let memory = &mut self.memory;
        memory.unseen_for = if is_seen {
            0.0
        } else {
            memory.unseen_for + now.elapsed()
        };
        if memory.braking.is_set() {
            // A descent goes on without sight.
            let may_go_on = is_seen || memory.way == PhasesMemory::WAY_DESCENT;
            if may_go_on && memory.stopping_for >= BRAKE {
                memory.braking = false.into();
                memory.resumed_ns = now.time_ns;
            }
            memory.stopping_for += now.elapsed();
        } else if may_stop && (memory.unseen_for > BRAKE_AFTER || sight.vehicle.is_none()) {
            if !memory.stopping.is_set() {
                memory.braking = true.into();
                memory.begin_stop(rates, BRAKE);
            } else if memory.stop_duration - memory.stopping_for > BRAKE {
                let [rate, acceleration, _] = memory.stop().at(memory.stopping_for);
                memory.begin_stop([rate, acceleration], BRAKE);
            }
        }
    }

    /// Returns the rate of the parameter and its derivative.
    fn rates(&self, sight: &PhaseInput<'_>) -> [f64; 2] {
        if self.memory.way == PhasesMemory::WAY_PATH {
            sight.path_rates
        } else {
            [self.memory.along_rate, self.memory.along_acceleration]
        }
    }

    /// Goes on along the segment by the time since the last step.
    pub fn go_on(&mut self, elapsed: f64) {
        let memory = &mut self.memory;
        memory.along += elapsed * memory.along_rate;
        if memory.stopping.is_set() {
            memory.stopping_for += elapsed;
        }
    }

    /// Goes on from where the controller has brought the path or the segment, `elapsed` s after its last reference. A stop that
    /// it flies is flown to its end; one that was being flown starts again.
    pub fn coast(&mut self, now: &Now, path: &Coasted, elapsed: f64, goes_on_for: f64) {
        if !self.is_led() {
            return;
        }
        let memory = &mut self.memory;
        memory.away_for = elapsed;
        let coasted = if memory.way == PhasesMemory::WAY_PATH {
            *path
        } else {
            let rates = [memory.along_rate, memory.along_acceleration];
            let coasted = Coasted::after(elapsed, rates, goes_on_for);
            memory.along += coasted.way;
            [memory.along_rate, memory.along_acceleration, _] = coasted.rates;
            coasted
        };
        let [rate, acceleration, _] = coasted.rates;
        let is_brought_to_rest = memory.stopping.is_set() || memory.braking.is_set();
        match coasted.stop {
            Some((stop, since_begin)) if since_begin < BRAKE => {
                memory.begin_stop(stop.begin(), BRAKE);
                memory.stopping_for = since_begin;
                memory.braking = (!memory.stopping.is_set()).into();
            }
            None if rate != 0.0 => {
                if is_brought_to_rest {
                    memory.begin_stop([rate, acceleration], BRAKE);
                }
            }
            Some(_) | None => {
                memory.begin_stop([0.0; 2], BRAKE);
                memory.stopping_for = BRAKE;
                memory.resumed_ns = now.time_ns;
            }
        }
        if memory.braking.is_set() && rate != 0.0 {
            // The look at the cameras in this step adds its time.
            memory.stopping_for -= now.elapsed();
        }
    }

    /// Spends a request to arm that was made in another state than disarmed, that has armed, or that has waited for
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
            self.memory.spent = count;
        }
        if self.memory.spent == count {
            (self.memory.waiting, self.memory.waiting_since_ns) = (count, now.time_ns);
            return;
        }
        if self.memory.waiting != count {
            (self.memory.waiting, self.memory.waiting_since_ns) = (count, now.time_ns);
        }
        if now.time_ns - self.memory.waiting_since_ns >= nanoseconds(ARM_WITHIN) {
            self.memory.spent = count;
            self.memory.cause = cause_of(not_ready);
        }
    }

    /// Returns the source of the reference; `known` says whether the place of the vehicle is known.
    #[must_use]
    pub fn lead(&mut self, now: &Now, known: bool) -> PathRateCommand {
        let is_brought_to_rest = self.memory.stopping.is_set() || self.memory.braking.is_set();
        let stop = self.memory.stop().at(self.memory.stopping_for);
        if let Some(point) = self.line_point() {
            let rates = match (self.is_led(), is_brought_to_rest) {
                (true, true) => stop,
                (true, false) if known => self.pace(now),
                (true, false) | (false, _) => [0.0; 3],
            };
            [self.memory.along_rate, self.memory.along_acceleration, _] = rates;
            return PathRateCommand::Line(point, self.memory.along, PathRates::stated(rates));
        }
        match (self.is_led(), is_brought_to_rest) {
            (true, true) => PathRateCommand::PathAt(stop),
            (true, false) => PathRateCommand::Path(self.profile(now)),
            (false, _) => PathRateCommand::PathAt([0.0; 3]),
        }
    }

    /// Returns whether the reference leads the vehicle.
    fn is_led(&self) -> bool {
        !matches!(self.phase(), FlightPhase::Disarmed | FlightPhase::Armed)
    }

    /// Returns the rate of the parameter on a segment and its first two derivatives: 1, as long as it has not rested there.
    fn pace(&self, now: &Now) -> [f64; 3] {
        if self.memory.resumed_ns == 0 {
            return [1.0, 0.0, 0.0];
        }
        let profile = self.profile(now);
        [profile.value, profile.rate, profile.acceleration]
    }

    /// Returns the profile of a speed that grows from rest, from the begin of the phase or from the end of the last rest on.
    fn profile(&self, now: &Now) -> SpeedProfile {
        let start_ns = self.memory.began_ns.max(self.memory.resumed_ns);
        let since = now.time_ns.saturating_sub(start_ns);
        SpeedProfile::from_rest(shared_types::service::seconds(since), self.stated.transition_time)
    }

    /// Detects by the vehicle's motion, and by the commanded thrust, what carries it. One look after a gap says nothing of
    /// the gap.
    fn feel(&mut self, elapsed: f64, vehicle: &VehicleState, frame: Option<&RcFrame>) {
        let (phase, elapsed) = (self.phase(), elapsed.min(LONGEST_LOOK));
        let sinks = self.line_point().map_or(0.0, |point| point.derivative1.z);
        let memory = &mut self.memory;
        let [.., z] = vehicle.position_world;
        let thrust = frame.map_or(0.0, |frame| frame.thrust);
        if phase == FlightPhase::TakeOff && !memory.airborne.is_set() && z < memory.ground - LIFTED {
            memory.airborne = true.into();
            memory.carrying_thrust = thrust;
        }
        if !memory.airborne.is_set() {
            return;
        }
        let velocity = vehicle.velocity_world();
        // Also one that was met on its way down, by a reference that goes on down while it slows it.
        let should_sink =
            memory.way == PhasesMemory::WAY_DESCENT && sinks > 2.0 * SINKING * self.stated.landing_speed;
        let stands = should_sink
            && velocity.z < SINKING * self.stated.landing_speed
            && thrust < UNLOADED * memory.carrying_thrust;
        memory.standing_for = if stands {
            memory.standing_for + elapsed
        } else {
            0.0
        };
        if !should_sink {
            let share = (elapsed / CARRYING).min(1.0);
            memory.carrying_thrust += (thrust - memory.carrying_thrust) * share;
        }
    }

    /// Moves from a segment that has ended to the next.
    fn go_along(&mut self, elapsed: f64, sight: &PhaseInput<'_>) {
        let at_end = self.leg().is_some_and(|leg| self.memory.along >= leg.duration());
        if at_end && !self.memory.stopping.is_set() {
            self.memory.waited += elapsed;
            if self.memory.way == PhasesMemory::WAY_RISE && self.memory.airborne.is_set() {
                let from = Vector3::from(self.memory.to_world);
                self.begin(PhasesMemory::WAY_TRANSIT, from, sight.path);
            }
        }
        let has_stopped =
            self.memory.stopping.is_set() && self.memory.stopping_for >= self.memory.stop_duration;
        if has_stopped && self.memory.way != PhasesMemory::WAY_DESCENT {
            let from = self.reference(sight);
            self.begin(PhasesMemory::WAY_DESCENT, from, from);
        }
    }

    fn conditions(&self, now: &Now, sight: &PhaseInput<'_>, not_ready: Option<NotReady>) -> Conditions {
        let Operator {
            armed,
            arm_count,
            land,
            killed,
        } = now.operator;
        let memory = &self.memory;
        let action = sight.frame.map_or(RcFrame::ACTION_NONE, |frame| frame.action);
        let in_phase = now.time_ns.saturating_sub(memory.began_ns);
        let way_from = |place: Vector3<f64>| {
            let position = |vehicle: &VehicleState| Vector3::from(vehicle.position_world);
            sight.vehicle.map(|vehicle| (position(vehicle) - place).norm())
        };
        // This step sees the vehicle, and both times are still those of the steps before.
        let not_looked_for = memory.unseen_for.max(memory.away_for);
        let is_found = not_looked_for > BRAKE_AFTER && sight.is_seen();
        let is_on_the_ground = sight.vehicle.is_some_and(|vehicle| {
            let [.., z] = vehicle.position_world;
            memory.ground_known.is_set() && (z - memory.ground).abs() < LIFTED
        });
        // Only a landing goes down at once when it is not seen.
        let falls_after = if self.phase() == FlightPhase::Land {
            BRAKE_AFTER
        } else {
            DOWN_AFTER
        };
        Conditions {
            armed,
            killed: killed || action == RcFrame::ACTION_KILL,
            arming_is_new: armed && arm_count != memory.spent,
            land: land || action == RcFrame::ACTION_LAND,
            ready: not_ready.is_none(),
            spooled_up: in_phase >= nanoseconds(self.stated.spool_up),
            airborne: memory.airborne.is_set(),
            arrived: memory.way == PhasesMemory::WAY_TRANSIT
                && memory.waited > 0.0
                && way_from(sight.path).is_some_and(|way| way <= ARRIVED),
            overdue: memory.waited > PATIENCE,
            touched_down: memory.standing_for >= STANDING,
            strayed: if is_found {
                way_from(self.reference(sight)).is_some_and(|way| way > STRAYED)
                    || self.speed_from_reference(sight) > STRAYED_BY_SPEED
            } else {
                self.phase() == FlightPhase::Land && self.is_left_behind(sight)
            },
            stranded: is_found && is_on_the_ground,
            rests: is_found
                && not_looked_for > falls_after
                && is_on_the_ground
                && sight.vehicle.is_some_and(|vehicle| self.is_at_rest(vehicle)),
            found_flying: !memory.begun.is_set()
                && sight.vehicle.is_some()
                && sight.frame_age_ns <= self.limits.frame_age_ns
                && sight
                    .frame
                    .is_some_and(|frame| !frame.failsafe.is_set() && frame.thrust >= self.airborne_thrust),
        }
    }

    /// Returns whether the reference of a landing has gone down without a vehicle that is in the air: not with one that the ground
    /// holds, which a law that is soft unloads only when the reference is far below.
    fn is_left_behind(&self, sight: &PhaseInput<'_>) -> bool {
        let Some((point, vehicle)) = self.line_point().zip(sight.vehicle.filter(|_| sight.is_seen())) else {
            return false;
        };
        let place = Vector3::from(vehicle.position_world);
        let is_high = self.memory.ground_known.is_set() && place.z < self.memory.ground - STRAYED;
        is_high && (place - point.position).norm() > LEFT_BEHIND
    }

    /// Returns whether the vehicle moves less than one that comes down beside its stand, as it passes the height of the stand.
    fn is_at_rest(&self, vehicle: &VehicleState) -> bool {
        let velocity = vehicle.velocity_world();
        velocity.norm() < AT_REST && velocity.z.abs() < SINKING * self.stated.landing_speed
    }

    fn not_ready(&self, sight: &PhaseInput<'_>) -> Option<NotReady> {
        let state = sight.state.map(|state| (state, sight.vehicle_age_ns));
        let frame = sight.frame.map(|frame| (frame, sight.frame_age_ns));
        NotReady::find(&self.limits, state, frame)
    }

    fn enter(&mut self, now: &Now, row: &Row, sight: &PhaseInput<'_>, conditions: &Conditions) {
        let (before, phase) = (row.from, row.to);
        self.memory.phase = phase.code();
        self.memory.began_ns = now.time_ns;
        match phase {
            FlightPhase::Disarmed => {
                self.memory = PhasesMemory {
                    began_ns: now.time_ns,
                    begun: true.into(),
                    stepped: true.into(),
                    ..PhasesMemory::new_zeroed()
                };
            }
            FlightPhase::Armed => {
                let place = sight.vehicle.map_or([0.0; 3], |vehicle| vehicle.position_world);
                self.memory.ground = place[2];
                self.memory.ground_known = true.into();
            }
            FlightPhase::TakeOff => {
                if before == FlightPhase::Disarmed {
                    self.memory.airborne = true.into();
                    self.memory.carrying_thrust = sight.frame.map_or(0.0, |frame| frame.thrust);
                }
                if before == FlightPhase::Armed {
                    let from = sight
                        .vehicle
                        .map_or(sight.path, |vehicle| Vector3::from(vehicle.position_world));
                    let to = from - Vector3::z() * self.stated.takeoff_height;
                    self.begin(PhasesMemory::WAY_RISE, from, to);
                } else {
                    self.meet(PhasesMemory::WAY_TRANSIT, sight);
                }
            }
            FlightPhase::Fly => {
                self.memory.way = PhasesMemory::WAY_PATH;
                // A stop on the way to the path goes on with the path, which rests.
                (self.memory.stop_rate, self.memory.stop_acceleration) = (0.0, 0.0);
            }
            // Whatever else demands the landing at this step.
            FlightPhase::Land if conditions.strayed || conditions.stranded => {
                self.meet(PhasesMemory::WAY_DESCENT, sight);
            }
            FlightPhase::Land => {
                self.memory.stopping = true.into();
                // What is being brought to rest already goes on so: another stop would lead it backwards.
                if !self.memory.braking.is_set() {
                    self.memory
                        .begin_stop(self.rates(sight), self.stated.transition_time);
                }
                self.memory.braking = false.into();
            }
        }
    }

    fn begin(&mut self, way: u8, from: Vector3<f64>, to: Vector3<f64>) {
        let memory = &mut self.memory;
        (memory.way, memory.from_world, memory.to_world) = (way, from.into(), to.into());
        (memory.along, memory.along_rate, memory.along_acceleration) = (0.0, 1.0, 0.0);
        memory.waited = 0.0;
        (memory.stopping, memory.braking) = (false.into(), false.into());
        (memory.met_velocity, memory.resumed_ns) = ([0.0; 3], 0);
    }

    /// Begins a segment, to the path or down, where the vehicle comes to rest that is met in motion.
    fn meet(&mut self, way: u8, sight: &PhaseInput<'_>) {
        let Some(vehicle) = sight.vehicle else {
            return self.begin(way, sight.path, sight.path);
        };
        let velocity = vehicle.velocity_world();
        let from = Vector3::from(vehicle.position_world) + SlowDown { velocity }.way();
        self.begin(way, from, sight.path);
        self.memory.met_velocity = velocity.into();
    }

    fn leg(&self) -> Option<Leg> {
        let is_leg = matches!(
            self.memory.way,
            PhasesMemory::WAY_RISE | PhasesMemory::WAY_TRANSIT
        );
        is_leg.then(|| Leg {
            from: self.memory.from_world.into(),
            to: self.memory.to_world.into(),
            speed: self.stated.takeoff_speed,
        })
    }

    /// Returns the place of the reference in {I}, m.
    fn reference(&self, sight: &PhaseInput<'_>) -> Vector3<f64> {
        self.line_point().map_or(sight.path, |point| point.position)
    }

    /// Returns the difference of the vehicle's velocity from that of the reference, m/s; 0 of a vehicle whose place is not known.
    fn speed_from_reference(&self, sight: &PhaseInput<'_>) -> f64 {
        let along = self.line_point();
        let velocity = along.map_or(sight.path_velocity, |point| {
            point.derivative1 * self.memory.along_rate
        });
        sight
            .vehicle
            .map_or(0.0, |vehicle| (vehicle.velocity_world() - velocity).norm())
    }

    fn line_point(&self) -> Option<CurvePoint> {
        let velocity = self.memory.met_velocity.into();
        let point = self.segment_point()?;
        Some(SlowDown { velocity }.before(point, self.memory.along))
    }

    fn segment_point(&self) -> Option<CurvePoint> {
        if self.memory.way == PhasesMemory::WAY_DESCENT {
            let descent = Descent {
                from: self.memory.from_world.into(),
                speed: self.stated.landing_speed,
            };
            return Some(descent.at(self.memory.along));
        }
        self.leg().map(|leg| leg.at(self.memory.along))
    }
}

/// Returns the cause of a vehicle that was not ready, as references state it.
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

/// Returns the cause of a transition as references state it: the row's, with the origin of a demand. A kill or landing
/// that the newest frame demands for a limit is the envelope's, since the transmitter has acted on it before.
fn published_cause(row: &Row, now: &Now, sight: &PhaseInput<'_>, not_ready: Option<NotReady>) -> u8 {
    let of_envelope = |action: u8, base: u8| {
        let frame = sight.frame.filter(|frame| frame.action == action)?;
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
