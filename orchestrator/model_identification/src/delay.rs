//! The time from the sending of a frame to its acting.
//!
//! The filter knows the commands, and each capture tells how far the vehicle is from where they should have brought it.
//! The sum of the squared Mahalanobis distances of the captures is smallest at the true delay. Captures that are later
//! than their stamps make the same difference: what is found is the delay between both.

use evaluation::reproduce::parallel;

use crate::IdentifyError;
use crate::recording::{Believed, Recording};
use crate::report::Quantity;

/// Longest delay that is tried, s.
const LONGEST: f64 = 0.06;

/// Distances between the delays that are tried, s: over the whole range, then around the best.
const STEPS: [f64; 3] = [4e-3, 1e-3, 2.5e-4];

/// Returns the delay with the smallest squared distances.
///
/// # Errors
/// [`IdentifyError::Scenario`] if no delay can be tried.
pub fn search(recording: &Recording, believed: &Believed) -> Result<Quantity, IdentifyError> {
    let score = |latency: f64| {
        let mut believed = believed.clone();
        believed.model.radio_latency = latency;
        recording
            .filtered(&believed)
            .map(|filtered| filtered.squared_distances)
    };
    let (mut from, mut to) = (0.0, LONGEST);
    let mut best = Quantity {
        stated: believed.model.radio_latency,
        found: believed.model.radio_latency,
        error: 0.0,
    };
    // The longest delays may be more than a filter remembers; one that cannot be tried at all tells why.
    score(best.found)?;
    for step in STEPS {
        let latencies = grid(from, to, step);
        let scores = parallel::map(&latencies, parallel::cores(), |&latency| {
            score(latency).unwrap_or(f64::INFINITY)
        });
        let least = (0..latencies.len())
            .min_by(|&one, &other| scores[one].total_cmp(&scores[other]))
            .unwrap_or(0);
        best.found = latencies[least];
        best.error = standard_error(&scores, least, step);
        (from, to) = ((best.found - step).max(0.0), best.found + step);
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

/// Returns the distance at which the parabola through the scores beside the least one is 1 above it, s: a standard error
/// if innovations are as the filter expects. At an end of the range it is the step.
fn standard_error(scores: &[f64], least: usize, step: f64) -> f64 {
    let beside = [least.checked_sub(1), Some(least + 1)].map(|index| scores.get(index?).copied());
    match beside {
        [Some(before), Some(after)] => {
            let curvature = (before + after - 2.0 * scores[least]) / (step * step);
            (2.0 / curvature.max(f64::MIN_POSITIVE))
                .sqrt()
                .clamp(0.5 * STEPS[2], LONGEST)
        }
        _ => step,
    }
}
