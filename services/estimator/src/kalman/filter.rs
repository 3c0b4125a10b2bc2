//! Selection of captures, restarts of the filter, and prediction to the present.
//!
//! Failure policy, by the faults of captures:
//! * if they scatter more than stated, they get less weight: [`scatter`](super::scatter);
//! * one that is older than the state, or a repetition, changes nothing;
//! * one too far from the estimate ([`gate`](Kalman::gate)) is tested again under the assumption that the vehicle
//!   missed a frame and turned otherwise;
//! * one still too far is tested with a larger covariance of the whole state, for the first tenth of a second: a wrong
//!   model shows as innovations that are too large, and to refuse them would leave the state to that model;
//! * one still too far, as after a jump, is refused and counted; when all have been refused for
//!   [`restart_after`](Kalman::restart_after), the newest one is accepted instead and the filter restarts;
//! * one whose attitude no vehicle can have reached is refused and counted, however long that lasts, because the
//!   capture system has confused the markers: [`attitude_trust`](super::attitude_trust); while frames do not say how the
//!   vehicle turns, and for two seconds afterwards, attitudes are not tested, because the last one may be a false one,
//!   unless the last one was refused already;
//! * the position of such a capture corrects the state, unless it is too far from the estimate as well, because confused
//!   markers have the same centre; so the attitude stays right as far as a tilt shows as an acceleration;
//! * of a capture whose position is frozen the attitude corrects the state: with a known tilt the prediction
//!   of the position holds for some seconds, in which the state coasts and counts as tracked;
//! * one that is no pose at all, or from the future, is refused and counted, and the filter never starts from it;
//! * when impossible numbers (a thrust of 10⁷ N, say) have used up the digits of the covariance, the next accepted
//!   capture starts the filter from nothing;
//! * a frame that the vehicle does not receive ([`RcFrame::is_whole`]) is ignored, and so is one with more than the
//!   link can carry;
//! * while the vehicle stands on the ground, as a flight with phases begins and ends, the filter starts from every
//!   capture: the ground's support is no disturbance, and people may carry the vehicle about;
//! * a vehicle that has flown and touches the ground stands there until its thrust lifts it or it is seen to move:
//!   [`ground_contact`](super::ground_contact);
//! * without a capture used for two periods of the cameras and their latency the state coasts, and so it does while
//!   captures come more than 0.1 s late;
//! * without one for [`coast`](Kalman::coast) the prediction continues, but no longer counts as tracked; when
//!   `restart_after` has passed as well the vehicle is lost: there is no state any more, and the next capture restarts
//!   the filter.

mod parts;

use nalgebra::SVector;
use scenario::{Kalman, Key, Model, Problem, RcLink, Scenario};
use shared_types::rotation::{from_row_major, to_row_major};
use shared_types::samples::{MocapPose, RcFrame};
use shared_types::service::nanoseconds;
use shared_types::{Schedule, ServiceId, Topic};

use super::attitude_trust::AttitudeTrust;
use super::commands::{CAPACITY, CommandHistory};
use super::error_state::ProcessNoise;
use super::filter_state::{FilterState, Innovation, MEASURED, MarkerOffset, Pose, PoseNoise, ProcessModel};
use super::ground_contact::{Ground, Rest};
use super::motion::{Actuation, VehicleModel};
use super::scatter::Scatter;
use crate::source::{Estimate, is_pose};

/// Tolerance of a channel's meaning beyond its limits, as a share.
const ROUNDING: f64 = 1e-9;

/// Time for which the motors of a vehicle that hardly moves must stop before it counts as standing on the ground, ns.
const LANDED_AFTER_NS: u64 = 300_000_000;
/// Time for which the vehicle turns as the last frame states, ns: a receiver that hears nothing then acts by itself.
const TURN_KNOWN_NS: u64 = 250_000_000;
/// Time in which attitudes are not tested, ns: after the first start, because the rate bias is not known well and with
/// it the predicted attitude (a restart keeps the bias); and after an attitude that was used although nothing said how
/// the vehicle turned, because it may have been a false one.
const SETTLED_NS: u64 = 2_000_000_000;
/// Lateness of captures above which the state coasts, ns: so far predicted, the law of a landing acts on a ground that the
/// vehicle has met long ago.
const LATE_NS: u64 = 100_000_000;
/// Speed below which it hardly moves, m/s.
const HARDLY: f64 = 0.1;

