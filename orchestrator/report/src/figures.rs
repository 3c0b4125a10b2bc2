//! Figures beside the page, drawn by the caller from the same samples.

use scenario::Scenario;
use serde::Serialize;
use shared_types::{Schedule, Topic};

/// A figure of the flights of a page.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    /// Name of its file beside the page.
    pub file: &'static str,
    pub title: &'static str,
    /// The drawing.
    #[serde(skip)]
    pub svg: String,
}

/// Draws figures of the logs of a page while the logs are read.
pub trait Figures {
    /// Begins the next log.
    fn begin(&mut self, scenario: &Scenario, schedule: &Schedule);

    /// Records the next sample of the log.
    fn sample(&mut self, topic: Topic, bytes: &[u8]);

    /// Returns the figures of all logs.
    fn draw(&mut self) -> Vec<Figure>;
}

/// No figures.
impl Figures for () {
    fn begin(&mut self, _: &Scenario, _: &Schedule) {}

    fn sample(&mut self, _: Topic, _: &[u8]) {}

    fn draw(&mut self) -> Vec<Figure> {
        Vec::new()
    }
}
