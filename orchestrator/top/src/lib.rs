//! A view of a live run in a terminal: how its services keep time, how the vehicle follows, what has happened.
//!
//! [`view`] makes a picture of what is known and [`keys`] makes actions of keys; both are functions without input or
//! output. This module asks the run, hands over what comes, and waits. It never waits for the run: a run that does
//! not answer is shown as such, and the keys go on to work.

pub mod arguments;
mod command;
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

pub use self::command::top;
use self::history::History;
use self::keys::{Action, Controls, Key};
use self::screen::Screen;
use self::view::View;
use flight::interrupt::Interrupt;
use run_client::{Answer, LiveError, LiveRun, Question, Snapshot};

/// Period at which the run is asked how it is; its numbers are those of whole seconds.
const LOOK_PERIOD: Duration = Duration::from_millis(250);

/// A run that has not answered for this long is said not to.
const PATIENCE: Duration = Duration::from_secs(2);

/// The system's sign that the other end of the terminal is closed.
const GONE: PollFlags = PollFlags::HUP.union(PollFlags::ERR);

/// Reason why the view was left.
#[derive(Clone, Debug, PartialEq)]
pub enum Leaving {
    /// The user quit, or the terminal is gone.
    Wanted,
    /// The run has ended; as it was last seen.
    Ended(Option<Box<Snapshot>>),
    /// By a signal of this number.
    Signal(i32),
}

/// Reason why there is no view.
#[derive(Debug, thiserror::Error)]
pub enum TopError {
    /// The terminal failed.
    #[error("the terminal failed: {0}")]
    Terminal(#[from] io::Error),
    /// The run cannot be spoken to.
    #[error(transparent)]
    Run(#[from] LiveError),
}

/// Shows a run until the user quits or it ends; the terminal is then as before.
///
/// # Errors
/// [`TopError`].
pub fn watch(run: &LiveRun, may_break: bool, interrupt: &Interrupt) -> Result<Leaving, TopError> {
    match show(run, may_break, interrupt) {
        Err(TopError::Terminal(_)) if is_terminal_gone() => Ok(Leaving::Wanted),
        result => result,
    }
}

fn show(run: &LiveRun, may_break: bool, interrupt: &Interrupt) -> Result<Leaving, TopError> {
    let mut screen = Screen::enter()?;
    let mut watch = Watch::new(run, may_break);
    loop {
        if let Some(signal) = interrupt.signal() {
            return Ok(Leaving::Signal(signal));
        }
        match watch.converse() {
            Err(LiveError::Ended(_)) => return Ok(Leaving::Ended(watch.snapshot.map(Box::new))),
            result => result?,
        }
        screen.draw(|frame| frame.render_widget(&watch.view(), frame.area()))?;
        match wait(run, watch.next_look)? {
            Woken::ByKeys => {}
            Woken::ByOthers => continue,
            Woken::TerminalGone => return Ok(Leaving::Wanted),
        }
        while event::poll(Duration::ZERO)? {
            match watch.attend_to(&event::read()?) {
                Action::None => {}
                Action::Leave => return Ok(Leaving::Wanted),
                Action::Ask(question) => watch.ask(&question)?,
            }
        }
    }
}

/// One view of a run as text, `width` columns wide.
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

/// Sentences of the run in the one line that there is for them.
fn in_one_line(text: &str) -> String {
    text.lines().collect::<Vec<_>>().join("; ")
}

/// The cause that ended a wait.
enum Woken {
    ByKeys,
    /// The run, a signal (a new size of the terminal, or a request to end), or the time.
    ByOthers,
    TerminalGone,
}

/// Waits for a key, a word of the run, a signal, or the moment.
fn wait(run: &LiveRun, until: Instant) -> io::Result<Woken> {
    let left = until.saturating_duration_since(Instant::now());
    let left = Timespec::try_from(left).map_err(io::Error::other)?;
    let terminal = io::stdin();
    let mut files = [
        PollFd::new(&terminal, PollFlags::IN),
        PollFd::from_borrowed_fd(run.as_fd(), PollFlags::IN),
    ];
    match rustix::event::poll(&mut files, Some(&left)) {
        Ok(_) => Ok(match files[0].revents() {
            // Who reads keys of a terminal that is gone reads for ever.
            happened if happened.intersects(GONE) => Woken::TerminalGone,
            happened if happened.contains(PollFlags::IN) => Woken::ByKeys,
            _ => Woken::ByOthers,
        }),
        Err(rustix::io::Errno::INTR) => Ok(Woken::ByOthers),
        Err(error) => Err(error.into()),
    }
}

fn is_terminal_gone() -> bool {
    let terminal = io::stdin();
    let mut files = [PollFd::new(&terminal, PollFlags::empty())];
    let looked = rustix::io::retry_on_intr(|| rustix::event::poll(&mut files, Some(&Timespec::default())));
    looked.is_ok() && files[0].revents().intersects(GONE)
}

/// The state of the run, and the user's intent.
struct Watch<'a> {
    run: &'a LiveRun,
    snapshot: Option<Snapshot>,
    history: History,
    controls: Controls,
    next_look: Instant,
    /// Questions that have not been answered yet.
    unanswered: usize,
    heard: Instant,
}

impl<'a> Watch<'a> {
    fn new(run: &'a LiveRun, may_break: bool) -> Self {
        Self {
            run,
            snapshot: None,
            history: History::default(),
            controls: Controls::new(may_break),
            next_look: Instant::now(),
            unanswered: 0,
            heard: Instant::now(),
        }
    }

    /// Hears what the run has answered, and asks how it is if it is time.
    fn converse(&mut self) -> Result<(), LiveError> {
        while let Some(answer) = self.run.hear()? {
            self.unanswered = self.unanswered.saturating_sub(1);
            self.heard = Instant::now();
            match answer {
                Answer::Snapshot(snapshot) => {
                    self.history.keep(&snapshot);
                    self.snapshot = Some(*snapshot);
                }
                Answer::Done(text) => self.controls.tell(in_one_line(&text)),
                Answer::Values(gains) => self.controls.keep_gains(gains),
                // It asks for none of them.
                Answer::Description(_) | Answer::Newest(_) => {}
                Answer::Refused(reason) | Answer::Closed(reason) => {
                    self.controls.tell(in_one_line(&format!("refused: {reason}")));
                }
            }
        }
        if Instant::now() >= self.next_look {
            if self.unanswered == 0 {
                self.ask(&Question::Look)?;
            }
            self.next_look = Instant::now() + LOOK_PERIOD;
        }
        Ok(())
    }

    fn ask(&mut self, question: &Question) -> Result<(), LiveError> {
        if self.run.say(question)? {
            self.unanswered += 1;
        } else {
            self.controls.tell("the run takes no questions now".to_owned());
        }
        Ok(())
    }

    fn attend_to(&mut self, event: &Event) -> Action {
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
        let silence = self.heard.elapsed();
        View {
            run: self.run.name(),
            snapshot: self.snapshot.as_ref(),
            history: &self.history,
            controls: &self.controls,
            silence: (silence > PATIENCE).then_some(silence),
        }
    }
}