/// Standard deviation of a component of the velocity above which that of a vehicle in flight is not known, m/s: one capture
/// after a restart tells nothing of it, the second one enough.
const UNSURE: f64 = 0.3;

/// Largest factors on the covariance of the state before a capture is refused.
const LESS_SURE: [f64; 2] = [4.0, 16.0];

/// Time after the last used capture for which these factors apply, ns. Later the state is unsure enough that a jump of
/// centimetres could be taken for a speed.
const LESS_SURE_FOR_NS: u64 = 100_000_000;

/// Time for which a state without positions counts as tracked as long as attitudes correct it, ns.
const LEVELLED_NS: u64 = 3_000_000_000;

/// Outcome of a capture.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// It holds nothing new: the body is not seen, or was seen later already.
    Ignored,
    /// The filter starts from it.
    Started,
    /// It has corrected the state; the whitened innovation.
    Used(SVector<f64, MEASURED>),
    /// It is impossible.
    Refused,
}

/// Kalman filter with its memory.
#[derive(Clone, Debug)]
pub struct KalmanFilter {
    process: ProcessModel,
    pose_noise: PoseNoise,
    gate: f64,
    restart_after_ns: u64,
    coast_ns: u64,
    /// Time without a capture after which one must be missing, ns.
    patience_ns: u64,
    /// Age of the newest exposure after which captures are late, ns.
    oldest_ns: u64,
    prediction: bool,
    /// Largest thrust (N) and body rates (rad/s) that the link can carry.
    most_sent: [f64; 4],
    radio_latency_ns: u64,
    capture_latency_ns: Option<u64>,
    /// `true` if there is a ground to stand on.
    has_ground: bool,
    pub(super) memory: Memory,
}

/// Memory of the filter from step to step.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    /// The frames already sent that still matter.
    pub history: CommandHistory,
    /// Time since which all frames have stopped the motors, ns since the start of the flight.
    pub rests_since_ns: Option<u64>,
    /// Time from which the newest frame with body rates acts, ns since the start of the flight.
    pub rates_stated_ns: Option<u64>,
    /// Time from which on frames have stated the body rates without a gap of [`TURN_KNOWN_NS`], ns since the start of the
    /// flight.
    pub turn_known_from_ns: u64,
    /// The estimate with its times; `None` before the first capture.
    pub track: Option<Track>,
    /// Captures refused since the start of the flight.
    pub captures_refused: u32,
    /// Scatter of the captures.
    pub scatter: Scatter,
}

/// Estimate and the captures that it rests on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Track {
    /// The estimate, at the time of the last tested capture.
    pub state: FilterState,
    /// Time at which a position was used last, ns since the start of the flight.
    pub used_at_ns: u64,
    /// Time at which an attitude was used last, ns since the start of the flight.
    pub levelled_at_ns: u64,
    /// Exposure of the first of the captures refused in a row, ns since the start of the flight.
    pub refused_since_ns: Option<u64>,
    /// Exposure from which on attitudes settle, ns since the start of the flight: that of the first start, or of the last
    /// attitude that was not tested because the turn of the vehicle was not known.
    pub settling_since_ns: u64,
    /// The last attitude that the vehicle can have reached.
    pub trust: AttitudeTrust,
    /// The ground, as far as the captures show it.
    pub ground: Ground,
}

impl Track {
    /// Begins the comparison of rest and free flight at a capture, if it has to begin again.
    fn compare_rest(&mut self, exposure_ns: u64, pose: &Pose) {
        if self.ground.rest.is_over() {
            self.ground.rest = Rest::new(exposure_ns, pose, &self.state.nominal);
        }
    }
}

