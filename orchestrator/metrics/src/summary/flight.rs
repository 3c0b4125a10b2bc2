//! Phases of a flight from take-off to landing, with their causes.

use scenario::Scenario;
use serde::Serialize;
use shared_types::FlightPhase;
use shared_types::flight_phase::NotReady;
use shared_types::rotation::tilt;
use shared_types::samples::{PathReference, RcFrame, RunEvent, VehicleState};
use shared_types::service::seconds;

/// Words for a flight with phases that never left the ground.
pub(super) const NO_TAKE_OFF: &str = "the vehicle did not take off";

/// Words for a flight that left the ground, and landed before it had come to its path.
const NOT_ON_PATH: &str = "the vehicle did not reach its path";

/// Maximum number of stored phases and of stored requests of the operator: those of almost eight flights.
const MOST: usize = 40;

/// Time at which a phase of the flight began.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlightPhaseBegin {
    /// Its name.
    pub phase: &'static str,
    /// Time at which its first reference was published, s.
    pub begins: f64,
    /// Cause of the phase; `None` for the first one and for regular transitions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// `true` if neither the operator nor an ordinary flight began it: an unready vehicle, a limit, a lost position.
    #[serde(skip)]
    pub is_unasked: bool,
}

/// Record of the phases and the operator's requests.
#[derive(Clone, Debug, Default)]
pub(super) struct FlightWatch {
    /// The phase and its cause.
    newest: Option<(FlightPhase, u8)>,
    /// The vehicle's attitude by its newest state, row-major.
    world_from_body: [f64; 9],
    /// Maximum tilt for arming, rad.
    tilt_max: f64,
    /// `true` of a vehicle with inertial navigation.
    is_inertial: bool,
    changes: Vec<Change>,
    requests: Vec<Request>,
}

/// A change of the phase or of its cause.
#[derive(Clone, Debug)]
struct Change {
    to: FlightPhase,
    cause: u8,
    stamp_ns: u64,
    /// Angle between the vehicle's thrust axis and the vertical, rad.
    tilt: f64,
}

/// A request of the operator.
#[derive(Clone, Debug)]
struct Request {
    kind: u32,
    stamp_ns: u64,
    /// By what, in words.
    by: String,
}

impl FlightWatch {
    /// Makes the watch over a flight of a scenario.
    pub(super) fn new(scenario: &Scenario) -> Self {
        Self {
            tilt_max: scenario.flight.as_ref().map_or(0.0, |flight| flight.tilt_max),
            is_inertial: scenario.navigation.is_some(),
            ..Self::default()
        }
    }

    /// Adds a state of the vehicle.
    #[inline]
    pub(super) fn observe_state(&mut self, state: &VehicleState) {
        self.world_from_body = state.world_from_body;
    }

    /// Adds a reference.
    pub(super) fn observe(&mut self, reference: &PathReference) {
        let to = FlightPhase::from_code(reference.phase);
        let newest = Some((to, reference.cause));
        if self.newest != newest {
            // The newest one replaces the last one, so that the end of the flight is correct.
            self.changes.truncate(MOST - 1);
            self.changes.push(Change {
                to,
                cause: reference.cause,
                stamp_ns: reference.header.stamp_ns,
                tilt: tilt(&self.world_from_body),
            });
        }
        self.newest = newest;
    }

    /// Adds an event, if it is a request of the operator.
    pub(super) fn observe_event(&mut self, event: &RunEvent) {
        let is_request = matches!(
            event.kind,
            RunEvent::KIND_OPERATOR_ARMS
                | RunEvent::KIND_OPERATOR_LANDS
                | RunEvent::KIND_OPERATOR_DISARMS
                | RunEvent::KIND_OPERATOR_KILLS
        );
        if is_request && self.requests.len() < MOST {
            self.requests.push(Request {
                kind: event.kind,
                stamp_ns: event.header.stamp_ns,
                by: event.words().into_owned(),
            });
        }
    }

    /// The phases in their order.
    pub(super) fn finish(&self) -> Vec<FlightPhaseBegin> {
        let begins = self.changes.iter().map(|change| FlightPhaseBegin {
            phase: change.to.name(),
            begins: seconds(change.stamp_ns),
            reason: self.reason(change),
            is_unasked: is_unasked(change.cause),
        });
        begins.collect()
    }

