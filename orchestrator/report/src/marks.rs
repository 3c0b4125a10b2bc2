//! Events over time: those planned by the scenario, and changes of the services found in the samples.

use scenario::Scenario;
use serde::Serialize;
use shared_types::samples::{ControlAdaptation, PathReference, RcFrame, RunEvent};
use shared_types::service::{header_of, seconds};
use shared_types::{FlightPhase, Topic};

use metrics::read;
use metrics::summary::cause_in_words;
use metrics::summary::faults::ReceiverFault;

/// Maximum number of marks of a flight: more cannot be distinguished in a plot.
const MAX_MARKS: usize = 300;

/// Time by which the event of a request may be recorded after the landing that it begins, or before the phase before it, s.
const AROUND_PHASE: f64 = 0.1;

/// An event at a point in time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Mark {
    /// Time of the event, s.
    pub time: f64,
    /// Origin of the event.
    pub kind: MarkKind,
    /// Description of the event.
    pub text: String,
}

/// The source of a mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MarkKind {
    /// Planned by the scenario.
    Event,
    /// A planned fault begins or ends.
    Fault,
    /// A phase of the flight begins.
    Phase,
    /// A service entered or left a failsafe state.
    Safety,
}

/// A planned event with a duration: a fault, an occlusion or a marker swap.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Span {
    /// Start, s.
    from: f64,
    /// End, s; the end of the flight if `None`.
    to: Option<f64>,
    /// Description of the event.
    text: String,
}

/// Returns the planned events of a scenario that have a duration.
pub fn spans(scenario: &Scenario) -> Vec<Span> {
    let span = |from: f64, lasts: Option<f64>, text: String| Span {
        from,
        to: lasts.map(|lasts| from + lasts),
        text,
    };
    let faults = scenario.fault.iter();
    let faults = faults.map(|fault| span(fault.at, fault.lasts, fault.to_string()));
    let of_receiver = ReceiverFault::all(scenario).into_iter().map(|fault| Span {
        from: fault.at,
        to: fault.until,
        text: fault.words,
    });
    let cameras = scenario.cameras.iter();
    let vision_faults = cameras.flat_map(|cameras| {
        let hidden = cameras
            .occlusion
            .iter()
            .map(|hidden| (hidden.at, hidden.lasts, "the vehicle is hidden from the cameras"));
        let swapped = cameras
            .marker_swap
            .iter()
            .map(|swap| (swap.at, swap.lasts, "the cameras confuse markers"));
        hidden.chain(swapped)
    });
    faults
        .chain(of_receiver)
        .chain(vision_faults.map(|(from, lasts, text)| span(from, Some(lasts), text.to_owned())))
        .collect()
}

/// Returns the planned instantaneous events that no `run/event` reports.
fn unpublished_events(scenario: &Scenario) -> impl Iterator<Item = Mark> {
    let fan = scenario.vehicle.fan.iter().flat_map(|fan| {
        let on = std::iter::once((fan.on_at, "the fan is switched on".to_owned()));
        let off = fan.off_at.map(|at| (at, "the fan is switched off".to_owned()));
        let moves = fan.moves.iter().map(|to| {
            let [x, y, z] = to.position;
            (to.at, format!("the fan is at [{x}, {y}, {z}] m"))
        });
        on.chain(off).chain(moves)
    });
    let steps = scenario.path.yaw_step.iter();
    let steps = steps.map(|step| (step.at, format!("ψd steps to {} rad", step.yaw)));
    fan.chain(steps).map(|(time, text)| Mark {
        time,
        kind: MarkKind::Event,
        text,
    })
}

/// Collects the marks of a flight.
#[derive(Clone, Default)]
pub struct Marks {
    marks: Vec<Mark>,
    phase: Option<(FlightPhase, u8)>,
    /// Time at which that phase began, s.
    phase_since: f64,
    stage: Option<u8>,
    link: Option<Link>,
    /// Landings on request: indices of their marks, with the time since which the request may have been made, s.
    landings: Vec<(usize, f64)>,
    /// Times of the requests to land, s.
    requests: Vec<f64>,
}

/// State of the radio link.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Link {
    failsafe: bool,
    action: u8,
}

