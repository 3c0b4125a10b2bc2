//! Live view of a run in a terminal: timing of its services, tracking of the path, events.
//!
//! [`view`] draws the state and [`keys`] maps keys to actions; both are pure functions. This module exchanges messages
//! with the run and waits. It never blocks on the run: a run that does not answer is shown as such, and the keys still
//! work.

pub mod history;
pub mod keys;
mod screen;
pub mod view;
mod words;

use std::io;
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use ratatui::crossterm::event::{self, Event, KeyEventKind};
use rustix::event::{PollFd, PollFlags, Timespec};

use self::history::History;
use self::keys::{Action, Controls, Key};
use self::screen::Screen;
use self::view::View;
use flight::interrupt::Interrupt;
use run_client::{Answer, LiveError, LiveRun, Question, Snapshot};

/// Period of snapshots; their figures are of whole seconds.
const SNAPSHOT_PERIOD: Duration = Duration::from_millis(250);

/// Time without an answer after which the run is shown as silent.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);

/// Poll events that report a closed terminal.
const GONE: PollFlags = PollFlags::HUP.union(PollFlags::ERR);

/// Reason why the view ended.
#[derive(Clone, Debug, PartialEq)]
pub enum ViewEnd {
    /// The user quit, or the terminal was closed.
    Quit,
    /// The run ended, with its last snapshot.
    Ended(Option<Box<Snapshot>>),
    /// A signal arrived.
    Signal(i32),
}

#[derive(Debug, thiserror::Error)]
pub enum TopError {
    #[error("the terminal failed: {0}")]
    Terminal(#[from] io::Error),
    /// The connection to the run failed.
    #[error(transparent)]
    Run(#[from] LiveError),
}

/// Shows a run until the user quits or it ends, then restores the terminal.
///
/// # Errors
/// [`TopError`].
pub fn watch(run: &LiveRun, may_break: bool, interrupt: &Interrupt) -> Result<ViewEnd, TopError> {
    match show(run, may_break, interrupt) {
        Err(TopError::Terminal(_)) if is_terminal_gone() => Ok(ViewEnd::Quit),
        result => result,
    }
}

fn show(run: &LiveRun, may_break: bool, interrupt: &Interrupt) -> Result<ViewEnd, TopError> {
    let mut screen = Screen::enter()?;
    let mut watch = Watch::new(run, may_break);
    loop {
        if let Some(signal) = interrupt.signal() {
            return Ok(ViewEnd::Signal(signal));
        }
        match watch.update() {
            Err(LiveError::Ended(_)) => return Ok(ViewEnd::Ended(watch.snapshot.map(Box::new))),
            result => result?,
        }
        screen.draw(|frame| frame.render_widget(&watch.view(), frame.area()))?;
        match wait(run, watch.next_snapshot)? {
            Wake::Key => {}
            Wake::Other => continue,
            Wake::TerminalGone => return Ok(ViewEnd::Quit),
        }
        while event::poll(Duration::ZERO)? {
            match watch.handle(&event::read()?) {
                Action::None => {}
                Action::Leave => return Ok(ViewEnd::Quit),
                Action::Ask(question) => watch.ask(&question)?,
            }
        }
    }
}

/// Returns one view of a run as text, `width` columns wide.
#[must_use]
pub fn once(run: &str, snapshot: &Snapshot, width: u16) -> String {
    let (controls, mut history) = (Controls::new(false), History::default());
    history.keep(snapshot);
    let view = View {
        run,
        snapshot: Some(snapshot),
        history: &history,
        controls: &controls,
        silence: None,
    };
    view.without_keys(width)
}

/// Joins the lines of an answer: the notice has one line.
fn in_one_line(text: &str) -> String {
    text.lines().collect::<Vec<_>>().join("; ")
}

/// Cause that ended a wait.
enum Wake {
    Key,
    /// A message of the run, a signal (window size or termination), or the timeout.
    Other,
    TerminalGone,
}

/// Waits for a key, a message of the run, a signal, or the deadline.
fn wait(run: &LiveRun, until: Instant) -> io::Result<Wake> {
    let left = until.saturating_duration_since(Instant::now());
    let left = Timespec::try_from(left).map_err(io::Error::other)?;
    let terminal = io::stdin();
    let mut files = [
        PollFd::new(&terminal, PollFlags::IN),
        PollFd::from_borrowed_fd(run.as_fd(), PollFlags::IN),
    ];
    match rustix::event::poll(&mut files, Some(&left)) {
        Ok(_) => Ok(match files[0].revents() {
            // Reading keys of a closed terminal would never return.
            happened if happened.intersects(GONE) => Wake::TerminalGone,
            happened if happened.contains(PollFlags::IN) => Wake::Key,
            _ => Wake::Other,
        }),
        Err(rustix::io::Errno::INTR) => Ok(Wake::Other),
        Err(error) => Err(error.into()),
    }
}

fn is_terminal_gone() -> bool {
    let terminal = io::stdin();
    let mut files = [PollFd::new(&terminal, PollFlags::empty())];
    let looked = rustix::io::retry_on_intr(|| rustix::event::poll(&mut files, Some(&Timespec::default())));
    looked.is_ok() && files[0].revents().intersects(GONE)
}

/// State of the run and of the user interface.
struct Watch<'a> {
    run: &'a LiveRun,
    snapshot: Option<Snapshot>,
    history: History,
    controls: Controls,
    next_snapshot: Instant,
    /// Number of questions without an answer.
    unanswered: usize,
    last_answer: Instant,
}

impl<'a> Watch<'a> {
    fn new(run: &'a LiveRun, may_break: bool) -> Self {
        Self {
            run,
            snapshot: None,
            history: History::default(),
            controls: Controls::new(may_break),
            next_snapshot: Instant::now(),
            unanswered: 0,
            last_answer: Instant::now(),
        }
    }

