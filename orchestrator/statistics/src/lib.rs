//! Samples of a sweep, and statistics of its results.
//!
//! * [`design`]: sample points of a sweep;
//! * [`distribution`]: the value of a parameter at a coordinate of such a point;
//! * [`interval`]: confidence intervals of a success rate, and the number of flights that a claim requires;
//! * [`quantile`]: quantiles of sorted values;
//! * [`student`]: half-widths of intervals with an estimated standard error;
//! * [`paired`]: comparison of two laws over the same samples;
//! * [`dkw`]: confidence band of an empirical distribution.
//!
//! All functions are pure functions of their arguments, including seeds, with the same bits on every machine:
//! random numbers are ChaCha8's, transcendental functions those of `libm`.

mod beta;
pub mod design;
pub mod distribution;
pub mod dkw;
pub mod interval;
mod normal;
pub mod paired;
pub mod quantile;
mod random;
pub mod student;

/// Panics unless 0 < confidence < 1.
fn assert_confidence(confidence: f64) {
    assert!(
        confidence > 0.0 && confidence < 1.0,
        "a confidence of {confidence} is not between 0 and 1"
    );
}