    /// Says that no take-off led to the path, and why the last one did not; `None` if one did, none was ordered, or it is not known
    /// whether it had lifted the vehicle.
    pub(super) fn failed_take_off(&self) -> Option<String> {
        let flew = |change: &Change| change.to == FlightPhase::Fly;
        let last = self.changes.last()?;
        if last.to == FlightPhase::TakeOff || self.changes.iter().any(flew) {
            return None;
        }
        let ends = self.changes.windows(2);
        let mut ends =
            ends.filter(|pair| pair[0].to == FlightPhase::TakeOff && pair[1].to != FlightPhase::TakeOff);
        let has_lifted = |pair: &[Change]| {
            Some(pair[1].to == FlightPhase::Land).filter(|lands| *lands || gave_up_on_the_ground(&pair[1]))
        };
        let lifted: Option<Vec<bool>> = ends.clone().map(has_lifted).collect();
        let what = if lifted?.contains(&true) {
            NOT_ON_PATH
        } else {
            NO_TAKE_OFF
        };
        let why = self.reason(&ends.next_back()?[1])?;
        Some(format!("{what}: {why}"))
    }

    /// Returns the recorded cause of a phase. Evaluated at the end, because the requests of a tick come after its samples.
    fn reason(&self, change: &Change) -> Option<String> {
        if let Some(found) = NotReady::from_cause(change.cause) {
            let words = not_ready_in_words(found, change.tilt, self.tilt_max, self.is_inertial);
            return Some(not_ready(&words));
        }
        self.cause_in_words(change.cause, change.stamp_ns)
    }

    /// A cause in words, with the origin of the operator's request that led to it at a time.
    pub(super) fn cause_in_words(&self, cause: u8, stamp_ns: u64) -> Option<String> {
        let kind = match cause {
            PathReference::CAUSE_OPERATOR_KILLS => RunEvent::KIND_OPERATOR_KILLS,
            PathReference::CAUSE_OPERATOR_DISARMS => RunEvent::KIND_OPERATOR_DISARMS,
            PathReference::CAUSE_OPERATOR_LANDS => RunEvent::KIND_OPERATOR_LANDS,
            _ => return cause_in_words(cause),
        };
        // A request may have an effect some ticks before or after that of its event. Its cause is recorded: only its
        // origin is looked up here. After a take-over the cause at the beginning of the log has its origin before it.
        let began_before = self
            .changes
            .first()
            .is_some_and(|first| stamp_ns <= first.stamp_ns);
        let of_kind = self
            .requests
            .iter()
            .filter(|request| request.kind == kind && (!began_before || request.stamp_ns <= stamp_ns));
        let nearest = of_kind.min_by_key(|request| request.stamp_ns.abs_diff(stamp_ns));
        nearest.map_or_else(|| cause_in_words(cause), |request| Some(request.by.clone()))
    }
}

/// Returns whether a phase that follows a take-off tells that the vehicle had not lifted off: in the air it would land.
fn gave_up_on_the_ground(end: &Change) -> bool {
    let is_demand = match end.cause {
        PathReference::CAUSE_OVERDUE | PathReference::CAUSE_OPERATOR_LANDS => true,
        cause => (PathReference::CAUSE_ENVELOPE_LANDS..PathReference::CAUSE_ENVELOPE_KILLS).contains(&cause),
    };
    end.to == FlightPhase::Disarmed && is_demand
}

/// Describes a missing condition of readiness; `tilt` and `tilt_max` in rad.
#[must_use]
pub fn not_ready_in_words(found: NotReady, tilt: f64, tilt_max: f64, is_inertial: bool) -> String {
    match found {
        NotReady::Sight if is_inertial => {
            "no recent position was fused, or its sources contradict each other".to_owned()
        }
        NotReady::Sight => "the cameras did not see the vehicle".to_owned(),
        NotReady::Level => not_level_in_words(tilt, tilt_max),
        _ => found.words().to_owned(),
    }
}

/// Describes a tilt above the maximum for arming; both in rad.
#[must_use]
pub fn not_level_in_words(tilt: f64, tilt_max: f64) -> String {
    format!(
        "the vehicle is tilted by {:.1}°, `flight.tilt_max` permits {:.1}°",
        tilt.to_degrees(),
        tilt_max.to_degrees()
    )
}

fn not_ready(why: &str) -> String {
    format!("was not ready, {why}: arm again")
}

/// Returns whether a cause of [`PathReference`] is neither a request nor that of the next phase of an ordinary flight.
fn is_unasked(cause: u8) -> bool {
    !matches!(
        cause,
        PathReference::CAUSE_NONE
            | PathReference::CAUSE_OPERATOR_KILLS
            | PathReference::CAUSE_OPERATOR_DISARMS
            | PathReference::CAUSE_OPERATOR_LANDS
            | PathReference::CAUSE_TOUCHED_DOWN
    )
}

