//! Loss of the vehicle: the same rules for every flight, host and controller.
//!
//! A vehicle is lost if it is too far from its path, tips over, touches the ground in flight or too hard, or if its motors
//! are stopped in the air. The first event counts, and a later recovery does not change it. The limits are the scenario's
//! `[judge]`; docs/losses.md states when they apply.

use std::fmt::{Display, Formatter, Result};

use scenario::{Judge, Scenario, Vector};
use serde::Serialize;
use shared_types::FlightPhase;
use shared_types::flight_phase::GROUNDED_AFTER;
use shared_types::rotation::tilt;
use shared_types::samples::{PathReference, RcFrame, RunEvent};
use shared_types::service::{nanoseconds, seconds};

use super::tracker::{Moment, StateSource, Vehicle};

/// Minimum height before a touch counts, m: rounding and a bounce at lift-off do not count.
const LIFTED: f64 = 0.05;

/// Share of `judge.distance_max` within which a vehicle that started farther away has arrived. Below 1, so that an
/// oscillation during the approach is no loss.
const ARRIVED: f64 = 0.5;

/// Share of `judge.distance_max` within which an upright vehicle has settled: from then on tipping over is a loss.
const NEAR: f64 = 0.1;

/// Age of a reference above which it is not followed, s.
const LED: f64 = 1.0;

/// Time without a radio link before a touch-down, s, after which no command brought it about. A restarted process opens it sooner.
const UNCOMMANDED: f64 = 0.3;

/// Height of a vehicle that touches the ground, m.
const TOUCHES: f64 = 1e-6;

/// Reason why a vehicle is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Too far from the path.
    LeftPath,
    /// Too large an angle between thrust and vertical.
    TippedOver,
    /// Contact with the ground in flight, or too hard.
    HitGround,
    /// Motors stopped in the air: by a kill, by disarming, or without a command.
    MotorsStopped,
    /// In the air without a radio link: the receiver's failsafe stops the motors, and no command reaches them.
    LinkLost,
    /// Motors stopped after the position had been unknown for a time in which the vehicle may have landed.
    Unseen,
    /// A number that is not finite, in the position or computed by a service.
    NotFinite,
}

/// The loss of a vehicle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// Why.
    pub reason: Reason,
    /// When, s since the start of the flight.
    pub time: f64,
    /// Distance from the path, m; angle to the vertical, rad; speed at the contact, m/s. `None` for numbers that are not
    /// finite.
    pub value: Option<f64>,
    /// Exceeded limit, in the same unit; `None` if every value is a loss.
    pub limit: Option<f64>,
    /// Cause of a stop of the motors, as in [`PathReference`].
    #[serde(skip)]
    pub stopped_by: u8,
    /// That cause in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// The source of the vehicle's position.
    pub source: StateSource,
}

/// Detector of the loss of the vehicle.
#[derive(Clone, Debug)]
pub struct LossWatch {
    limits: Judge,
    /// Cosine of the maximum tilt.
    least_upright: f64,
    source: StateSource,
    ground: Option<Ground>,
    has_phases: bool,
    /// `true` for a real vehicle with phases: the end of the flight stops its motors.
    must_land: bool,
    /// First known distance from the path, m.
    distance_at_start: Option<f64>,
    has_arrived: bool,
    /// `true` after the vehicle was upright and near its path. Valid flights that start far away or upside down tip over
    /// during the approach.
    has_settled: bool,
    /// `true` after the first reference.
    has_begun: bool,
    /// `true` if the newest reference states that the vehicle is airborne.
    is_airborne: bool,
    /// Phase by the newest reference.
    phase: FlightPhase,
    /// Time since which the position is unknown, ns.
    unknown_since_ns: Option<u64>,
    /// Time of the newest reference, ns.
    referred_at_ns: u64,
    /// Time since which all frames have stopped the motors, ns, and the reason of the loss if this continues.
    stopped_since: Option<(u64, Reason)>,
    /// Time since which the radio link is lost, ns.
    link_lost_since_ns: Option<u64>,
    loss: Option<Loss>,
}

/// The ground of a flight with phases.
#[derive(Clone, Debug)]
struct Ground {
    /// z of the standing vehicle in {I}, m.
    height: f64,
    /// Maximum speed of a contact, m/s.
    speed_max: f64,
    has_lifted: bool,
    /// Downward speed at the previous moment, m/s.
    sinking: f64,
}

