//! Samples of a sweep, and what can be said of its results.
//!
//! * [`design`]: the points of a sample space at which a sweep flies;
//! * [`distribution`]: the value of a parameter at a coordinate of such a point;
//! * [`interval`]: what a number of successes says of the success rate, and the number of flights that a claim needs;
//! * [`quantile`]: quantiles of sorted values;
//! * [`student`]: the half-width of an interval whose standard error was estimated;
//! * [`paired`]: two laws compared over the same samples;
//! * [`dkw`]: the band around an empirical distribution.
//!
//! All of it is a pure function of its arguments, seeds among them, and gives the same bits on every machine:
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

/// Panics unless a confidence can be reached and says something: 0 < confidence < 1.
fn assert_confidence(confidence: f64) {
    assert!(
        confidence > 0.0 && confidence < 1.0,
        "a confidence of {confidence} is not between 0 and 1"
    );
}
