//! The time from the sending of a frame to its acting, roughly.
//!
//! The filter knows the commands, and each capture tells how far the vehicle is from where they should have brought it.
//! The sum of the squared Mahalanobis distances of the captures is smallest at the true delay. Captures that are later
//! than their stamps make the same difference: what is found is the delay between both,
//! and with it all lag of thrust and body rates beyond what the model states: an effective delay.

use flight::many;

use super::IdentifyError;
use super::recording::{Believed, Recording};

/// Longest delay that is tried, s.
const LONGEST: f64 = 0.06;

/// Distances between the delays that are tried, s: over the whole range, then around the best.
const STEPS: [f64; 2] = [4e-3, 1e-3];

/// Returns the delay with the smallest squared distances.
///
/// # Errors
/// [`IdentifyError::Scenario`] if no delay can be tried.
pub fn search(recording: &Recording, believed: &Believed) -> Result<f64, IdentifyError> {
    let score = |latency: f64| {
        let mut believed = believed.clone();
        believed.model.radio_latency = latency;
        recording
            .filtered(&believed)
            .map(|filtered| filtered.squared_distances)
    };
    let (mut from, mut to) = (0.0, LONGEST);
    let mut best = believed.model.radio_latency;
    // The longest delays may be more than a filter remembers; one that cannot be tried at all tells why.
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