impl Marks {
    /// Records the change that a sample reports, if any.
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        let found = match topic {
            Topic::RunEvent => self.event(&read(bytes)),
            Topic::PathReference => self.phase_begins(&read(bytes)),
            Topic::ControlAdaptation => self.stage_changes(&read(bytes)),
            Topic::RcFrame => self.link_changes(&read(bytes)),
            _ => None,
        };
        if let Some((kind, text)) = found
            && self.marks.len() < MAX_MARKS
        {
            let time = seconds(header_of(bytes).stamp_ns);
            self.marks.push(Mark { time, kind, text });
        }
    }

    /// Returns all marks in the order of time, with the events up to the time `flown` that only the scenario states.
    pub fn finish(self, scenario: &Scenario, flown: f64) -> Vec<Mark> {
        let mut marks = self.marks;
        for (index, since) in self.landings {
            let Mark { time, text, .. } = &mut marks[index];
            // The request of an earlier landing is not that of this one.
            let asked = since - AROUND_PHASE..=*time + AROUND_PHASE;
            let is_requested = self.requests.iter().any(|at| asked.contains(at));
            let cause = cause_in_words(PathReference::CAUSE_OPERATOR_LANDS);
            if let Some(cause) = cause.filter(|_| !is_requested) {
                *text = format!("{text} ({cause})");
            }
        }
        marks.extend(unpublished_events(scenario).filter(|mark| mark.time <= flown));
        marks.sort_by(|left, right| left.time.total_cmp(&right.time));
        marks
    }

    fn event(&mut self, event: &RunEvent) -> Option<(MarkKind, String)> {
        if event.kind == RunEvent::KIND_OPERATOR_LANDS && self.requests.len() < MAX_MARKS {
            self.requests.push(seconds(event.header.stamp_ns));
        }
        planned(event)
    }

    /// Returns the mark of a change of phase. A flight without phases has none.
    fn phase_begins(&mut self, reference: &PathReference) -> Option<(MarkKind, String)> {
        let phase = FlightPhase::from_code(reference.phase);
        let now = (phase, reference.cause);
        let time = seconds(reference.header.stamp_ns);
        let before = self.phase.replace(now);
        if before == Some(now) {
            return None;
        }
        let since = std::mem::replace(&mut self.phase_since, time);
        before.is_some().then(|| {
            let is_on_request = reference.cause == PathReference::CAUSE_OPERATOR_LANDS;
            if is_on_request && self.marks.len() < MAX_MARKS {
                // Its request, or that there was none, is known later.
                self.landings.push((self.marks.len(), since));
            }
            let cause = cause_in_words(reference.cause).filter(|_| !is_on_request);
            let cause = cause.map_or_else(String::new, |cause| format!(" ({cause})"));
            (MarkKind::Phase, format!("phase: {}{cause}", phase.name()))
        })
    }

    fn stage_changes(&mut self, adaptation: &ControlAdaptation) -> Option<(MarkKind, String)> {
        let before = self.stage.replace(adaptation.stage)?;
        let what = match adaptation.stage {
            ControlAdaptation::STAGE_LAW => "follows its law again",
            ControlAdaptation::STAGE_HOLD => "holds its last command",
            ControlAdaptation::STAGE_LEVEL => "levels the vehicle",
            ControlAdaptation::STAGE_DESCEND => "lets the vehicle descend",
            _ => "requests the failsafe",
        };
        (before != adaptation.stage).then(|| (MarkKind::Safety, format!("the controller {what}")))
    }

    fn link_changes(&mut self, frame: &RcFrame) -> Option<(MarkKind, String)> {
        let link = Link {
            failsafe: frame.failsafe.is_set(),
            action: frame.action,
        };
        let before = self.link.replace(link)?;
        let what = if link.failsafe != before.failsafe {
            if link.failsafe {
                "stops the motors"
            } else {
                "sends commands again"
            }
        } else if link.action != before.action {
            match link.action {
                RcFrame::ACTION_NONE => "reports the vehicle inside its envelope again",
                RcFrame::ACTION_WARN => "warns of a limit of the envelope",
                RcFrame::ACTION_LAND => "commands a landing",
                _ => "stops the motors until the end of the run",
            }
        } else {
            return None;
        };
        Some((MarkKind::Safety, format!("the transmitter {what}")))
    }
}