impl LossWatch {
    /// Makes the detector of a flight of `scenario`, with the vehicle's position from `source`.
    #[must_use]
    pub fn new(scenario: &Scenario, source: StateSource) -> Self {
        let limits = scenario.limits_of_loss();
        let ground = scenario.flight.as_ref().map(|flight| Ground {
            height: scenario.vehicle.initial.position[2],
            speed_max: limits.impact_speed_max(flight),
            has_lifted: false,
            sinking: 0.0,
        });
        Self {
            limits,
            least_upright: libm::cos(limits.tilt_max),
            source,
            // In a laboratory the errors of the estimate are larger than the height of a contact.
            ground: ground.filter(|_| source == StateSource::Truth),
            has_phases: scenario.flight.is_some(),
            must_land: source == StateSource::Estimate
                && scenario.flight.is_some()
                && scenario.recorded_captures().is_none(),
            distance_at_start: None,
            has_arrived: false,
            has_settled: false,
            has_begun: false,
            is_airborne: false,
            phase: FlightPhase::Disarmed,
            unknown_since_ns: None,
            referred_at_ns: 0,
            stopped_since: None,
            link_lost_since_ns: None,
            loss: None,
        }
    }

    /// Returns the loss, if the vehicle was lost.
    #[must_use]
    pub fn loss(&self) -> Option<&Loss> {
        self.loss.as_ref()
    }

    /// Returns whether the newest reference states that the vehicle is disarmed, in a flight with phases.
    #[must_use]
    pub fn stands_disarmed(&self) -> bool {
        self.has_phases && self.has_begun && self.phase == FlightPhase::Disarmed
    }

    /// Returns the loss by the end of the flight at this time, ns, which stops the motors of an airborne vehicle.
    #[must_use]
    pub fn loss_at_the_end(&self, time_ns: u64) -> Option<Loss> {
        let is_stopped = self.loss.is_none() && self.must_land && self.is_in_the_air();
        if let Some(since_ns) = self.link_lost_since_ns.filter(|_| is_stopped) {
            return Some(Loss::new(Reason::LinkLost, seconds(since_ns), self.source));
        }
        is_stopped.then(|| Loss {
            cause: Some("the flight ended".to_owned()),
            ..Loss::new(self.reason_of_stop(time_ns), seconds(time_ns), self.source)
        })
    }

    /// Adds a moment; call in the order of time.
    #[inline]
    pub fn observe(&mut self, moment: &Moment) {
        let found = self
            .not_finite(&moment.vehicle)
            .or(self.left_path(moment))
            .or(self.tipped_over(moment))
            .or(self.hit_ground(moment));
        if let (None, Some((reason, value, limit))) = (&self.loss, found) {
            self.loss = Some(Loss {
                value,
                limit,
                ..Loss::new(reason, seconds(moment.vehicle.time_ns), self.source)
            });
        }
    }

    /// Adds an event of the run, which states whether the radio link is lost.
    pub fn observe_event(&mut self, event: &RunEvent) {
        match event.kind {
            RunEvent::KIND_LINK_LOST => {
                self.link_lost_since_ns.get_or_insert(event.header.stamp_ns);
            }
            RunEvent::KIND_LINK_FOUND => self.link_lost_since_ns = None,
            _ => {}
        }
    }

    /// Adds a reference, which states whether the vehicle is airborne and why it was disarmed.
    #[inline]
    pub fn observe_reference(&mut self, reference: &PathReference) {
        let was_airborne = self.is_in_the_air();
        self.referred_at_ns = reference.header.stamp_ns;
        let phase = FlightPhase::from_code(reference.phase);
        let before = std::mem::replace(&mut self.phase, phase);
        self.is_airborne = reference.airborne.is_set();
        if !std::mem::replace(&mut self.has_begun, true)
            && let Some(ground) = &mut self.ground
        {
            // After a take-over the log may begin in the air, just above the ground.
            ground.has_lifted |= self.is_airborne && reference.header.tick > 0;
        }
        self.unknown_since_ns = if reference.vehicle_known.is_set() {
            None
        } else {
            self.unknown_since_ns.or(Some(reference.header.stamp_ns))
        };
        let stops = match reference.cause {
            PathReference::CAUSE_OPERATOR_KILLS | PathReference::CAUSE_OPERATOR_DISARMS => true,
            cause => cause >= PathReference::CAUSE_ENVELOPE_KILLS,
        };
        let stamp_ns = reference.header.stamp_ns;
        // Whatever brought it to the ground, it was no command.
        if let Some(since_ns) = self.link_lost_since_ns
            && was_airborne
            && stamp_ns.saturating_sub(since_ns)
                >= nanoseconds(if self.is_in_the_air() {
                    GROUNDED_AFTER
                } else {
                    UNCOMMANDED
                })
        {
            self.motors_stopped(Reason::LinkLost, since_ns, PathReference::CAUSE_NONE);
        }
        // Found on the ground: how the vehicle came down is unknown.
        if self.must_land
            && matches!(before, FlightPhase::TakeOff | FlightPhase::Fly)
            && (phase, reference.cause) == (FlightPhase::Disarmed, PathReference::CAUSE_TOUCHED_DOWN)
        {
            self.motors_stopped(Reason::Unseen, stamp_ns, reference.cause);
        }
        if was_airborne && stops && phase == FlightPhase::Disarmed {
            self.motors_stopped(self.reason_of_stop(stamp_ns), stamp_ns, reference.cause);
        }
    }