/// A cause of [`PathReference`] in words; none for the next phase of an ordinary flight.
#[must_use]
pub fn cause_in_words(cause: u8) -> Option<String> {
    if let Some(found) = NotReady::from_cause(cause) {
        return Some(not_ready(found.words()));
    }
    let words = match cause {
        PathReference::CAUSE_NONE => return None,
        PathReference::CAUSE_OPERATOR_KILLS => "the operator killed",
        PathReference::CAUSE_OPERATOR_DISARMS => "the operator disarmed",
        // Every other request to land has an event.
        PathReference::CAUSE_OPERATOR_LANDS => "no orchestrator was there",
        PathReference::CAUSE_NOT_READY => "was not ready: arm again",
        PathReference::CAUSE_OVERDUE => {
            "the take-off took too long: do the motors turn, and is the thrust right?"
        }
        PathReference::CAUSE_TOUCHED_DOWN => "touched down",
        PathReference::CAUSE_FOUND_FLYING => "found in the air",
        PathReference::CAUSE_STRAYED => "tracked again, and not where it was led",
        cause if cause >= PathReference::CAUSE_ENVELOPE_KILLS => {
            let limit = limit_in_words(cause - PathReference::CAUSE_ENVELOPE_KILLS);
            return Some(format!("killed: {limit}"));
        }
        cause if cause >= PathReference::CAUSE_ENVELOPE_LANDS => {
            return Some(limit_in_words(cause - PathReference::CAUSE_ENVELOPE_LANDS));
        }
        _ => return None,
    };
    Some(words.to_owned())
}

/// States that a limit of the envelope was exceeded, by its key.
#[must_use]
pub fn limit_in_words(limit: u8) -> String {
    let key = match limit {
        RcFrame::LIMIT_BOX => "box",
        RcFrame::LIMIT_TILT => "tilt",
        RcFrame::LIMIT_SPEED => "speed",
        RcFrame::LIMIT_ESTIMATE => "estimate",
        RcFrame::LIMIT_THRUST => "thrust",
        RcFrame::LIMIT_TORQUE => "torque",
        RcFrame::LIMIT_RATES => "rates",
        RcFrame::LIMIT_LANDING_TIME => "land_within",
        RcFrame::LIMIT_BATTERY => {
            return "the battery is below `rc_output.battery.lowest`".to_owned();
        }
        _ => return "a limit of the envelope".to_owned(),
    };
    format!("`envelope.{key}` was exceeded")
}

