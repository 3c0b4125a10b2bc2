//! Ticks at which recorded samples are published: at the first tick of their topic after the measurement.
//!
//! A topic has one sample a tick. Of a sensor that is quicker, samples wait for the next ticks, as long as the estimator can use
//! them then; or only the newest one of each tick is published, if that was asked for.

use shared_types::schedule::Rate;

use crate::recording::{Measured, Timed, WrongLine};

/// Published samples of a topic, each with its tick, in their order.
pub type Publications<T> = Vec<(u64, T)>;

/// Rule for the samples of a topic.
#[derive(Clone, Copy, Debug)]
pub struct Rule {
    /// Ticks of the topic.
    pub rate: Rate,
    /// Length of a base tick, ns.
    pub tick_ns: u64,
    /// Longest time from a measurement to its publication, ns.
    pub latest_ns: u64,
    /// `true` to publish only the newest sample of each tick.
    pub thins: bool,
}

impl Rule {
    /// Returns the first tick of the topic from a tick on.
    fn first_from(&self, tick: u64) -> u64 {
        let Rate { period, phase } = self.rate;
        phase + tick.saturating_sub(phase).div_ceil(period) * period
    }

    /// Places samples in the order of their times, which `flight_ns` converts to ns since the start of the flight. Returns them
    /// with their ticks, and the number of those left out.
    ///
    /// # Errors
    /// A sample that cannot be published in time.
    pub fn place<T: Measured>(
        &self,
        samples: &[Timed<T>],
        flight_ns: impl Fn(u64) -> u64,
    ) -> Result<(Publications<T>, u64), WrongLine> {
        let mut placed = Publications::new();
        let mut left_out = 0;
        for sample in samples {
            let time_ns = flight_ns(sample.time_ns);
            let mut value = sample.value;
            value.set_measured_ns(time_ns);
            let mut tick = self.first_from(time_ns.div_ceil(self.tick_ns));
            if let Some((last, newest)) = placed.last_mut()
                && tick <= *last
            {
                if self.thins {
                    *newest = value;
                    left_out += 1;
                    continue;
                }
                tick = *last + self.rate.period;
            }
            if tick * self.tick_ns > time_ns + self.latest_ns {
                return Err(WrongLine::new(
                    sample.line,
                    format!(
                        "this sample would be published {:.3} s after its measurement, and the estimator can use it for {:.3} s",
                        (tick * self.tick_ns - time_ns) as f64 * 1e-9,
                        self.latest_ns as f64 * 1e-9
                    ),
                ));
            }
            placed.push((tick, value));
        }
        Ok((placed, left_out))
    }
}
