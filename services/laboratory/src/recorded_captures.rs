//! Recorded captures in place of the simulated plant: the same captures at the same times since the start of the flight.
//!
//! The vehicle does not follow the commands of this flight. This tests the chain after the cameras, in real time and without
//! hardware: estimator, controller, radio link. `vehicle/truth` is never due: the recorded truth is not that of this flight.
//!
//! After the end of the recording the body is not tracked.

use std::path::Path;

use shared_types::samples::MocapPose;
use shared_types::service::{BuildError, ErasedService, InputView, OutputSlot, Outputs};
use shared_types::wiring::PlantOutputs;
use shared_types::{Now, ServiceId};

use run_log::LogReader;
use run_log::run_folder::log_meant_by;

/// Captures of a recorded flight.
pub(super) struct RecordedCaptures {
    /// Tracked captures, as published.
    captures: Vec<MocapPose>,
    /// Number of captures before the current time.
    passed: usize,
}

impl RecordedCaptures {
    /// Reads the captures of a log, or of the log in a run's folder.
    ///
    /// # Errors
    /// If the log cannot be read to its end, or has no tracked capture, with the fix.
    pub(super) fn open(recording: &Path) -> Result<Self, BuildError> {
        let log = log_meant_by(recording);
        let mut captures: Vec<MocapPose> = LogReader::open(&log)?.samples().collect::<Result<_, _>>()?;
        captures.retain(|capture| capture.tracked.is_set());
        if captures.is_empty() {
            let log = log.display();
            let reason = format!(
                "no capture in {log} has seen the vehicle; name another flight with `motion_capture.recording`"
            );
            return Err(reason.into());
        }
        Ok(Self { captures, passed: 0 })
    }
}

impl ErasedService for RecordedCaptures {
    fn id(&self) -> ServiceId {
        ServiceId::Plant
    }

    /// Publishes the newest capture that had been published by the time of the step, once.
    fn step(&mut self, now: &Now, _inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        let mut outputs = PlantOutputs::from_slots(outputs);
        let Some(sample) = outputs.pose.due() else { return };
        let published = |capture: &MocapPose| capture.header.stamp_ns <= now.time_ns;
        let passed = self.captures.partition_point(published);
        if passed > self.passed {
            *sample = MocapPose {
                header: sample.header,
                ..self.captures[passed - 1]
            };
            self.passed = passed;
        }
    }

    fn state_size(&self) -> usize {
        0
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        keep(&[]);
    }

    fn restore(&mut self, _bytes: &[u8]) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Operator;
    use shared_types::sample::Header;
    use zerocopy::{FromZeros, IntoBytes};

    /// Makes a capture that was published at a time, with an exposure 3 ns before.
    fn published_at(stamp_ns: u64) -> MocapPose {
        MocapPose {
            header: Header {
                stamp_ns,
                ..Header::new_zeroed()
            },
            capture_time_ns: stamp_ns - 3,
            tracked: true.into(),
            ..MocapPose::new_zeroed()
        }
    }

    /// Returns the exposure of the capture that is published at a time, ns.
    fn handed_on_at(cameras: &mut RecordedCaptures, time_ns: u64) -> Option<u64> {
        let mut pose = MocapPose::new_zeroed();
        let bytes = [None, Some(pose.as_mut_bytes()), None, None, None, None, None];
        let mut outputs = bytes.map(|bytes| OutputSlot { bytes });
        let now = Now {
            tick: time_ns,
            time_ns,
            elapsed_ns: 1,
            operator: Operator::FLYING,
        };
        cameras.step(&now, &[], &mut outputs);
        pose.tracked.is_set().then_some(pose.capture_time_ns)
    }

    #[test]
    fn each_capture_is_handed_on_once_when_it_was_published_and_of_several_the_newest() {
        let mut cameras = RecordedCaptures {
            captures: [10, 20, 30, 40].map(published_at).to_vec(),
            passed: 0,
        };
        let times = [5, 10, 11, 35, 39, 40, 50];
        let handed_on = times.map(|time| handed_on_at(&mut cameras, time));
        assert_eq!(handed_on, [None, Some(7), None, Some(27), None, Some(37), None]);
    }
}