impl KalmanFilter {
    /// Makes the filter of a scenario.
    ///
    /// # Errors
    /// More frames are under way between the exposure of a capture and the acting of the newest frame than the
    /// history holds ([`CAPACITY`]); or the scenario's times make no schedule.
    pub fn new(scenario: &Scenario, kalman: &Kalman) -> Result<Self, Problem> {
        let model = scenario.model.clone().unwrap_or_default();
        let schedule = schedule_of(scenario)?;
        check_history(scenario, &schedule, &model)?;
        let has_ground = scenario.flight.is_some();
        let patience_ns = longest_gap_ns(scenario, &schedule);
        Ok(Self {
            patience_ns,
            oldest_ns: patience_ns + usual_latency_ns(scenario, &model) + LATE_NS,
            process: ProcessModel {
                vehicle: VehicleModel::new(&model),
                noise: ProcessNoise::new(kalman),
                marker_offset: MarkerOffset::new(&model, kalman),
            },
            pose_noise: PoseNoise::new(kalman),
            gate: kalman.gate,
            restart_after_ns: nanoseconds(kalman.restart_after),
            coast_ns: nanoseconds(kalman.coast),
            prediction: kalman.prediction,
            most_sent: scenario.rc_output.as_ref().map_or([f64::INFINITY; 4], most_sent),
            radio_latency_ns: nanoseconds(model.radio_latency),
            capture_latency_ns: model.capture_latency.map(nanoseconds),
            has_ground,
            memory: Memory {
                history: if has_ground {
                    CommandHistory::resting()
                } else {
                    CommandHistory::hovering(model.mass)
                },
                rests_since_ns: None,
                rates_stated_ns: None,
                turn_known_from_ns: 0,
                track: None,
                captures_refused: 0,
                scatter: Scatter::new(PoseNoise::new(kalman)),
            },
        })
    }

    /// Takes a frame that has been sent.
    ///
    /// If the history is full, as in a long time without captures, the state is propagated to the begin of its second
    /// command, so that no command is dropped before it has been used; older captures then come too late.
    pub fn hear(&mut self, now_ns: u64, frame: &RcFrame) {
        if !frame.is_whole() || !self.can_be_sent(frame) {
            return;
        }
        let Memory { history, track, .. } = &mut self.memory;
        if history.is_full() {
            let second_begins = history.commands()[1].acts_from_ns.min(now_ns);
            if let Some(track) = track {
                track.state.propagate(second_begins, &self.process, history);
                track.ground.rest.end();
            }
            history.forget_oldest();
        }
        let acts_from_ns = frame.header.stamp_ns.saturating_add(self.radio_latency_ns);
        history.push(history.meaning(acts_from_ns, frame));
        if frame.mode == RcFrame::MODE_RATES && !frame.failsafe.is_set() {
            if !self.is_turn_stated(acts_from_ns) {
                self.memory.turn_known_from_ns = acts_from_ns;
            }
            self.memory.rates_stated_ns = Some(acts_from_ns);
        }
        let rests_since_ns = &mut self.memory.rests_since_ns;
        *rests_since_ns = rests_since_ns
            .or(Some(acts_from_ns))
            .filter(|_| frame.failsafe.is_set());
    }

    /// Returns whether the link can carry a frame.
    fn can_be_sent(&self, frame: &RcFrame) -> bool {
        let [most_thrust, rates @ ..] = self.most_sent;
        let asked = frame.rates_body.iter().zip(&rates);
        frame.thrust.abs() <= most_thrust && asked.into_iter().all(|(rate, most)| rate.abs() <= *most)
    }