/// The phases in a sentence, and that the flight ended in another one than it should.
pub(super) fn in_words(begins: &[FlightPhaseBegin]) -> String {
    let parts: Vec<_> = begins
        .iter()
        .map(|begin| {
            let reason = begin.reason.iter().map(|reason| format!(" ({reason})"));
            format!(
                "{} at {} s{}",
                begin.phase,
                begin.begins,
                reason.collect::<String>()
            )
        })
        .collect();
    let last = begins.last().map(|begin| begin.phase);
    let end = match last {
        Some(last) if last != FlightPhase::Disarmed.name() => "; it ended before the vehicle was disarmed",
        _ => "",
    };
    format!("flight: {}{end}", parts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Header;
    use zerocopy::FromZeros;

    const DISARMED: FlightPhase = FlightPhase::Disarmed;
    const FLY: FlightPhase = FlightPhase::Fly;
    const LAND: FlightPhase = FlightPhase::Land;

    /// A flight that is watched, a tick after the other.
    #[derive(Default)]
    struct Watched {
        watch: FlightWatch,
        tick: u64,
    }

    impl Watched {
        fn phase(self, phase: FlightPhase) -> Self {
            self.caused(phase, PathReference::CAUSE_NONE)
        }

        fn caused(mut self, phase: FlightPhase, cause: u8) -> Self {
            self.tick += 1;
            let mut reference = PathReference::new_zeroed();
            reference.header.stamp_ns = self.tick;
            (reference.phase, reference.cause) = (phase.code(), cause);
            self.watch.observe(&reference);
            self
        }

        /// A request of the tick that is under way: it comes after the samples that it has led to.
        fn request(mut self, kind: u32, by: &str) -> Self {
            let mut event = RunEvent::new_zeroed();
            event.header = Header {
                stamp_ns: self.tick,
                ..event.header
            };
            event.kind = kind;
            event.text[..by.len()].copy_from_slice(by.as_bytes());
            event.text_length = u32::try_from(by.len()).unwrap();
            self.watch.observe_event(&event);
            self
        }

        /// Returns why the last phase began.
        fn reason(&self) -> Option<String> {
            self.watch.finish().pop()?.reason
        }
    }

    fn flying() -> Watched {
        let watched = Watched::default().phase(DISARMED);
        watched
            .phase(FlightPhase::Armed)
            .phase(FlightPhase::TakeOff)
            .phase(FLY)
    }

    #[track_caller]
    fn assert_reason(watched: &Watched, reason: &str) {
        assert_eq!(watched.reason().as_deref(), Some(reason));
    }

    #[test]
    fn a_flight_that_ends_before_the_vehicle_is_disarmed_says_so() {
        let in_the_air = flying();
        assert!(in_words(&in_the_air.watch.finish()).ends_with("it ended before the vehicle was disarmed"));
        let landed = in_the_air.phase(LAND).phase(DISARMED);
        assert!(in_words(&landed.watch.finish()).ends_with("s"));
    }

    #[test]
    fn the_last_of_many_phases_is_the_one_in_which_the_flight_ended() {
        let flights = (0..20).fold(flying(), |watched, _| {
            watched
                .phase(LAND)
                .phase(DISARMED)
                .phase(FlightPhase::Armed)
                .phase(FLY)
        });
        let begins = flights.phase(LAND).phase(DISARMED).watch.finish();
        assert_eq!((begins.len(), begins[MOST - 1].phase), (MOST, DISARMED.name()));
        assert!(!in_words(&begins).contains("it ended before"));
    }

    #[test]
    fn the_phases_of_an_ordinary_flight_have_no_reasons() {
        let begins = flying().watch.finish();
        assert!(begins.iter().all(|begin| begin.reason.is_none()), "{begins:?}");
    }

    #[test]
    fn a_flight_whose_take_off_led_nowhere_says_so() {
        let ordered = || {
            let watched = Watched::default().phase(DISARMED);
            watched.phase(FlightPhase::Armed).phase(FlightPhase::TakeOff)
        };
        let overdue = PathReference::CAUSE_OVERDUE;
        let failed = |watched: Watched| watched.watch.failed_take_off();
        let given_up = |cause| failed(ordered().caused(DISARMED, cause));
        let words = "the take-off took too long: do the motors turn, and is the thrust right?";
        assert_eq!(
            given_up(overdue).unwrap(),
            format!("the vehicle did not take off: {words}")
        );
        let limit = PathReference::CAUSE_ENVELOPE_LANDS + RcFrame::LIMIT_BOX;
        let words_of_limit = "the vehicle did not take off: `envelope.box` was exceeded";
        assert_eq!(given_up(limit).as_deref(), Some(words_of_limit));
        // A kill and a lost position may end a take-off in the air.
        for cause in [
            PathReference::CAUSE_OPERATOR_KILLS,
            PathReference::CAUSE_ENVELOPE_KILLS + RcFrame::LIMIT_TILT,
            PathReference::CAUSE_STRAYED,
        ] {
            assert_eq!(given_up(cause), None);
        }
        let in_the_air = || ordered().caused(LAND, overdue);
        let lands = format!("the vehicle did not reach its path: {words}");
        assert_eq!(failed(in_the_air()).as_ref(), Some(&lands));
        let landed = in_the_air().caused(DISARMED, PathReference::CAUSE_TOUCHED_DOWN);
        assert_eq!(failed(landed).as_ref(), Some(&lands));
        let second_flew = ordered().caused(DISARMED, overdue).phase(FlightPhase::Armed);
        let second_flew = second_flew.phase(FlightPhase::TakeOff).phase(FLY).phase(LAND);
        for flown in [
            second_flew,
            flying(),
            ordered(),
            Watched::default().phase(DISARMED),
        ] {
            assert_eq!(failed(flown), None);
        }
    }

    #[test]
    fn a_take_off_that_begins_again_has_a_reason() {
        assert_reason(
            &flying().caused(FlightPhase::TakeOff, PathReference::CAUSE_STRAYED),
            "tracked again, and not where it was led",
        );
    }

    #[test]
    fn what_was_not_ready_is_stated_and_the_tilt_with_its_limit() {
        let unseen = PathReference::CAUSE_NOT_READY_SIGHT;
        assert_reason(
            &Watched::default().phase(DISARMED).caused(DISARMED, unseen),
            "was not ready, the cameras did not see the vehicle: arm again",
        );
        let mut outdoors = Watched::default().phase(DISARMED);
        outdoors.watch.is_inertial = true;
        assert_reason(
            &outdoors.caused(DISARMED, unseen),
            "was not ready, no recent position was fused, or its sources contradict each other: arm again",
        );
        let mut lying = Watched::default().phase(DISARMED);
        lying.watch.tilt_max = 0.35;
        lying.watch.world_from_body[8] = libm::cos(62.0_f64.to_radians());
        assert_reason(
            &lying.caused(DISARMED, PathReference::CAUSE_NOT_READY_LEVEL),
            "was not ready, the vehicle is tilted by 62.0°, `flight.tilt_max` permits 20.1°: arm again",
        );
    }

    #[test]
    fn a_reason_is_the_recorded_cause_whatever_was_requested_meanwhile() {
        let asked = flying()
            .caused(LAND, PathReference::CAUSE_OPERATOR_LANDS)
            .request(RunEvent::KIND_OPERATOR_LANDS, "gerono stop");
        assert_reason(&asked, "gerono stop");
        // The kill came at the tick of the touch-down, and a tick too late.
        let landed = asked
            .request(RunEvent::KIND_OPERATOR_KILLS, "gerono kill")
            .caused(DISARMED, PathReference::CAUSE_TOUCHED_DOWN);
        assert_reason(&landed, "touched down");
        let limit = PathReference::CAUSE_ENVELOPE_LANDS + RcFrame::LIMIT_BOX;
        assert_reason(&flying().caused(LAND, limit), "`envelope.box` was exceeded");
        assert_reason(
            &flying().caused(LAND, PathReference::CAUSE_OVERDUE),
            "the take-off took too long: do the motors turn, and is the thrust right?",
        );
        assert_reason(
            &flying().caused(LAND, PathReference::CAUSE_OPERATOR_LANDS),
            "no orchestrator was there",
        );
        let limit = PathReference::CAUSE_ENVELOPE_KILLS + RcFrame::LIMIT_TILT;
        assert_reason(
            &flying().caused(DISARMED, limit),
            "killed: `envelope.tilt` was exceeded",
        );
    }

    #[test]
    fn a_request_whose_event_is_recorded_some_ticks_later_is_the_origin() {
        let killed = flying()
            .phase(LAND)
            .caused(DISARMED, PathReference::CAUSE_OPERATOR_KILLS);
        assert_reason(&killed, "the operator killed");
        let mut recorded = killed.caused(DISARMED, PathReference::CAUSE_OPERATOR_KILLS);
        recorded.tick += 22;
        let recorded = recorded.request(RunEvent::KIND_OPERATOR_KILLS, "gerono kill");
        assert_reason(&recorded, "gerono kill");
    }

    #[test]
    fn a_landing_with_which_a_log_begins_has_its_origin_before_it() {
        let taken_over = || Watched {
            tick: 1000,
            ..Watched::default()
        };
        let landing = PathReference::CAUSE_OPERATOR_LANDS;
        let mut alone = taken_over().caused(LAND, landing);
        alone.tick += 1;
        let alone = alone.request(RunEvent::KIND_OPERATOR_LANDS, "gerono stop");
        assert_reason(&alone, "no orchestrator was there");
        let inherited = taken_over().request(RunEvent::KIND_OPERATOR_LANDS, "asked before");
        assert_reason(&inherited.caused(LAND, landing), "asked before");
    }

    #[test]
    fn the_nearest_request_of_its_kind_is_the_origin() {
        let mut first = flying()
            .request(RunEvent::KIND_OPERATOR_DISARMS, "the first")
            .caused(DISARMED, PathReference::CAUSE_OPERATOR_DISARMS)
            .phase(FlightPhase::Armed);
        first.tick += 100;
        let second = first
            .request(RunEvent::KIND_OPERATOR_DISARMS, "the second")
            .caused(DISARMED, PathReference::CAUSE_OPERATOR_DISARMS);
        let reasons: Vec<_> = second
            .watch
            .finish()
            .into_iter()
            .filter_map(|begin| begin.reason)
            .collect();
        assert_eq!(reasons, ["the first", "the second"]);
    }

    #[test]
    fn a_request_to_arm_that_has_lapsed_is_stated() {
        let lapsed = Watched::default()
            .phase(DISARMED)
            .caused(DISARMED, PathReference::CAUSE_NOT_READY);
        assert_eq!(
            in_words(&lapsed.watch.finish()),
            "flight: disarmed at 0.000000001 s, disarmed at 0.000000002 s (was not ready: arm again)"
        );
    }
}