    /// Adds a frame: a kill stops the motors until the end of the run, and other failsafe frames count after the time in
    /// which the vehicle must have fallen to the ground.
    #[inline]
    pub fn observe_frame(&mut self, frame: &RcFrame) {
        if !frame.failsafe.is_set() || !self.is_in_the_air() {
            self.stopped_since = None;
            return;
        }
        let now_ns = frame.header.stamp_ns;
        let stop = self.stopped_since;
        let (since_ns, reason) = stop.unwrap_or_else(|| (now_ns, self.reason_of_stop(now_ns)));
        self.stopped_since = Some((since_ns, reason));
        if frame.action == RcFrame::ACTION_KILL {
            let by = match frame.limit {
                RcFrame::LIMIT_NONE => PathReference::CAUSE_OPERATOR_KILLS,
                limit => PathReference::CAUSE_ENVELOPE_KILLS | (limit % 16),
            };
            self.motors_stopped(reason, now_ns, by);
        } else if now_ns.saturating_sub(since_ns) >= nanoseconds(GROUNDED_AFTER) {
            self.motors_stopped(reason, since_ns, PathReference::CAUSE_NONE);
        }
    }

    /// Returns whether the vehicle is in the air: by its reference, and not on a ground of known height. Without tracking the
    /// path generator cannot detect a landing.
    fn is_in_the_air(&self) -> bool {
        self.is_airborne && self.ground.as_ref().is_none_or(|ground| ground.has_lifted)
    }

    /// Returns the reason of a loss by a stop of the motors at a time: after a long time without a position the vehicle may
    /// have landed.
    fn reason_of_stop(&self, stamp_ns: u64) -> Reason {
        // Without a path generator the newest reference is the last information.
        let known_until_ns = self.unknown_since_ns.unwrap_or(self.referred_at_ns);
        let unknown_for_ns = stamp_ns.saturating_sub(known_until_ns);
        if self.source == StateSource::Estimate && unknown_for_ns >= nanoseconds(GROUNDED_AFTER) {
            Reason::Unseen
        } else {
            Reason::MotorsStopped
        }
    }

    fn motors_stopped(&mut self, reason: Reason, stamp_ns: u64, stopped_by: u8) {
        let source = self.source;
        self.loss.get_or_insert_with(|| Loss {
            stopped_by,
            ..Loss::new(reason, seconds(stamp_ns), source)
        });
    }

    #[inline]
    fn not_finite(&self, vehicle: &Vehicle) -> Option<Finding> {
        let is_finite = vehicle.position_world.iter().all(|number| number.is_finite())
            && vehicle.world_from_body[8].is_finite();
        (!is_finite).then_some((Reason::NotFinite, None, None))
    }

    #[inline]
    fn left_path(&mut self, moment: &Moment) -> Option<Finding> {
        let distance = moment.distance?;
        let start = *self.distance_at_start.get_or_insert(distance);
        let stated = self.limits.distance_max;
        self.has_arrived |= distance <= ARRIVED * stated;
        let limit = if self.has_arrived {
            stated
        } else {
            stated.max(2.0 * start)
        };
        (distance > limit).then_some((Reason::LeftPath, Some(distance), Some(limit)))
    }