    /// Tests a capture that has arrived.
    pub fn see(&mut self, now_ns: u64, capture: &MocapPose) -> Outcome {
        if !capture.tracked.is_set() {
            return Outcome::Ignored;
        }
        let exposure_ns = match self.capture_latency_ns {
            Some(latency) => now_ns.saturating_sub(latency),
            None => capture.capture_time_ns,
        };
        let Some(pose) = pose_of(capture).filter(|_| exposure_ns <= now_ns) else {
            return self.refuse();
        };
        let is_whole = capture.is_whole();
        if !is_whole && self.is_long_lost(now_ns) {
            return self.refuse();
        }
        let Some(mut track) = self.memory.track else {
            return self.start_from(now_ns, exposure_ns, &pose);
        };
        if exposure_ns <= track.state.time_ns {
            return Outcome::Ignored;
        }
        if is_whole && self.is_lost(now_ns) && track.state.stands {
            return self.start_from(now_ns, exposure_ns, &pose);
        }
        let history = &mut self.memory.history;
        let turn_if_missed = history.turn_if_missed(track.state.time_ns, exposure_ns);
        track.state.propagate(exposure_ns, &self.process, history);
        if self.has_ground && track.ground.has_flown {
            track.ground.rest.fly(exposure_ns, &self.process.vehicle, history);
        }
        history.forget_before(exposure_ns);
        let predicted = track.state.nominal.world_from_body;
        // One that has landed is tested too while its motors turn: the law acts on its attitude.
        let motors_turn = !self.has_come_to_rest(exposure_ns);
        let flies = motors_turn && (!track.state.stands || track.ground.has_flown);
        let is_turn_known = self.is_turn_known(track.trust.trusted_ns, exposure_ns);
        if flies && !is_turn_known && !track.trust.is_refused_until(exposure_ns) {
            track.settling_since_ns = exposure_ns;
        }
        let has_settled = exposure_ns >= track.settling_since_ns.saturating_add(SETTLED_NS);
        let is_reached =
            !(flies && has_settled) || track.trust.test(exposure_ns, &predicted, &pose.world_from_body);
        if !(is_whole && is_reached) {
            match (capture.has_position(), capture.has_attitude() && is_reached) {
                (true, false) if flies => self.take_position(now_ns, exposure_ns, &pose, track),
                (false, true) if flies => {
                    self.take_attitude(now_ns, exposure_ns, &pose, track, turn_if_missed);
                }
                _ => self.memory.track = Some(track),
            }
            return self.refuse();
        }
        if self.is_lost(now_ns) {
            return self.restart(now_ns, exposure_ns, &pose, &track);
        }
        if self.has_ground && track.ground.has_flown && motors_turn {
            if self.touches_down(&pose, &mut track) {
                return self.land(now_ns, exposure_ns, &pose, &track);
            }
            // It moves, or this capture is a false one: tested as in flight.
            track.state.stands = false;
        }
        track.ground.observe_rise(&pose.position_world);
        let (residual, stated) = (track.state.residual(&pose), self.pose_noise);
        let scatter = &mut self.memory.scatter;
        scatter.observe(&residual, &track.state.pose_covariance(), stated);
        if track.state.stands {
            return self.stand(now_ns, exposure_ns, &pose, &track);
        }
        let unused_ns = now_ns.saturating_sub(track.used_at_ns);
        let noise = self.noise();
        let likely = self.likely(&track.state, turn_if_missed, unused_ns, residual, noise);
        if let Some((believed, innovation)) = likely {
            track.state = believed;
            track.state.correct(&innovation, noise);
            if !track.state.is_sound() {
                return self.start_from(now_ns, exposure_ns, &pose);
            }
            if self.has_landed(&track.state) {
                return self.stand(now_ns, exposure_ns, &pose, &track);
            }
            (track.used_at_ns, track.levelled_at_ns) = (now_ns, now_ns);
            track.refused_since_ns = None;
            let corrected = &track.state.nominal.world_from_body;
            track.trust = AttitudeTrust::new(exposure_ns, corrected, &pose.world_from_body);
            track.compare_rest(exposure_ns, &pose);
            self.memory.track = Some(track);
            return Outcome::Used(innovation.whitened());
        }
        let refused_since_ns = *track.refused_since_ns.get_or_insert(exposure_ns);
        if exposure_ns - refused_since_ns >= self.restart_after_ns {
            return self.restart(now_ns, exposure_ns, &pose, &track);
        }
        track.trust = AttitudeTrust::new(exposure_ns, &predicted, &pose.world_from_body);
        track.compare_rest(exposure_ns, &pose);
        self.memory.track = Some(track);
        self.refuse()
    }

    /// Returns whether a capture shows that the ground holds the vehicle, which has flown.
    fn touches_down(&self, pose: &Pose, track: &mut Track) -> bool {
        let rest = &mut track.ground.rest;
        if track.state.stands {
            rest.holds(pose, self.noise())
        } else {
            rest.observe(pose, self.noise())
        }
    }

