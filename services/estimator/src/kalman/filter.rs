//! Selection of captures, restarts of the filter, and prediction to the present.
//!
//! Failure policy, by the faults of captures:
//! * captures that scatter more than stated have less weight: [`scatter`](super::scatter);
//! * a capture that is older than the state, or repeated, is ignored;
//! * a capture too far from the estimate ([`gate`](Kalman::gate)) is tested again under the assumption that the vehicle
//!   missed a frame and turned differently;
//! * then it is tested with a larger covariance of the whole state, in the first tenth of a second: a wrong model causes
//!   innovations that are too large, and refusing them would leave the state to that model;
//! * if it is still too far, as after a jump, it is refused and counted; when all captures have been refused for
//!   [`restart_after`](Kalman::restart_after), the newest one is accepted and the filter restarts;
//! * a capture with an implausible attitude is refused and counted for any time, because the capture system has confused the
//!   markers: [`attitude_trust`](super::attitude_trust). While the frames do not determine the vehicle's turn, and for two
//!   seconds afterwards, attitudes are not tested, because the last one may be false, unless it was refused;
//! * the position of such a capture corrects the state if it is near the estimate, because confused markers have the same
//!   centre; so the attitude remains right as far as a tilt is observable as an acceleration;
//! * the attitude of a capture with a frozen position corrects the state: with a known tilt the predicted position is valid
//!   for some seconds, in which the state coasts and counts as tracked;
//! * an invalid pose, or one from the future, is refused and counted, and the filter never starts from it;
//! * when impossible numbers (such as a thrust of 10⁷ N) have made the covariance singular, the filter starts afresh from the
//!   next accepted capture;
//! * a frame that the vehicle cannot receive ([`RcFrame::is_whole`]) is ignored, as is one beyond the limits of the link;
//! * while the vehicle stands on the ground, before and after a flight with phases, the filter starts from every capture:
//!   the support of the ground is no disturbance, and the vehicle may be carried;
//! * a vehicle that has flown and touches the ground is at rest until its thrust lifts it or a capture shows a motion:
//!   [`ground_contact`](super::ground_contact);
//! * the state coasts if no capture was used for two camera periods and their latency, and while captures are more than
//!   0.1 s late;
//! * without a used capture for [`coast`](Kalman::coast) the prediction continues, but does not count as tracked. After
//!   `restart_after` in addition the vehicle is lost: there is no state, and the next capture restarts the filter.

mod parts;

use nalgebra::SVector;
use scenario::{Kalman, Model, Problem, RcLink, Scenario};
use shared_types::rotation::{from_row_major, to_row_major};
use shared_types::samples::{MocapPose, RcFrame};
use shared_types::service::nanoseconds;
use shared_types::{Schedule, ServiceId};

use super::attitude_trust::AttitudeTrust;
use super::commands::CommandHistory;
use super::error_state::ProcessNoise;
use super::filter_state::{FilterState, Innovation, MEASURED, MarkerOffset, Pose, PoseNoise, ProcessModel};
use super::ground_contact::{Ground, Rest};
use super::motion::{Actuation, VehicleModel};
use super::scatter::Scatter;
use crate::source::{Estimate, is_pose};

/// Relative tolerance of a channel's limits.
const ROUNDING: f64 = 1e-9;

/// Time with stopped motors after which a vehicle at standstill counts as landed, ns.
const LANDED_AFTER_NS: u64 = 300_000_000;
/// Time for which the last frame determines the vehicle's turn, ns: then the receiver's failsafe acts.
const TURN_KNOWN_NS: u64 = 250_000_000;
/// Time in which attitudes are not tested, ns: after the first start, because the rate bias and with it the predicted
/// attitude are inaccurate (a restart keeps the bias); and after an attitude that was used while the turn was unknown,
/// because it may be false.
const SETTLED_NS: u64 = 2_000_000_000;
/// Lateness of captures above which the state coasts, ns: with a longer prediction, a landing would react to the touch-down
/// too late.
const LATE_NS: u64 = 100_000_000;
/// Speed of a vehicle at standstill, m/s.
const STANDSTILL: f64 = 0.1;

/// Standard deviation of a component above which the velocity of a vehicle in flight is unknown, m/s: after a restart the
/// first capture gives no velocity, the second one does.
const UNKNOWN_VELOCITY: f64 = 0.3;

/// Factors on the covariance with which a capture is tested before its refusal.
const INFLATIONS: [f64; 2] = [4.0, 16.0];

