//! What the estimator should believe of the markers, the delay and the cameras' noise, from a log.
//!
//! These three break a laboratory soonest: markers that do not sit in the centre of mass, frames that act later than
//! believed, and cameras that scatter more than stated. None of them shows in the vehicle's own state.
//!
//! * [`recording`]: the poses and frames of a log, in the order in which the estimator has them;
//! * [`noise`]: the scatter of the captures, from their third differences, which smooth motion hardly has;
//! * [`delay`]: roughly, the time from the sending of a frame to its acting that makes the filter's innovations smallest;
//! * [`refine`]: from there the marker offset and the delay, with intervals;
//! * [`report`]: what was found beside what the scenario states, and the lines to put into it.

pub mod delay;
pub mod noise;
pub mod recording;
pub mod refine;
pub mod report;

use run_log::LogReadError;

use recording::Recording;
use report::{Identification, MARKER_OFFSET_DEVIATION, Quantity};

/// Reason why nothing can be identified.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The log cannot be read.
    #[error("{0}")]
    Log(#[from] LogReadError),
    /// The flight had no filter.
    #[error(
        "the flight had no `[estimator.kalman]`: its cameras were ideal, and there is nothing to identify; fly a \
         laboratory's scenario such as scenarios/fig3_6.toml"
    )]
    NoFilter,
    /// There are too few captures or frames.
    #[error(
        "the log has {captures} captures of the vehicle and {frames} frames: fly a figure for twenty seconds at least"
    )]
    TooShort {
        /// Captures that show the vehicle.
        captures: usize,
        /// Frames of the radio link.
        frames: usize,
    },
    /// Too little of the flight counts.
    #[error(
        "only {counted} s of the flight count, and intervals that hold need twelve: fly for longer; the first two do not \
         count, nor do the five around a change of mass"
    )]
    TooFewSeconds {
        /// Seconds with captures, without those that the filter settles in.
        counted: usize,
    },
    /// The scenario of the log gives no filter.
    #[error("the scenario of the log gives no filter: {0}")]
    Scenario(scenario::Problem),
}

/// Identifies marker offset, delay and noise of a flight.
///
/// # Errors
/// [`IdentifyError`].
pub fn identify(recording: &Recording) -> Result<Identification, IdentifyError> {
    let stated = recording.believed();
    let [position, attitude] = noise::of_captures(recording.poses());
    let mut believed = stated.clone();
    believed.kalman.position_deviation = position.found;
    believed.kalman.attitude_deviation = attitude.found;
    believed.kalman.marker_offset_deviation = MARKER_OFFSET_DEVIATION;
    believed.kalman.marker_offset_drift = 0.0;
    let delay = delay::search(recording, &believed)?;
    believed.model.radio_latency = delay;
    let filter = recording.filtered(&believed)?.filter;
    let state = filter.state().ok_or(IdentifyError::TooShort {
        captures: 0,
        frames: 0,
    })?;
    believed.model.marker_offset = state.nominal.marker_offset_body.into();
    let (marker_offset, radio_latency) = refine::beside(&stated, &refine::refine(recording, &believed)?);
    Ok(Identification {
        marker_offset,
        radio_latency,
        position_deviation: Quantity {
            stated: stated.kalman.position_deviation,
            ..position
        },
        attitude_deviation: Quantity {
            stated: stated.kalman.attitude_deviation,
            ..attitude
        },
    })
}

#[cfg(test)]
mod tests;