    /// Starts from a capture of a vehicle that the ground holds, with what was known of it in flight.
    fn land(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose, track: &Track) -> Outcome {
        let flight = &track.ground.rest.free;
        let state = track.state.landed(exposure_ns, pose, self.noise(), flight);
        self.start(now_ns, state, track.settling_since_ns);
        if let Some(landed) = &mut self.memory.track {
            landed.ground = track.ground;
        }
        Outcome::Started
    }

    /// Returns the noise of measured poses, as far as it is known.
    fn noise(&self) -> PoseNoise {
        self.memory.scatter.noise(self.pose_noise)
    }

    /// Returns the innovation of a pose with the first of these states from which it is not too far: the estimate, one that
    /// has missed a frame, and for a time after the last capture that was used less sure ones.
    fn likely(
        &self,
        estimate: &FilterState,
        turn_if_missed: f64,
        unused_ns: u64,
        residual: SVector<f64, MEASURED>,
        noise: PoseNoise,
    ) -> Option<(FilterState, Innovation)> {
        let doubtful = estimate.less_sure_of_attitude(turn_if_missed);
        let less_sure = LESS_SURE.into_iter().filter(|_| unused_ns <= LESS_SURE_FOR_NS);
        [*estimate, doubtful]
            .into_iter()
            .chain(less_sure.map(|times| doubtful.less_sure(times)))
            .find_map(|state| {
                let innovation = state.innovation(residual, noise)?;
                (innovation.squared_distance() <= self.gate).then_some((state, innovation))
            })
    }

    /// Returns the state now: predicted to the time at which a frame sent now acts, or else at the last capture. `None`
    /// before the first capture, and when the vehicle is lost.
    #[must_use]
    pub fn estimate(&self, now_ns: u64) -> Option<Estimate> {
        let track = self.memory.track.as_ref().filter(|_| !self.is_lost(now_ns))?;
        let (mut state, vehicle) = (track.state, &self.process.vehicle);
        if self.prediction {
            let acts_from_ns = now_ns.saturating_add(self.radio_latency_ns);
            state.propagate(acts_from_ns, &self.process, &self.memory.history);
        }
        Some(estimate_of(&state, vehicle))
    }

    /// Returns whether a capture has been used recently enough.
    #[must_use]
    pub fn is_tracking(&self, now_ns: u64) -> bool {
        self.unseen_for_ns(now_ns)
            .is_some_and(|unseen| unseen <= self.coast_ns || self.is_levelled(now_ns))
    }

    /// Returns whether attitudes still correct a state that has had no position for a while.
    fn is_levelled(&self, now_ns: u64) -> bool {
        self.memory.track.as_ref().is_some_and(|track| {
            now_ns.saturating_sub(track.levelled_at_ns) <= self.coast_ns
                && now_ns.saturating_sub(track.used_at_ns) <= LEVELLED_NS
        })
    }

    /// Returns whether due captures are missing, so that the state is predicted further than usual; or a vehicle in flight
    /// has only just been seen again, so that its velocity is not known yet.
    #[must_use]
    pub fn is_coasting(&self, now_ns: u64) -> bool {
        let is_late = |track: &Track| {
            let has_flown = self.has_ground && track.ground.has_flown;
            let is_unsure = has_flown && track.state.velocity_deviation() > UNSURE;
            is_unsure || now_ns.saturating_sub(track.state.time_ns) > self.oldest_ns
        };
        let is_silent = self
            .unseen_for_ns(now_ns)
            .is_some_and(|unseen| unseen > self.patience_ns);
        is_silent || self.memory.track.as_ref().is_some_and(is_late)
    }

    /// Returns the number of captures refused since the start of the flight.
    #[must_use]
    pub fn captures_refused(&self) -> u32 {
        self.memory.captures_refused
    }

    /// Returns the estimate at the time of the last tested capture; `None` before the first.
    #[must_use]
    pub fn state(&self) -> Option<&FilterState> {
        self.memory.track.as_ref().map(|track| &track.state)
    }

    /// Returns whether the vehicle was seen once, but too long ago.
    fn is_lost(&self, now_ns: u64) -> bool {
        let longest = self.coast_ns.saturating_add(self.restart_after_ns);
        self.unseen_for_ns(now_ns).is_some_and(|unseen| unseen > longest) && !self.is_levelled(now_ns)
    }

