//! The phases of a flight from take-off to landing, and why it was landed and disarmed.

use serde::Serialize;
use shared_types::FlightPhase;
use shared_types::samples::{PathReference, RcFrame, RunEvent};
use shared_types::service::seconds;

/// Most begins of phases, and most requests of the operator, that are kept: eight flights with all of them.
const MOST: usize = 40;

/// Time at which a phase of the flight began.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlightPhaseBegin {
    /// Its name.
    pub phase: &'static str,
    /// Time at which its first reference was published, s.
    pub begins: f64,
    /// Reason why the vehicle was landed or disarmed; none of other phases, and of the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// Watches the phases.
#[derive(Clone, Debug, Default)]
pub(super) struct FlightWatch {
    phase: Option<FlightPhase>,
    changes: Vec<Change>,
    requests: Vec<Request>,
    /// Action of the newest frame, and the limit of the envelope that it is taken for.
    action: u8,
    limit: u8,
}

/// A change of the phase, and what the radio link did then.
#[derive(Clone, Debug)]
struct Change {
    from: Option<FlightPhase>,
    to: FlightPhase,
    stamp_ns: u64,
    action: u8,
    limit: u8,
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
    /// Takes a reference into account.
    pub(super) fn observe(&mut self, reference: &PathReference) {
        let to = FlightPhase::from_code(reference.phase);
        if self.phase != Some(to) && self.changes.len() < MOST {
            self.changes.push(Change {
                from: self.phase,
                to,
                stamp_ns: reference.header.stamp_ns,
                action: self.action,
                limit: self.limit,
            });
        }
        self.phase = Some(to);
    }

    /// Takes a frame into account.
    pub(super) fn observe_frame(&mut self, frame: &RcFrame) {
        (self.action, self.limit) = (frame.action, frame.limit);
    }

    /// Takes an event into account, if it is a request of the operator.
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
        });
        begins.collect()
    }

    /// Returns why the vehicle was landed or disarmed. Requests are looked at only now: those of a tick come after its samples.
    fn reason(&self, change: &Change) -> Option<String> {
        let from = change.from?;
        match change.to {
            FlightPhase::Land => Some(self.reason_to_land(change)),
            FlightPhase::Disarmed => Some(self.reason_to_disarm(from, change)),
            _ => None,
        }
    }

    fn reason_to_land(&self, change: &Change) -> String {
        if change.action == RcFrame::ACTION_LAND {
            return limit_in_words(change.limit);
        }
        match self.request_before(change, &[RunEvent::KIND_OPERATOR_LANDS]) {
            Some(request) => request.by.clone(),
            None => "the take-off took too long".to_owned(),
        }
    }

    fn reason_to_disarm(&self, from: FlightPhase, change: &Change) -> String {
        if change.action == RcFrame::ACTION_KILL && change.limit != RcFrame::LIMIT_NONE {
            return format!("killed: {}", limit_in_words(change.limit));
        }
        let stops = [RunEvent::KIND_OPERATOR_DISARMS, RunEvent::KIND_OPERATOR_KILLS];
        if let Some(request) = self.request_before(change, &stops) {
            return request.by.clone();
        }
        if change.action == RcFrame::ACTION_KILL {
            return "the operator killed".to_owned();
        }
        let reason = match from {
            FlightPhase::Land => "touched down",
            FlightPhase::TakeOff => "not lifted off",
            _ => "not ready, or to land",
        };
        reason.to_owned()
    }

    /// The last request of some kinds up to a change, since the operator last armed.
    fn request_before(&self, change: &Change, kinds: &[u32]) -> Option<&Request> {
        let before = self.requests.iter().rev();
        let mut since_armed = before
            .skip_while(|request| request.stamp_ns > change.stamp_ns)
            .take_while(|request| request.kind != RunEvent::KIND_OPERATOR_ARMS);
        since_armed.find(|request| kinds.contains(&request.kind))
    }
}

/// A limit of the envelope by its key.
fn limit_in_words(limit: u8) -> String {
    let key = match limit {
        RcFrame::LIMIT_BOX => "box",
        RcFrame::LIMIT_TILT => "tilt",
        RcFrame::LIMIT_SPEED => "speed",
        RcFrame::LIMIT_ESTIMATE => "estimate",
        RcFrame::LIMIT_THRUST => "thrust",
        RcFrame::LIMIT_TORQUE => "torque",
        RcFrame::LIMIT_RATES => "rates",
        RcFrame::LIMIT_LANDING_TIME => "land_within",
        _ => return "a limit of the envelope".to_owned(),
    };
    format!("`envelope.{key}` was exceeded")
}

/// The phases in a sentence.
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
    format!("flight: {}", parts.join(", "))
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
        fn phase(mut self, phase: FlightPhase) -> Self {
            self.tick += 1;
            let mut reference = PathReference::new_zeroed();
            reference.header.stamp_ns = self.tick;
            reference.phase = phase.code();
            self.watch.observe(&reference);
            self
        }

        fn frame(mut self, action: u8, limit: u8) -> Self {
            let mut frame = RcFrame::new_zeroed();
            (frame.action, frame.limit) = (action, limit);
            self.watch.observe_frame(&frame);
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
    fn only_landing_and_disarming_have_reasons() {
        let begins = flying().watch.finish();
        assert!(begins.iter().all(|begin| begin.reason.is_none()), "{begins:?}");
    }

    #[test]
    fn a_landing_is_told_with_who_asked_for_it_and_ends_on_the_ground() {
        let asked = flying()
            .phase(LAND)
            .request(RunEvent::KIND_OPERATOR_LANDS, "gerono stop");
        assert_reason(&asked, "gerono stop");
        assert_reason(&asked.phase(DISARMED), "touched down");
        let demanded = flying()
            .frame(RcFrame::ACTION_LAND, RcFrame::LIMIT_BOX)
            .phase(LAND);
        assert_reason(&demanded, "`envelope.box` was exceeded");
        let overdue = Watched::default().phase(FlightPhase::TakeOff).phase(LAND);
        assert_reason(&overdue, "the take-off took too long");
    }

    #[test]
    fn a_kill_is_told_with_its_limit_or_the_operator() {
        let limit = flying()
            .frame(RcFrame::ACTION_KILL, RcFrame::LIMIT_TILT)
            .phase(DISARMED);
        assert_reason(&limit, "killed: `envelope.tilt` was exceeded");
        let silent = flying()
            .frame(RcFrame::ACTION_KILL, RcFrame::LIMIT_NONE)
            .phase(DISARMED);
        assert_reason(&silent, "the operator killed");
        assert_reason(
            &silent.request(RunEvent::KIND_OPERATOR_KILLS, "gerono kill"),
            "gerono kill",
        );
    }

    #[test]
    fn what_the_operator_asked_for_before_the_last_arming_or_later_is_no_reason() {
        let earlier = flying()
            .request(RunEvent::KIND_OPERATOR_DISARMS, "gerono disarm")
            .phase(DISARMED);
        assert_reason(&earlier, "gerono disarm");
        let again = earlier
            .request(RunEvent::KIND_OPERATOR_ARMS, "gerono arm")
            .phase(FlightPhase::Armed);
        let again = again.phase(FLY).phase(LAND).phase(DISARMED);
        let mut later = again.phase(DISARMED);
        later.tick += 1;
        assert_reason(
            &later.request(RunEvent::KIND_OPERATOR_DISARMS, "gerono disarm"),
            "touched down",
        );
    }
}