    /// Handles the answers of the run, and requests a snapshot when it is due.
    fn update(&mut self) -> Result<(), LiveError> {
        while let Some(answer) = self.run.receive()? {
            self.unanswered = self.unanswered.saturating_sub(1);
            self.last_answer = Instant::now();
            match answer {
                Answer::Snapshot(snapshot) => {
                    self.history.keep(&snapshot);
                    self.snapshot = Some(*snapshot);
                }
                Answer::Done(text) => self.controls.show_notice(in_one_line(&text)),
                Answer::Values(gains) => self.controls.set_gains(gains),
                // Answers to questions that this view does not send.
                Answer::Description(_) | Answer::Newest(_) => {}
                Answer::Refused(reason) | Answer::Closed(reason) => {
                    self.controls
                        .show_notice(in_one_line(&format!("refused: {reason}")));
                }
            }
        }
        if Instant::now() >= self.next_snapshot {
            if self.unanswered == 0 {
                self.ask(&Question::Look)?;
            }
            self.next_snapshot = Instant::now() + SNAPSHOT_PERIOD;
        }
        Ok(())
    }

    fn ask(&mut self, question: &Question) -> Result<(), LiveError> {
        if self.run.send(question)? {
            self.unanswered += 1;
        } else {
            self.controls
                .show_notice("the run takes no questions now".to_owned());
        }
        Ok(())
    }

    fn handle(&mut self, event: &Event) -> Action {
        let services = self
            .snapshot
            .as_ref()
            .map_or(&[][..], |snapshot| &snapshot.services);
        match event {
            Event::Key(key) if key.kind != KeyEventKind::Release => {
                self.controls.press(Key::of(key), services)
            }
            _ => Action::None,
        }
    }

    fn view(&self) -> View<'_> {
        let silence = self.last_answer.elapsed();
        View {
            run: self.run.name(),
            snapshot: self.snapshot.as_ref(),
            history: &self.history,
            controls: &self.controls,
            silence: (silence > ANSWER_TIMEOUT).then_some(silence),
        }
    }
}