/// Time after the last used capture in which these factors apply, ns. Later the covariance is large enough that a jump of
/// centimetres could be attributed to the velocity.
const INFLATED_FOR_NS: u64 = 100_000_000;

/// Time for which a state without positions counts as tracked as long as attitudes correct it, ns.
const LEVELLED_NS: u64 = 3_000_000_000;

/// Outcome of a capture.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// It has no pose, or is not newer than the state.
    Ignored,
    /// The filter starts from it.
    Started,
    /// It has corrected the state; this is the whitened innovation.
    Used(SVector<f64, MEASURED>),
    /// It is impossible.
    Refused,
}

#[derive(Clone, Debug)]
pub struct KalmanFilter {
    process: ProcessModel,
    pose_noise: PoseNoise,
    gate: f64,
    restart_after_ns: u64,
    coast_ns: u64,
    /// Time without a used capture after which the state coasts, ns.
    capture_timeout_ns: u64,
    /// Age of the newest exposure above which captures are late, ns.
    oldest_ns: u64,
    prediction: bool,
    /// Maximum thrust (N) and body rates (rad/s) of the link.
    link_limits: [f64; 4],
    radio_latency_ns: u64,
    capture_latency_ns: Option<u64>,
    /// `true` if the flight begins and ends on the ground.
    has_ground: bool,
    pub(super) persistent: PersistentState,
}

/// State of the filter from step to step.
#[derive(Clone, Debug)]
pub(super) struct PersistentState {
    /// Sent frames that are in effect, in transit, or needed for the propagation.
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

/// Estimate, and the history of its captures.
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
    /// Begin of the time in which attitudes are not tested, ns since the start of the flight: exposure of the first start, or
    /// of the last attitude that was used while the vehicle's turn was unknown.
    pub settling_since_ns: u64,
    /// The last plausible attitude.
    pub trust: AttitudeTrust,
    /// The ground, as far as observed.
    pub ground: Ground,
}