    #[inline]
    fn tipped_over(&mut self, moment: &Moment) -> Option<Finding> {
        // R33: cosine of the angle between the body's axis and the vertical.
        let upright = moment.vehicle.world_from_body[8].clamp(-1.0, 1.0);
        let is_upright = upright >= self.least_upright;
        let near = NEAR * self.limits.distance_max;
        self.has_settled |= is_upright && moment.distance.is_some_and(|distance| distance <= near);
        let has_tipped = self.has_settled && !is_upright;
        has_tipped.then(|| {
            let tilt = tilt(&moment.vehicle.world_from_body);
            (Reason::TippedOver, Some(tilt), Some(self.limits.tilt_max))
        })
    }

    #[inline]
    fn hit_ground(&mut self, moment: &Moment) -> Option<Finding> {
        let ground = self.ground.as_mut()?;
        let height = ground.height - moment.vehicle.position_world[2];
        let sinking = std::mem::replace(&mut ground.sinking, speed_downwards(&moment.vehicle));
        let is_led = moment.vehicle.time_ns.saturating_sub(self.referred_at_ns) < nanoseconds(LED);
        ground.has_lifted |= height > LIFTED;
        if height > TOUCHES || !std::mem::replace(&mut ground.has_lifted, false) {
            return None;
        }
        // Without tracking the failsafe stages land the vehicle in any phase, and without a path generator the controller
        // does.
        if self.unknown_since_ns.is_none()
            && is_led
            && moment.path.is_some_and(|path| path.phase == FlightPhase::Fly)
        {
            return Some((Reason::HitGround, Some(sinking), None));
        }
        let limit = ground.speed_max;
        (sinking > limit).then_some((Reason::HitGround, Some(sinking), Some(limit)))
    }
}

impl Loss {
    /// Makes the loss by a number that is not finite, computed by a service at this time, s.
    #[must_use]
    pub fn not_finite(time: f64, source: StateSource) -> Self {
        Self::new(Reason::NotFinite, time, source)
    }

    /// Makes a loss at this time, s, without a value or a cause.
    fn new(reason: Reason, time: f64, source: StateSource) -> Self {
        Self {
            reason,
            time,
            value: None,
            limit: None,
            stopped_by: PathReference::CAUSE_NONE,
            cause: None,
            source,
        }
    }

    fn stop_in_words(&self) -> &str {
        self.cause.as_deref().unwrap_or("failsafe frames for 2 s")
    }
}

/// Reason, value and limit.
type Finding = (Reason, Option<f64>, Option<f64>);

fn speed_downwards(vehicle: &Vehicle) -> f64 {
    let r: [f64; 9] = vehicle.world_from_body;
    let [x, y, z]: Vector = vehicle.velocity_body;
    r[6] * x + r[7] * y + r[8] * z
}

impl Display for Loss {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let value = self.value.unwrap_or(f64::NAN);
        let estimated = match self.source {
            StateSource::Truth => "",
            StateSource::Estimate => ", as estimated",
        };
        match (self.reason, self.limit) {
            (Reason::LeftPath, limit) => {
                let limit = limit.unwrap_or(f64::NAN);
                write!(
                    formatter,
                    "{value:.2} m from the path, more than {limit:.2} m{estimated}"
                )
            }
            (Reason::TippedOver, limit) => {
                let [tilt, limit] = [value, limit.unwrap_or(f64::NAN)].map(f64::to_degrees);
                write!(
                    formatter,
                    "tipped over by {tilt:.0}°, more than {limit:.0}°{estimated}"
                )
            }
            (Reason::HitGround, Some(limit)) => {
                write!(
                    formatter,
                    "hit the ground at {value:.2} m/s, faster than {limit:.2} m/s"
                )
            }
            (Reason::HitGround, None) => {
                write!(formatter, "touched the ground in flight, at {value:.2} m/s")
            }
            (Reason::MotorsStopped, _) => {
                write!(
                    formatter,
                    "the motors were stopped in the air: {}",
                    self.stop_in_words()
                )
            }
            (Reason::Unseen, _) if self.stopped_by == PathReference::CAUSE_TOUCHED_DOWN => {
                write!(formatter, "it came down unseen, without a landing")
            }
            (Reason::Unseen, _) => {
                write!(
                    formatter,
                    "the motors were stopped while the cameras did not show whether the vehicle was down: {}",
                    self.stop_in_words()
                )
            }
            (Reason::LinkLost, _) => {
                write!(
                    formatter,
                    "the radio link was lost in the air: no command reached the vehicle"
                )
            }
            (Reason::NotFinite, _) => write!(formatter, "a number was not finite"),
        }
    }
}

#[cfg(test)]
mod tests;
