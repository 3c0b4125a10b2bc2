//! Keeps the board up to date: finds the run, asks it for its newest samples, and says when it does not answer.
//!
//! The orchestrator answers between its other work and never waits. Whatever becomes of this process, the flight loses
//! nothing but a client.

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

/// Period of frames while a browser watches.
const FRAME_PERIOD: Duration = Duration::from_millis(33);

/// Period of frames while none does: the past goes on.
const IDLE_PERIOD: Duration = Duration::from_millis(250);

/// Period of the state of services; its numbers are those of whole seconds.
const STATUS_PERIOD: Duration = Duration::from_millis(250);

/// Time for which an orchestrator may take to answer before readers are told.
const PATIENCE: Duration = Duration::from_secs(2);

/// Period at which a run is looked for that is not there, or does not answer.
const RETRY: Duration = Duration::from_secs(1);

/// Span over which the speed of simulated time is taken.
const SPEED_SPAN: Duration = Duration::from_secs(1);

/// A run's samples on their way to the board.
pub struct Feed<'a> {
    /// The name of the run, if several are under way.
    pub run: Option<String>,
    /// `true` if other runs follow.
    pub follows: bool,
    /// Where the news go.
    pub board: &'a Board,
    /// Closed when this is to end.
    pub stop: Receiver<()>,
}

/// Why a run is left.
enum Left {
    /// It has ended, or another build flies it: the reason in words.
    Run(String),
    /// This is to end.
    Stopped,
}

impl Feed<'_> {
    /// Follows the run, and others after it if so asked, until it has ended or this is to stop.
    ///
    /// `found` is the run to begin with.
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
                Left::Stopped => return,
                Left::Run(reason) => {
                    let waits = if self.follows {
                        "; the next flight is waited for"
                    } else {
                        ""
                    };
                    self.say("ended", &format!("{reason}{waits}"));
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

    /// Tells readers whether the run answers.
    fn say(&self, state: &str, text: &str) {
        self.board.put(
            Kind::Contact,
            json!({"state": state, "text": text, "follows": self.follows}).to_string(),
        );
    }

    /// Follows a run to its end, through all silences.
    fn follow(&self, run: &MachineRun) -> Left {
        let mut encoder = None;
        loop {
            let error = match LiveRun::connect(run, PATIENCE) {
                Ok(line) => match self.relay(&line, &mut encoder) {
                    Ok(left) => return left,
                    Err(error) => error,
                },
                Err(error) => error,
            };
            // Also the socket of an orchestrator that has died is closed, and its services may fly on.
            if !run.lives() {
                return Left::Run(format!("the run `{}` has ended", run.name()));
            }
            self.say("silent", &error.to_string());
            if self.is_stopped_within(RETRY) {
                return Left::Stopped;
            }
        }
    }

    /// Relays what a run answers until it ends or no longer does.
    fn relay(&self, line: &LiveRun, encoder: &mut Option<Encoder>) -> Result<Left, LiveError> {
        if encoder.is_none() {
            let description = describe(line)?;
            if let Some(topic) = description.unreadable() {
                let reason = format!(
                    "the run `{}` is flown by another build of gerono: its `{topic}` has another layout",
                    line.name()
                );
                return Ok(Left::Run(reason));
            }
            let Some(made) = Encoder::new(description) else {
                return Ok(Left::Run(format!(
                    "the scenario of the run `{}` makes no schedule",
                    line.name()
                )));
            };
            self.board.put(Kind::Flight, made.flight(line.name()));
            *encoder = Some(made);
        }
        let Some(encoder) = encoder else {
            unreachable!("it has just been made");
        };
        self.say("live", "");
        let mut pace = Pace::default();
        let mut distance = Distance::none();
        let mut marks = String::new();
        let mut next_status = Instant::now();
        loop {
            let began = Instant::now();
            if let Answer::Newest(samples) = line.ask(&Question::Watch, PATIENCE)? {
                if let Some(frame) = encoder.frame(&samples) {
                    pace.observe(began, frame.time);
                    self.board.put(Kind::Frame, text_of(&frame));
                }
                let scenario = Arc::clone(encoder.scenario());
                self.board.put_moment(Moment { scenario, samples });
            }
            if began >= next_status {
                next_status = began + STATUS_PERIOD;
                if let Answer::Snapshot(snapshot) = line.ask(&Question::Look, PATIENCE)? {
                    distance.keep_from(snapshot.services.iter().map(|service| service.pid));
                    self.put_marks(encoder, &snapshot, &mut marks);
                    let status = json!({"snapshot": snapshot, "speed": pace.speed()});
                    self.board.put(Kind::Status, status.to_string());
                }
            }
            let period = if self.board.readers() > 0 {
                FRAME_PERIOD
            } else {
                IDLE_PERIOD
            };
            if self.is_stopped_within(period.saturating_sub(began.elapsed())) {
                return Ok(Left::Stopped);
            }
        }
    }

    fn put_marks(&self, encoder: &Encoder, snapshot: &Snapshot, last: &mut String) {
        let marks = text_of(&encoder.marks(snapshot.time));
        if marks != *last {
            self.board.put(Kind::Marks, marks.clone());
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
        // An older program does not know the question.
        Answer::Refused(reason) | Answer::Closed(reason) => Err(unexpected(reason)),
        _ => Err(unexpected(
            "it answered something else than what it flies".to_owned(),
        )),
    }
}

/// The speed of a flight's time.
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

    /// Seconds of the flight in a second.
    fn speed(&self) -> Option<f64> {
        self.speed
    }
}
