//! Progress of a flight on standard error; hidden unless that is a terminal.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::Duration;

pub use indicatif::ProgressBar;
use indicatif::{ProgressDrawTarget, ProgressStyle};
use shared_types::Schedule;

use scenario_file::printable::{printable, printable_lines};

/// Update period of the bar.
const UPDATE_PERIOD: Duration = Duration::from_millis(100);

/// Timeout for a terminal to show the last messages.
const TERMINAL_LIMIT: Duration = Duration::from_secs(1);

/// Returns a bar of completed flights; hidden unless standard error is a terminal.
///
/// # Panics
/// Never: the template is well-formed.
#[must_use]
pub fn flights(count: usize) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(count as u64), ProgressDrawTarget::stderr());
    let template = "flights {pos} of {len} {wide_bar} {elapsed}, {eta} left";
    bar.set_style(ProgressStyle::with_template(template).expect("the template is well-formed"));
    bar
}

/// Returns a bar of completed flights with their rate; hidden unless standard error is a terminal.
///
/// # Panics
/// Never: the template is well-formed.
#[must_use]
pub fn rated_flights(count: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(count), ProgressDrawTarget::stderr());
    let template = "flights {pos} of {len} {wide_bar} {per_sec}, {elapsed}, {eta} left";
    bar.set_style(ProgressStyle::with_template(template).expect("the template is well-formed"));
    bar
}

/// Returns a spinner with a label; hidden unless standard error is a terminal.
#[must_use]
pub fn waiting(what: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner();
    spinner.set_message(what);
    spinner.tick();
    spinner
}

/// Bar of simulated time, with messages above it.
///
/// A separate thread draws it: a terminal that is stopped (Ctrl-S), slow or closed does not delay the flight.
#[derive(Debug)]
pub struct Progress {
    tick: Arc<AtomicU64>,
    messages: Messages,
    /// Disconnected when the drawing thread ends.
    drawing: Receiver<()>,
}

/// Sender of messages to the terminal. Sending does not wait for the terminal.
#[derive(Clone, Debug, Default)]
pub struct Messages {
    sender: Option<Sender<Event>>,
    /// `true` if only what the user must know is shown.
    is_quiet: bool,
}

#[derive(Debug)]
enum Event {
    Message(String),
    End,
}

impl Messages {
    /// Shows a message above the progress, on standard error.
    pub fn show(&self, text: impl Into<String>) {
        self.send(Event::Message(text.into()));
    }

    /// As [`Self::show`], unless the user asked for quiet.
    pub fn show_unless_quiet(&self, text: impl Into<String>) {
        if !self.is_quiet {
            self.show(text);
        }
    }

    fn send(&self, event: Event) {
        if let Some(sender) = &self.sender {
            // It fails once the bar is gone; there is no terminal thread to show the message then.
            let _ = sender.send(event);
        }
    }
}

impl Progress {
    /// Creates the bar of a flight; hidden on request or unless standard error is a terminal. Messages are shown in any
    /// case.
    #[must_use]
    pub fn new(schedule: &Schedule, title: &str, hidden: bool) -> Self {
        let target = if hidden {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr()
        };
        let bar = ProgressBar::with_draw_target(Some(schedule.last_tick()), target);
        let template = "{msg} {wide_bar} {percent:>3} %  {elapsed}, {eta} left";
        bar.set_style(ProgressStyle::with_template(template).expect("the template is well-formed"));
        bar.set_message(printable(title).into_owned());
        let tick = Arc::new(AtomicU64::new(0));
        let (sender, receiver) = mpsc::channel();
        let (running, drawing) = mpsc::channel();
        let thread = std::thread::Builder::new().name("progress".to_owned());
        // If the thread cannot be started, the flight continues without progress.
        let _ = thread.spawn({
            let tick = Arc::clone(&tick);
            move || {
                draw(&bar, &tick, &receiver);
                drop(running);
            }
        });
        Self {
            tick,
            messages: Messages {
                sender: Some(sender),
                is_quiet: hidden,
            },
            drawing,
        }
    }

    /// Returns a progress without bar and messages.
    #[must_use]
    pub fn hidden() -> Self {
        Self {
            tick: Arc::default(),
            messages: Messages::default(),
            drawing: mpsc::channel().1,
        }
    }

    /// Returns a sender of messages above the bar.
    #[must_use]
    pub fn messages(&self) -> Messages {
        self.messages.clone()
    }

    /// Reports a completed tick.
    #[inline]
    pub fn tick(&self, tick: u64) {
        self.tick.store(tick, Ordering::Relaxed);
    }

    /// Returns the counter into which a flight stores its last tick directly.
    #[must_use]
    pub fn shared_tick(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.tick)
    }

    /// Removes the bar once all messages are shown, or after a second if the terminal is stopped.
    pub fn clear(&mut self) {
        self.messages.send(Event::End);
        // Disconnection is the expected result: the thread has ended.
        let _ = self.drawing.recv_timeout(TERMINAL_LIMIT);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}

/// Draws the bar and shows messages until the channel is closed or [`Event::End`] arrives.
fn draw(bar: &ProgressBar, tick: &AtomicU64, events: &Receiver<Event>) {
    loop {
        match events.recv_timeout(UPDATE_PERIOD) {
            Ok(Event::Message(text)) => bar.suspend(|| {
                // Errors of a closed terminal are ignored.
                let _ = writeln!(std::io::stderr(), "{}", printable_lines(&text));
            }),
            Err(RecvTimeoutError::Timeout) => bar.set_position(tick.load(Ordering::Relaxed)),
            Ok(Event::End) | Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    bar.finish_and_clear();
}