impl Track {
    /// Restarts the comparison of rest and free flight at a capture, if it is over.
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
    /// If more frames are sent between the exposure of a capture and the effect of the newest frame than the history holds
    /// ([`CAPACITY`](super::commands::CAPACITY)), or if the scenario has no valid schedule.
    pub fn new(scenario: &Scenario, kalman: &Kalman) -> Result<Self, Problem> {
        let model = scenario.model.clone().unwrap_or_default();
        let schedule = schedule_of(scenario)?;
        CommandHistory::check_capacity(
            greatest_age_ns(scenario, &schedule, &model),
            &model,
            &schedule,
            "the exposure of a capture",
            "that of `mocap/pose -> estimator`, `model.capture_latency` or the period of `mocap/pose`",
        )?;
        let has_ground = scenario.flight.is_some();
        let capture_timeout_ns = longest_gap_ns(scenario, &schedule);
        Ok(Self {
            capture_timeout_ns,
            oldest_ns: capture_timeout_ns + usual_latency_ns(scenario, &model) + LATE_NS,
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
            link_limits: scenario
                .rc_output
                .as_ref()
                .map_or([f64::INFINITY; 4], link_limits),
            radio_latency_ns: nanoseconds(model.radio_latency),
            capture_latency_ns: model.capture_latency.map(nanoseconds),
            has_ground,
            persistent: PersistentState {
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

    /// Adds a sent frame.
    ///
    /// If the history is full, as after a long time without captures, propagates the state to the beginning of the second
    /// command, so that no command is dropped before its use; captures older than that are then too late.
    pub fn add_frame(&mut self, now_ns: u64, frame: &RcFrame) {
        if !frame.is_whole() || !self.can_be_sent(frame) {
            return;
        }
        let PersistentState { history, track, .. } = &mut self.persistent;
        if history.is_full() {
            let second_begins = history.commands()[1].acts_from_ns.min(now_ns);
            if let Some(track) = track {
                track.state.propagate(second_begins, &self.process, history);
                track.ground.rest.end();
            }
            history.drop_oldest();
        }
        let acts_from_ns = frame.header.stamp_ns.saturating_add(self.radio_latency_ns);
        history.push(history.command_of(acts_from_ns, frame));
        if frame.mode == RcFrame::MODE_RATES && !frame.failsafe.is_set() {
            if !self.is_turn_stated(acts_from_ns) {
                self.persistent.turn_known_from_ns = acts_from_ns;
            }
            self.persistent.rates_stated_ns = Some(acts_from_ns);
        }
        let rests_since_ns = &mut self.persistent.rests_since_ns;
        *rests_since_ns = rests_since_ns
            .or(Some(acts_from_ns))
            .filter(|_| frame.failsafe.is_set());
    }

    /// Returns whether a frame is within the limits of the link.
    fn can_be_sent(&self, frame: &RcFrame) -> bool {
        let [max_thrust, max_rates @ ..] = self.link_limits;
        let mut rates = frame.rates_body.iter().zip(&max_rates);
        frame.thrust.abs() <= max_thrust && rates.all(|(rate, max)| rate.abs() <= *max)
    }

    /// Tests a capture that has arrived, and uses it if it is plausible.
    pub fn add_capture(&mut self, now_ns: u64, capture: &MocapPose) -> Outcome {
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
        let Some(mut track) = self.persistent.track else {
            return self.start_from(now_ns, exposure_ns, &pose);
        };
        if exposure_ns <= track.state.time_ns {
            return Outcome::Ignored;
        }
        if is_whole && self.is_lost(now_ns) && track.state.stands {
            return self.start_from(now_ns, exposure_ns, &pose);
        }
        let history = &mut self.persistent.history;
        let turn_if_missed = history.turn_if_missed(track.state.time_ns, exposure_ns);
        track.state.propagate(exposure_ns, &self.process, history);
        if self.has_ground && track.ground.has_flown {
            track.ground.rest.fly(exposure_ns, &self.process.vehicle, history);
        }
        history.drop_before(exposure_ns);
        let predicted = track.state.nominal.world_from_body;
        // Attitudes of a landed vehicle are tested as well while its motors turn: the law uses them.
        let motors_turn = !self.has_stopped(exposure_ns);
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
                (true, false) if flies => self.use_position(now_ns, exposure_ns, &pose, track),
                (false, true) if flies => {
                    self.use_attitude(now_ns, exposure_ns, &pose, track, turn_if_missed);
                }
                _ => self.persistent.track = Some(track),
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
            // The vehicle moves or the capture is false: tested as in flight.
            track.state.stands = false;
        }
        track.ground.observe_rise(&pose.position_world);
        let (residual, stated) = (track.state.residual(&pose), self.pose_noise);
        let scatter = &mut self.persistent.scatter;
        scatter.observe(&residual, &track.state.pose_covariance(), stated);
        if track.state.stands {
            return self.stand(now_ns, exposure_ns, &pose, &track);
        }
        let unused_ns = now_ns.saturating_sub(track.used_at_ns);
        let noise = self.noise();
        let gated = self.gated(&track.state, turn_if_missed, unused_ns, residual, noise);
        if let Some((assumed, innovation)) = gated {
            track.state = assumed;
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
            self.persistent.track = Some(track);
            return Outcome::Used(innovation.whitened());
        }
        let refused_since_ns = *track.refused_since_ns.get_or_insert(exposure_ns);
        if exposure_ns - refused_since_ns >= self.restart_after_ns {
            return self.restart(now_ns, exposure_ns, &pose, &track);
        }
        track.trust = AttitudeTrust::new(exposure_ns, &predicted, &pose.world_from_body);
        track.compare_rest(exposure_ns, &pose);
        self.persistent.track = Some(track);
        self.refuse()
    }

    /// Returns whether a capture shows a vehicle that has flown to be on the ground.
    fn touches_down(&self, pose: &Pose, track: &mut Track) -> bool {
        let rest = &mut track.ground.rest;
        if track.state.stands {
            rest.holds(pose, self.noise())
        } else {
            rest.observe(pose, self.noise())
        }
    }

    /// Starts from a capture of a landed vehicle, with the slow states of the flight.
    fn land(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose, track: &Track) -> Outcome {
        let flight = &track.ground.rest.free;
        let state = track.state.landed(exposure_ns, pose, self.noise(), flight);
        self.start(now_ns, state, track.settling_since_ns);
        if let Some(landed) = &mut self.persistent.track {
            landed.ground = track.ground;
        }
        Outcome::Started
    }

    /// Returns the estimated noise of measured poses.
    fn noise(&self) -> PoseNoise {
        self.persistent.scatter.noise(self.pose_noise)
    }

    /// Returns the innovation of a pose with the first of these states whose gate it passes: the estimate, the estimate
    /// with a missed frame, and within a time of the last used capture those with an inflated covariance.
    fn gated(
        &self,
        estimate: &FilterState,
        turn_if_missed: f64,
        unused_ns: u64,
        residual: SVector<f64, MEASURED>,
        noise: PoseNoise,
    ) -> Option<(FilterState, Innovation)> {
        let with_missed_frame = estimate.with_attitude_deviation(turn_if_missed);
        let inflations = INFLATIONS.into_iter().filter(|_| unused_ns <= INFLATED_FOR_NS);
        [*estimate, with_missed_frame]
            .into_iter()
            .chain(inflations.map(|factor| with_missed_frame.inflated(factor)))
            .find_map(|state| {
                let innovation = state.innovation(residual, noise)?;
                (innovation.squared_distance() <= self.gate).then_some((state, innovation))
            })
    }

    /// Returns the state, predicted to the time at which a frame sent now takes effect, or without prediction at the last
    /// capture. `None` before the first capture, and when the vehicle is lost.
    #[must_use]
    pub fn estimate(&self, now_ns: u64) -> Option<Estimate> {
        let track = self.persistent.track.as_ref().filter(|_| !self.is_lost(now_ns))?;
        let (mut state, vehicle) = (track.state, &self.process.vehicle);
        if self.prediction {
            let acts_from_ns = now_ns.saturating_add(self.radio_latency_ns);
            state.propagate(acts_from_ns, &self.process, &self.persistent.history);
        }
        Some(estimate_of(&state, vehicle))
    }

    /// Returns whether a capture has been used recently enough.
    #[must_use]
    pub fn is_tracking(&self, now_ns: u64) -> bool {
        self.unseen_for_ns(now_ns)
            .is_some_and(|unseen| unseen <= self.coast_ns || self.is_levelled(now_ns))
    }

    /// Returns whether attitudes still correct a state without recent positions.
    fn is_levelled(&self, now_ns: u64) -> bool {
        self.persistent.track.as_ref().is_some_and(|track| {
            now_ns.saturating_sub(track.levelled_at_ns) <= self.coast_ns
                && now_ns.saturating_sub(track.used_at_ns) <= LEVELLED_NS
        })
    }

    /// Returns whether due captures are missing, so that the prediction is longer than usual, or whether the velocity is
    /// unknown after a restart in flight.
    #[must_use]
    pub fn is_coasting(&self, now_ns: u64) -> bool {
        let is_late = |track: &Track| {
            let has_flown = self.has_ground && track.ground.has_flown;
            let is_unsure = has_flown && track.state.velocity_deviation() > UNKNOWN_VELOCITY;
            is_unsure || now_ns.saturating_sub(track.state.time_ns) > self.oldest_ns
        };
        let is_silent = self
            .unseen_for_ns(now_ns)
            .is_some_and(|unseen| unseen > self.capture_timeout_ns);
        is_silent || self.persistent.track.as_ref().is_some_and(is_late)
    }

    /// Returns the number of captures refused since the start of the flight.
    #[must_use]
    pub fn captures_refused(&self) -> u32 {
        self.persistent.captures_refused
    }

    /// Returns the estimate at the time of the last tested capture; `None` before the first.
    #[must_use]
    pub fn state(&self) -> Option<&FilterState> {
        self.persistent.track.as_ref().map(|track| &track.state)
    }

    /// Returns whether the last used capture is too old for a state.
    fn is_lost(&self, now_ns: u64) -> bool {
        let longest = self.coast_ns.saturating_add(self.restart_after_ns);
        self.unseen_for_ns(now_ns).is_some_and(|unseen| unseen > longest) && !self.is_levelled(now_ns)
    }

    /// Returns whether the last used capture is too old for corrections by a position or an attitude alone.
    fn is_long_lost(&self, now_ns: u64) -> bool {
        self.unseen_for_ns(now_ns)
            .is_none_or(|unseen| unseen > LEVELLED_NS)
    }

    /// Returns the time since the last used capture, ns.
    fn unseen_for_ns(&self, now_ns: u64) -> Option<u64> {
        let track = self.persistent.track.as_ref()?;
        Some(now_ns.saturating_sub(track.used_at_ns))
    }

    fn start_from(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose) -> Outcome {
        let actuation = Actuation::settled(self.persistent.history.acting(exposure_ns));
        let offset = self.process.marker_offset;
        let state = if self.has_ground && self.process.vehicle.is_held(&actuation, 0.0) {
            FilterState::standing(exposure_ns, pose, self.noise(), offset, actuation)
        } else {
            FilterState::from_pose(exposure_ns, pose, self.noise(), offset, actuation)
        };
        let settling_since_ns = self.persistent.track.map(|track| track.settling_since_ns);
        self.start(now_ns, state, settling_since_ns.unwrap_or(exposure_ns))
    }

    /// Starts from a capture of a vehicle that stands on the ground.
    fn stand(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose, last: &Track) -> Outcome {
        let (offset, actuation) = (self.process.marker_offset, last.state.nominal.actuation);
        let state = FilterState::standing(exposure_ns, pose, self.noise(), offset, actuation);
        self.start(now_ns, state, last.settling_since_ns)
    }

    /// Returns whether the vehicle has landed and stopped its motors.
    fn has_landed(&self, state: &FilterState) -> bool {
        self.has_ground && self.has_stopped(state.time_ns) && state.nominal.velocity_world.norm() < STANDSTILL
    }

    /// Returns whether frames determine the vehicle's rates from one time to another.
    fn is_turn_known(&self, from_ns: u64, to_ns: u64) -> bool {
        self.persistent.turn_known_from_ns <= from_ns && self.is_turn_stated(to_ns)
    }

    /// Returns whether a recent frame determines the vehicle's rates.
    fn is_turn_stated(&self, time_ns: u64) -> bool {
        let rates_stated_ns = self.persistent.rates_stated_ns;
        rates_stated_ns.is_some_and(|at| time_ns <= at.saturating_add(TURN_KNOWN_NS))
    }

    /// Returns whether the motors have been stopped long enough for a standstill on the ground.
    fn has_stopped(&self, time_ns: u64) -> bool {
        let rests_since_ns = self.persistent.rests_since_ns;
        rests_since_ns.is_some_and(|since| time_ns >= since.saturating_add(LANDED_AFTER_NS))
    }

    fn restart(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose, last: &Track) -> Outcome {
        let (noise, history) = (self.noise(), &self.persistent.history);
        let state = last
            .state
            .restarted(exposure_ns, pose, noise, &self.process, history);
        self.start(now_ns, state, last.settling_since_ns)
    }

    fn start(&mut self, now_ns: u64, state: FilterState, settling_since_ns: u64) -> Outcome {
        self.persistent.history.drop_before(state.time_ns);
        self.persistent.scatter.innovation = SVector::zeros();
        let attitude = &state.nominal.world_from_body;
        let mut ground = Ground::new(state.time_ns, &state.nominal, state.stands);
        if let (false, Some(before)) = (state.stands, &self.persistent.track) {
            (ground.stood_z, ground.has_flown) = (before.ground.stood_z, before.ground.has_flown);
        }
        self.persistent.track = Some(Track {
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
        self.persistent.captures_refused = self.persistent.captures_refused.saturating_add(1);
        Outcome::Refused
    }
}

/// Returns the maximum thrust (N) and body rates (rad/s) of a link, with a tolerance for rounding.
fn link_limits(link: &RcLink) -> [f64; 4] {
    let [_, thrust] = link.thrust_limits();
    let [lower, upper] = link.rate_range.map(f64::abs);
    let [x, y, z] = link.rate_slope.map(|slope| slope.abs() * lower.max(upper));
    [thrust, x, y, z].map(|limit| limit * (1.0 + ROUNDING))
}

/// Returns the pose of a capture, if it is valid.
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

pub(crate) fn schedule_of(scenario: &Scenario) -> Result<Schedule, Problem> {
    scenario
        .schedule()
        .map_err(|mut problems| problems.swap_remove(0))
}

/// Returns the longest time between two used captures with one missing, ns.
fn longest_gap_ns(scenario: &Scenario, schedule: &Schedule) -> u64 {
    let captures = schedule.edge(ServiceId::Estimator, 0);
    2 * scenario.between_captures_ns(schedule) + schedule.time_ns(captures.latency)
}

/// Returns the usual age of an exposure at the arrival of its capture, ns.
fn usual_latency_ns(scenario: &Scenario, model: &Model) -> u64 {
    let assumed_ns = nanoseconds(model.capture_latency.unwrap_or(0.0));
    scenario.capture_latency_ns().max(assumed_ns)
}

/// Returns the age of the last capture at the last step before the next one arrives, ns.
fn greatest_age_ns(scenario: &Scenario, schedule: &Schedule, model: &Model) -> u64 {
    let captures = schedule.edge(ServiceId::Estimator, 0);
    let ticks = captures.latency + schedule.service_rate(ServiceId::Estimator).period;
    let arrival_ns = schedule.time_ns(ticks) + scenario.between_captures_ns(schedule);
    (arrival_ns + scenario.capture_latency_ns()).max(nanoseconds(model.capture_latency.unwrap_or(0.0)))
}