    /// Returns whether a part of a capture says nothing of a vehicle that was seen last so long ago.
    fn is_long_lost(&self, now_ns: u64) -> bool {
        self.unseen_for_ns(now_ns)
            .is_none_or(|unseen| unseen > LEVELLED_NS)
    }

    /// Returns the time since a capture was used last, ns.
    fn unseen_for_ns(&self, now_ns: u64) -> Option<u64> {
        let track = self.memory.track.as_ref()?;
        Some(now_ns.saturating_sub(track.used_at_ns))
    }

    fn start_from(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose) -> Outcome {
        let actuation = Actuation::settled(self.memory.history.acting(exposure_ns));
        let offset = self.process.marker_offset;
        let state = if self.has_ground && self.process.vehicle.is_held(&actuation, 0.0) {
            FilterState::standing(exposure_ns, pose, self.noise(), offset, actuation)
        } else {
            FilterState::from_pose(exposure_ns, pose, self.noise(), offset, actuation)
        };
        let settling_since_ns = self.memory.track.map(|track| track.settling_since_ns);
        self.start(now_ns, state, settling_since_ns.unwrap_or(exposure_ns))
    }

    /// Starts from a capture of a vehicle that stands on the ground.
    fn stand(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose, last: &Track) -> Outcome {
        let (offset, actuation) = (self.process.marker_offset, last.state.nominal.actuation);
        let state = FilterState::standing(exposure_ns, pose, self.noise(), offset, actuation);
        self.start(now_ns, state, last.settling_since_ns)
    }

    /// Returns whether a vehicle that flew stands on the ground again.
    fn has_landed(&self, state: &FilterState) -> bool {
        self.has_ground
            && self.has_come_to_rest(state.time_ns)
            && state.nominal.velocity_world.norm() < HARDLY
    }

    /// Returns whether frames state the rates at which the vehicle turned from one time to another.
    fn is_turn_known(&self, from_ns: u64, to_ns: u64) -> bool {
        self.memory.turn_known_from_ns <= from_ns && self.is_turn_stated(to_ns)
    }

    /// Returns whether a recent frame states the rates at which the vehicle turns.
    fn is_turn_stated(&self, time_ns: u64) -> bool {
        let rates_stated_ns = self.memory.rates_stated_ns;
        rates_stated_ns.is_some_and(|at| time_ns <= at.saturating_add(TURN_KNOWN_NS))
    }

    /// Returns whether the motors have been stopped for so long that a vehicle on the ground stands still.
    fn has_come_to_rest(&self, time_ns: u64) -> bool {
        let rests_since_ns = self.memory.rests_since_ns;
        rests_since_ns.is_some_and(|since| time_ns >= since.saturating_add(LANDED_AFTER_NS))
    }

    fn restart(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose, last: &Track) -> Outcome {
        let (noise, history) = (self.noise(), &self.memory.history);
        let state = last
            .state
            .restarted(exposure_ns, pose, noise, &self.process, history);
        self.start(now_ns, state, last.settling_since_ns)
    }

    fn start(&mut self, now_ns: u64, state: FilterState, settling_since_ns: u64) -> Outcome {
        self.memory.history.forget_before(state.time_ns);
        self.memory.scatter.innovation = SVector::zeros();
        let attitude = &state.nominal.world_from_body;
        let mut ground = Ground::new(state.time_ns, &state.nominal, state.stands);
        if let (false, Some(before)) = (state.stands, &self.memory.track) {
            (ground.stood_z, ground.has_flown) = (before.ground.stood_z, before.ground.has_flown);
        }
        self.memory.track = Some(Track {
            settling_since_ns,
            trust: AttitudeTrust::new(state.time_ns, attitude, attitude),
            ground,
            state,
            used_at_ns: now_ns,
            levelled_at_ns: now_ns,
            refused_since_ns: None,
        });
        Outcome::Started
    }

    fn refuse(&mut self) -> Outcome {
        self.memory.captures_refused = self.memory.captures_refused.saturating_add(1);
        Outcome::Refused
    }
}

