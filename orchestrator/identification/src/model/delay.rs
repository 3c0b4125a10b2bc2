//! Coarse search for the delay from sending a frame to its effect.
//!
//! The filter predicts with the commands, and the innovations of the captures measure the error of the prediction. The sum of
//! their squared Mahalanobis distances is smallest at the true delay. Captures that are later than their stamps have the same
//! effect: the result is an effective delay, which includes this lateness and all lag of thrust and body rates beyond the
//! model's.

use flight::many;

use super::IdentifyError;
use super::recording::{FilterSettings, Recording};

/// Upper end of the search, s.
const LONGEST: f64 = 0.06;

/// Resolution of the search, s: over the whole range, then around the best delay.
const STEPS: [f64; 2] = [4e-3, 1e-3];

/// Returns the delay with the smallest sum of squared distances.
///
/// # Errors
/// [`IdentifyError::Scenario`] if no filter can be made.
pub fn search(recording: &Recording, settings: &FilterSettings) -> Result<f64, IdentifyError> {
    let score = |latency: f64| {
        let mut settings = settings.clone();
        settings.model.radio_latency = latency;
        recording
            .filtered(&settings)
            .map(|filtered| filtered.squared_distances)
    };
    let (mut from, mut to) = (0.0, LONGEST);
    let mut best = settings.model.radio_latency;
    // The longest delays may exceed the filter's history and are skipped below; the stated one must work.
    score(best)?;
    for step in STEPS {
        let latencies = grid(from, to, step);
        let scores = many::map(&latencies, many::cores(), |&latency| {
            score(latency).unwrap_or(f64::INFINITY)
        });
        let least = (0..latencies.len())
            .min_by(|&one, &other| scores[one].total_cmp(&scores[other]))
            .unwrap_or(0);
        best = latencies[least];
        (from, to) = ((best - step).max(0.0), best + step);
    }
    Ok(best)
}

fn grid(from: f64, to: f64, step: f64) -> Vec<f64> {
    let count = ((to - from) / step).round().max(0.0);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a small whole number"
    )]
    let count = count as u32;
    (0..=count).map(|index| from + f64::from(index) * step).collect()
}
