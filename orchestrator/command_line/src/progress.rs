//! Progress of a flight on the terminal, on standard error; nothing where nobody looks.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::Duration;

pub use indicatif::ProgressBar;
use indicatif::{ProgressDrawTarget, ProgressStyle};
use shared_types::Schedule;

use scenario_file::printable::{printable, printable_lines};

/// Time between two updates of the bar.
const UPDATE_PERIOD: Duration = Duration::from_millis(100);

/// Time that a terminal may take to show the last messages.
const TERMINAL_LIMIT: Duration = Duration::from_secs(1);

/// A bar of whole flights; nothing where standard error is no terminal.
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

/// A bar of whole flights with their rate; nothing where standard error is no terminal.
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

/// Says that something takes a while; nothing where standard error is no terminal.
#[must_use]
pub fn waiting(what: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner();
    spinner.set_message(what);
    spinner.tick();
    spinner
}

/// A bar of simulated time, and messages above it.
///
/// A thread of its own draws it: a terminal that is stopped (Ctrl-S), slow or gone holds up no flight.
#[derive(Debug)]
pub struct Progress {
    tick: Arc<AtomicU64>,
    messages: Messages,
    /// Ends with the thread that draws.
    painter: Receiver<()>,
}

/// Tells people at the terminal something, without waiting for the terminal.
#[derive(Clone, Debug, Default)]
pub struct Messages(Option<Sender<Said>>);

#[derive(Debug)]
enum Said {
    Message(String),
    End,
}

impl Messages {
    /// Shows a message above the progress, on standard error.
    pub fn say(&self, text: impl Into<String>) {
        self.send(Said::Message(text.into()));
    }

    fn send(&self, said: Said) {
        if let Some(sender) = &self.0 {
            // It fails once the bar is gone, and then there is nobody to tell.
            let _ = sender.send(said);
        }
    }
}

impl Progress {
    /// A bar for a flight; hidden if asked for, or if standard error is no terminal. Messages are shown all the same.
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
        let (alive, painter) = mpsc::channel();
        let drawing = std::thread::Builder::new().name("progress".to_owned());
        // Without a thread for it nothing is shown, and the flight goes on.
        let _ = drawing.spawn({
            let tick = Arc::clone(&tick);
            move || {
                paint(&bar, &tick, &receiver);
                drop(alive);
            }
        });
        Self {
            tick,
            messages: Messages(Some(sender)),
            painter,
        }
    }

    /// No bar at all, and no messages.
    #[must_use]
    pub fn hidden() -> Self {
        Self {
            tick: Arc::default(),
            messages: Messages::default(),
            painter: mpsc::channel().1,
        }
    }

    /// For messages from elsewhere.
    #[must_use]
    pub fn messages(&self) -> Messages {
        self.messages.clone()
    }

    /// `tick` is whole.
    #[inline]
    pub fn tick(&self, tick: u64) {
        self.tick.store(tick, Ordering::Relaxed);
    }

    /// Returns where a flight may store its last tick by itself.
    #[must_use]
    pub fn shared_tick(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.tick)
    }

    /// Takes the bar away, once all messages are shown; not later than a stopped terminal permits.
    pub fn clear(&mut self) {
        self.messages.send(Said::End);
        // It fails with the end of the thread, which is what is waited for.
        let _ = self.painter.recv_timeout(TERMINAL_LIMIT);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}

/// Draws the bar and shows messages until the end is told.
fn paint(bar: &ProgressBar, tick: &AtomicU64, said: &Receiver<Said>) {
    loop {
        match said.recv_timeout(UPDATE_PERIOD) {
            Ok(Said::Message(text)) => bar.suspend(|| {
                // A terminal that is gone shows nothing.
                let _ = writeln!(std::io::stderr(), "{}", printable_lines(&text));
            }),
            Err(RecvTimeoutError::Timeout) => bar.set_position(tick.load(Ordering::Relaxed)),
            Ok(Said::End) | Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    bar.finish_and_clear();
}