/// Returns the largest thrust (N) and body rates (rad/s) that a link can carry, with a tolerance for rounding.
fn most_sent(link: &RcLink) -> [f64; 4] {
    let [_, thrust] = link.thrust_limits();
    let [least, most] = link.rate_range.map(f64::abs);
    let [x, y, z] = link.rate_slope.map(|slope| slope.abs() * least.max(most));
    [thrust, x, y, z].map(|limit| limit * (1.0 + ROUNDING))
}

/// Returns the pose of a capture, if it holds one.
fn pose_of(capture: &MocapPose) -> Option<Pose> {
    let pose = Pose {
        position_world: capture.position_world.into(),
        world_from_body: from_row_major(&capture.world_from_body),
    };
    is_pose(capture).then_some(pose)
}

fn estimate_of(state: &FilterState, vehicle: &VehicleModel) -> Estimate {
    let nominal = &state.nominal;
    let variances = state.pose_covariance().fixed_view::<3, 3>(0, 0).diagonal();
    Estimate {
        state_time_ns: state.time_ns,
        position_world: nominal.tracked_point().into(),
        world_from_body: to_row_major(&nominal.world_from_body),
        velocity_body: nominal.world_from_body.tr_mul(&nominal.velocity_world).into(),
        angular_velocity_body: if state.stands {
            [0.0; 3]
        } else {
            (nominal.actuation.rates_body + nominal.rate_bias_body).into()
        },
        acceleration_world: if state.stands {
            [0.0; 3]
        } else {
            vehicle.acceleration(nominal).into()
        },
        thrust: nominal.actuation.thrust,
        position_sigma: variances.max().max(0.0).sqrt(),
    }
}

fn schedule_of(scenario: &Scenario) -> Result<Schedule, Problem> {
    scenario
        .schedule()
        .map_err(|mut problems| problems.swap_remove(0))
}

/// Returns the longest time between two used captures if none is missing but one by chance, ns.
fn longest_gap_ns(scenario: &Scenario, schedule: &Schedule) -> u64 {
    let captures = schedule.edge(ServiceId::Estimator, 0);
    2 * scenario.between_captures_ns(schedule) + schedule.time_ns(captures.latency)
}

/// Refuses latencies during which more frames are sent than the history holds.
fn check_history(scenario: &Scenario, schedule: &Schedule, model: &Model) -> Result<(), Problem> {
    let needed = commands_under_way(scenario, schedule, model);
    if needed <= CAPACITY as u64 {
        return Ok(());
    }
    Err(Problem::new(
        Key::root().then("model").then("radio_latency"),
        format!(
            "the estimator remembers {CAPACITY} frames, but from the exposure of a capture to the acting of the \
             newest frame {needed} are sent"
        ),
        "shorten this latency, that of `mocap/pose -> estimator`, `model.capture_latency` or the period of \
         `mocap/pose`, or give `rc/frame` a longer period",
    ))
}

/// Returns the usual age of an exposure when its capture arrives from the cameras, ns.
fn usual_latency_ns(scenario: &Scenario, model: &Model) -> u64 {
    let believed_ns = nanoseconds(model.capture_latency.unwrap_or(0.0));
    scenario.capture_latency_ns().max(believed_ns)
}

/// Returns the number of commands that act, or are sent and will, between the last capture and the time of the
/// prediction.
fn commands_under_way(scenario: &Scenario, schedule: &Schedule, model: &Model) -> u64 {
    let captures = schedule.edge(ServiceId::Estimator, 0);
    let ticks = captures.latency + schedule.service_rate(ServiceId::Estimator).period;
    let arrival_ns = schedule.time_ns(ticks) + scenario.between_captures_ns(schedule);
    let capture_age_ns =
        (arrival_ns + scenario.capture_latency_ns()).max(nanoseconds(model.capture_latency.unwrap_or(0.0)));
    let frame_period_ns = schedule.time_ns(schedule.topic_rate(Topic::RcFrame).period);
    // One more acts at the beginning, the one before it is kept, and another may begin at either end.
    (capture_age_ns.saturating_add(nanoseconds(model.radio_latency))).div_ceil(frame_period_ns) + 3
}
