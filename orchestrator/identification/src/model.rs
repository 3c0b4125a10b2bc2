//! Identification of the estimator's marker offset, delay and camera noise from a log.
//!
//! Errors of these three are the most critical in a laboratory: markers away from the centre of mass, frames that act later than
//! modelled, and cameras noisier than stated. None of them is visible in the estimated state.
//!
//! * [`recording`]: the poses and frames of a log, in their order of arrival at the estimator;
//! * [`noise`]: noise of the captures, from their third differences, in which smooth motion is negligible;
//! * [`delay`]: coarse search for the delay from sending a frame to its effect that minimises the filter's innovations;
//! * [`refine`]: marker offset and delay from that start, with intervals;
//! * [`answer`]: the whole delay from a command to its answer in the captures, and its parts;
//! * [`report`]: the found values beside the stated ones, and the lines to put into the scenario.

pub mod answer;
pub mod delay;
pub mod noise;
pub mod recording;
pub mod refine;
pub mod report;

use run_log::LogReadError;

use recording::Recording;
use report::{Identification, MARKER_OFFSET_DEVIATION, Quantity};

/// Reason why a laboratory cannot be identified.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The log cannot be read.
    #[error("{0}")]
    Log(#[from] LogReadError),
    /// The flight had no Kalman filter.
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
    /// The usable part of the flight is too short.
    #[error(
        "only {counted} s of the flight are usable, and valid intervals need twelve: fly for longer; the first two do not \
         count, nor do the five around a change of mass"
    )]
    TooFewSeconds {
        /// Seconds with captures, without the settling time of the filter.
        counted: usize,
    },
    /// The filter cannot be made from the scenario of the log.
    #[error("the filter cannot be made from the scenario of the log: {0}")]
    Scenario(scenario::Problem),
}

/// Identifies marker offset, delay and noise of a flight.
///
/// # Errors
/// [`IdentifyError`].
pub fn identify(recording: &Recording) -> Result<Identification, IdentifyError> {
    let stated = recording.stated_settings();
    let [position, attitude] = noise::from_captures(recording.poses());
    let mut settings = stated.clone();
    settings.kalman.position_deviation = position.found;
    settings.kalman.attitude_deviation = attitude.found;
    settings.kalman.marker_offset_deviation = MARKER_OFFSET_DEVIATION;
    settings.kalman.marker_offset_drift = 0.0;
    let delay = delay::search(recording, &settings)?;
    settings.model.radio_latency = delay;
    let filter = recording.filtered(&settings)?.filter;
    let state = filter.state().ok_or(IdentifyError::TooShort {
        captures: 0,
        frames: 0,
    })?;
    settings.model.marker_offset = state.nominal.marker_offset_body.into();
    let refined = refine::refine(recording, &settings)?;
    let (marker_offset, effective_delay) = refine::beside(&stated, &refined);
    Ok(Identification {
        rehearsal: recording.rehearsal(),
        is_late: recording.is_late,
        answer: refined.answer(recording, &stated),
        marker_offset,
        effective_delay,
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
