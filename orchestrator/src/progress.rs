//! Progress of a flight on the terminal, on standard error; nothing where nobody looks.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use shared_types::Schedule;

/// Ticks between two updates: a look at the clock must not slow the flight.
const UPDATE_PERIOD: u64 = 128;

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

/// Says that something takes a while; nothing where standard error is no terminal.
#[must_use]
pub fn waiting(what: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner();
    spinner.set_message(what);
    spinner.tick();
    spinner
}

/// A bar of simulated time.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// A bar for a flight; hidden if asked for, or if standard error is no terminal.
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
        bar.set_message(title.to_owned());
        Self { bar }
    }

    /// No bar at all.
    #[must_use]
    pub fn hidden() -> Self {
        Self {
            bar: ProgressBar::hidden(),
        }
    }

    /// `tick` is whole.
    #[inline]
    pub fn tick(&mut self, tick: u64) {
        if tick.is_multiple_of(UPDATE_PERIOD) {
            self.bar.set_position(tick);
        }
    }

    /// Takes the bar away.
    pub fn clear(&mut self) {
        self.bar.finish_and_clear();
    }
}