/// Describes a planned event. The start and end of a flight are not marked: the time axis shows them.
fn planned(event: &RunEvent) -> Option<(MarkKind, String)> {
    let kind = match event.kind {
        RunEvent::KIND_FLIGHT_STARTS | RunEvent::KIND_FLIGHT_ENDS => return None,
        RunEvent::KIND_OUTAGE_BEGINS
        | RunEvent::KIND_OUTAGE_ENDS
        | RunEvent::KIND_EDGE_FAULT_BEGINS
        | RunEvent::KIND_EDGE_FAULT_ENDS
        | RunEvent::KIND_RECEIVER_FAULT_BEGINS
        | RunEvent::KIND_RECEIVER_FAULT_ENDS => MarkKind::Fault,
        _ => MarkKind::Event,
    };
    Some((kind, event.words().into_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario;
    use scenario::{Occlusion, Spoofing, YawStep};
    use zerocopy::{FromZeros, IntoBytes};

    fn event(kind: u32, text: &str) -> RunEvent {
        let mut event = RunEvent::new_zeroed();
        event.kind = kind;
        event.header.stamp_ns = 2_500_000_000;
        event.text[..text.len()].copy_from_slice(text.as_bytes());
        event.text_length = text.len() as u32;
        event
    }

    #[test]
    fn what_is_planned_is_told_in_its_own_words() {
        let mut marks = Marks::default();
        marks.observe(
            Topic::RunEvent,
            event(RunEvent::KIND_FLIGHT_STARTS, "starts").as_bytes(),
        );
        marks.observe(
            Topic::RunEvent,
            event(RunEvent::KIND_VEHICLE_CHANGES, "heavier").as_bytes(),
        );
        let expected = Mark {
            time: 2.5,
            kind: MarkKind::Event,
            text: "heavier".to_owned(),
        };
        assert_eq!(marks.finish(&scenario(0.01, 5.0), 5.0), [expected]);
    }

    #[test]
    fn what_no_sample_tells_is_marked_as_far_as_it_was_flown() {
        let mut scenario = scenario(0.01, 5.0);
        scenario.path.yaw_step = [1.0, 4.0].map(|at| YawStep { at, yaw: 0.5 }).into();
        scenario.cameras.get_or_insert_default().occlusion = vec![Occlusion { at: 2.0, lasts: 0.5 }];
        let marks = Marks::default().finish(&scenario, 3.0);
        assert_eq!(marks.len(), 1);
        assert_eq!(
            (marks[0].time, marks[0].text.as_str()),
            (1.0, "ψd steps to 0.5 rad")
        );
        let [span] = &spans(&scenario)[..] else {
            panic!("only the cameras do not see");
        };
        assert_eq!((span.from, span.to), (2.0, Some(2.5)));
        let gnss = &mut scenario.sensors.get_or_insert_default().gnss;
        gnss.spoofing = vec![Spoofing {
            at: 3.0,
            lasts: 1.5,
            velocity: [0.5, 0.0, 0.0],
        }];
        let spans = spans(&scenario);
        assert_eq!((spans[0].from, spans[0].to), (3.0, Some(4.5)));
    }

    #[test]
    fn only_a_landing_that_nothing_requested_had_no_orchestrator() {
        for (is_requested, expected) in [
            (true, "phase: land"),
            (false, "phase: land (no orchestrator was there)"),
        ] {
            let mut marks = Marks::default();
            for phase in [FlightPhase::Fly, FlightPhase::Land] {
                let mut reference = PathReference::new_zeroed();
                reference.header.stamp_ns = 2_490_000_000;
                reference.phase = phase.code();
                if phase == FlightPhase::Land {
                    reference.cause = PathReference::CAUSE_OPERATOR_LANDS;
                }
                marks.observe(Topic::PathReference, reference.as_bytes());
            }
            if is_requested {
                let request = event(RunEvent::KIND_OPERATOR_LANDS, "the operator lets it land");
                marks.observe(Topic::RunEvent, request.as_bytes());
            }
            let marks = marks.finish(&scenario(0.01, 5.0), 5.0);
            assert_eq!(marks[0].text, expected);
        }
    }

    #[test]
    fn the_request_of_an_earlier_landing_is_not_that_of_a_later_one() {
        let mut marks = Marks::default();
        let phases = [
            (1, FlightPhase::Fly),
            (10, FlightPhase::Land),
            (20, FlightPhase::Disarmed),
            (30, FlightPhase::Fly),
            (100, FlightPhase::Land),
        ];
        for (second, phase) in phases {
            let mut reference = PathReference::new_zeroed();
            reference.header.stamp_ns = second * 1_000_000_000;
            reference.phase = phase.code();
            if phase == FlightPhase::Land {
                reference.cause = PathReference::CAUSE_OPERATOR_LANDS;
            }
            marks.observe(Topic::PathReference, reference.as_bytes());
            if second == 10 {
                let mut request = event(RunEvent::KIND_OPERATOR_LANDS, "gerono land");
                request.header.stamp_ns = 10_000_000_000;
                marks.observe(Topic::RunEvent, request.as_bytes());
            }
        }
        let marks = marks.finish(&scenario(0.01, 100.0), 100.0);
        let landings = marks.iter().filter(|mark| mark.text.contains("land"));
        let texts: Vec<_> = landings.map(|mark| &*mark.text).collect();
        let alone = "phase: land (no orchestrator was there)";
        assert_eq!(texts, ["phase: land", "gerono land", alone]);
    }

    #[test]
    fn a_text_that_lies_about_its_length_is_read_all_the_same() {
        let mut event = event(RunEvent::KIND_OUTAGE_BEGINS, "off");
        event.text_length = u32::MAX;
        let (kind, text) = planned(&event).unwrap();
        assert_eq!(kind, MarkKind::Fault);
        assert!(text.starts_with("off"));
    }

    #[test]
    fn only_what_changes_is_marked_and_not_without_end() {
        let mut marks = Marks::default();
        for step in 0..10_000u32 {
            let mut adaptation = ControlAdaptation::new_zeroed();
            adaptation.stage = if step < 10 {
                ControlAdaptation::STAGE_LAW
            } else {
                (step % 2) as u8
            };
            marks.observe(Topic::ControlAdaptation, adaptation.as_bytes());
        }
        let marks = marks.finish(&scenario(0.01, 5.0), 5.0);
        assert_eq!(marks.len(), MAX_MARKS);
        assert_eq!(marks[0].text, "the controller holds its last command");
    }
}
