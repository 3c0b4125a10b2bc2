//! Feeds the board: finds the run, polls its newest samples, and reports when it does not answer.
//!
//! The orchestrator answers between its other work and never waits for a client. If this process fails, the flight only
//! loses a client.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use run_client::runs::MachineRun;
use run_client::{Answer, Description, LiveError, LiveRun, Question, Snapshot};
use serde_json::json;

use crate::board::{Board, Kind};
use crate::foxglove::Moment;
use crate::frame::Encoder;
use crate::manners::Distance;

/// Frame period while a client is connected.
const FRAME_PERIOD: Duration = Duration::from_millis(33);

/// Frame period without clients: the past still grows.
const IDLE_PERIOD: Duration = Duration::from_millis(250);

/// Period of the services' state; its figures are of whole seconds.
const STATUS_PERIOD: Duration = Duration::from_millis(250);

/// Answer timeout of the orchestrator.
const PATIENCE: Duration = Duration::from_secs(2);

/// Period at which a missing or silent run is searched again.
const RETRY: Duration = Duration::from_secs(1);

/// Interval over which the speed of simulated time is averaged.
const SPEED_SPAN: Duration = Duration::from_secs(1);

/// Transfer of a run's samples to the board.
pub struct Feed<'a> {
    /// Name of the run; required if several are under way.
    pub run: Option<String>,
    /// `true` if later runs are shown as well.
    pub follows: bool,
    pub board: &'a Board,
    /// Closed to stop the feed.
    pub stop: Receiver<()>,
}

/// Reason why a run is left.
enum LeaveReason {
    /// The run has ended or was built differently: the reason as text.
    RunEnded(String),
    /// The feed was stopped.
    Stopped,
}

impl Feed<'_> {
    /// Shows the run, and later ones if requested, until it ends or the feed is stopped.
    ///
    /// `found` is the first run.
    pub fn run(&self, found: Option<MachineRun>) {
        let mut next = found;
        loop {
            let Some(run) = next.take() else {
                if self.is_stopped_within(RETRY) {
                    return;
                }
                next = run_client::find_to_watch(self.run.as_deref(), "view").ok();
                continue;
            };
            match self.follow(&run) {
                LeaveReason::Stopped => return,
                LeaveReason::RunEnded(reason) => {
                    let waits = if self.follows {
                        "; waiting for the next flight"
                    } else {
                        ""
                    };
                    self.post_contact("ended", &format!("{reason}{waits}"));
                    if !self.follows {
                        return;
                    }
                }
            }
        }
    }

    fn is_stopped_within(&self, limit: Duration) -> bool {
        self.stop.recv_timeout(limit) != Err(RecvTimeoutError::Timeout)
    }

    /// Posts the state of the connection to the run.
    fn post_contact(&self, state: &str, text: &str) {
        self.board.post(
            Kind::Contact,
            json!({"state": state, "text": text, "follows": self.follows}).to_string(),
        );
    }

    /// Shows a run to its end, across connection losses.
    fn follow(&self, run: &MachineRun) -> LeaveReason {
        let mut encoder = None;
        loop {
            let error = match LiveRun::connect(run, PATIENCE) {
                Ok(line) => match self.relay(&line, &mut encoder) {
                    Ok(left) => return left,
                    Err(error) => error,
                },
                Err(error) => error,
            };
            // A closed socket is no proof: the orchestrator may have died while its services fly on.
            if !run.lives() {
                return LeaveReason::RunEnded(format!("the run `{}` has ended", run.name()));
            }
            self.post_contact("silent", &error.to_string());
            if self.is_stopped_within(RETRY) {
                return LeaveReason::Stopped;
            }
        }
    }

    /// Polls a run until it ends or does not answer.
    fn relay(&self, line: &LiveRun, encoder: &mut Option<Encoder>) -> Result<LeaveReason, LiveError> {
        if encoder.is_none() {
            let description = describe(line)?;
            if let Some(topic) = description.unreadable() {
                let reason = format!(
                    "the run `{}` is flown by another build of gerono: its `{topic}` has another layout",
                    line.name()
                );
                return Ok(LeaveReason::RunEnded(reason));
            }
            let Some(made) = Encoder::new(description) else {
                return Ok(LeaveReason::RunEnded(format!(
                    "the scenario of the run `{}` has no valid schedule",
                    line.name()
                )));
            };
            self.board.post(Kind::Flight, made.flight(line.name()));
            *encoder = Some(made);
        }
        let Some(encoder) = encoder else {
            unreachable!("the encoder was created above");
        };
        self.post_contact("live", "");
        let mut pace = Pace::default();
        let mut distance = Distance::none();
        let mut marks = String::new();
        let mut next_status = Instant::now();
        loop {
            let began = Instant::now();
            if let Answer::Newest(samples) = line.ask(&Question::Watch, PATIENCE)? {
                if let Some(frame) = encoder.frame(&samples) {
                    pace.observe(began, frame.time);
                    self.board.post(Kind::Frame, text_of(&frame));
                }
                let scenario = Arc::clone(encoder.scenario());
                self.board.post_moment(Moment { scenario, samples });
            }
            if began >= next_status {
                next_status = began + STATUS_PERIOD;
                if let Answer::Snapshot(snapshot) = line.ask(&Question::Look, PATIENCE)? {
                    distance.avoid_cores_of(snapshot.services.iter().map(|service| service.pid));
                    self.post_marks(encoder, &snapshot, &mut marks);
                    let status = json!({"snapshot": snapshot, "speed": pace.speed()});
                    self.board.post(Kind::Status, status.to_string());
                }
            }
            let period = if self.board.readers() > 0 {
                FRAME_PERIOD
            } else {
                IDLE_PERIOD
            };
            if self.is_stopped_within(period.saturating_sub(began.elapsed())) {
                return Ok(LeaveReason::Stopped);
            }
        }
    }

    fn post_marks(&self, encoder: &Encoder, snapshot: &Snapshot, last: &mut String) {
        let marks = text_of(&encoder.marks(snapshot.time));
        if marks != *last {
            self.board.post(Kind::Marks, marks.clone());
            *last = marks;
        }
    }
}

fn text_of(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("numbers and texts are JSON")
}

fn describe(line: &LiveRun) -> Result<Description, LiveError> {
    let unexpected = |text: String| LiveError::Socket {
        run: line.name().to_owned(),
        source: text.into(),
    };
    match line.ask(&Question::Describe, PATIENCE)? {
        Answer::Description(description) => Ok(*description),
        // An older program that lacks the question.
        Answer::Refused(reason) | Answer::Closed(reason) => Err(unexpected(reason)),
        _ => Err(unexpected("it sent an unexpected answer".to_owned())),
    }
}

/// Ratio of a flight's time to the system's.
#[derive(Debug, Default)]
struct Pace {
    from: Option<(Instant, f64)>,
    speed: Option<f64>,
}

impl Pace {
    fn observe(&mut self, now: Instant, time: f64) {
        let Some((then, from)) = self.from else {
            self.from = Some((now, time));
            return;
        };
        let elapsed = now.duration_since(then);
        if elapsed >= SPEED_SPAN {
            self.speed = Some((time - from) / elapsed.as_secs_f64());
            self.from = Some((now, time));
        }
    }

    /// Returns the flight's time per real time, s/s.
    fn speed(&self) -> Option<f64> {
        self.speed
    }
}
