//! Checks of the simulated cameras.

use super::Findings;
use super::envelope::check_box;
use crate::{Cameras, Key, MarkerSwap, Scenario, Volume};
use shared_types::service::seconds;
use shared_types::wiring::Topic;

impl Cameras {
    /// Checks everything except the jitter, which depends on the schedule.
    pub(super) fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        for (index, swap) in self.marker_swap.iter().enumerate() {
            swap.check(&at.then("marker_swap").then(index), found);
        }
        let spans = self.occlusion.iter().map(|event| (event.at, event.lasts));
        found.check_intervals(
            ["occlusion", "occlusions"],
            &at.then("occlusion"),
            spans,
            duration,
        );
        let spans = self.marker_swap.iter().map(|event| (event.at, event.lasts));
        let swaps = ["marker swap", "marker swaps"];
        found.check_intervals(swaps, &at.then("marker_swap"), spans, duration);
        if let Some(Volume { min, max }) = &self.volume {
            check_box([min, max], &at.then("volume"), found);
        }
    }
}

impl MarkerSwap {
    /// Checks everything except the times.
    fn check(&self, at: &Key, found: &mut Findings) {
        if self.position == [0.0; 3] && self.rotation == [0.0; 3] {
            found.add(
                at.clone(),
                "the marker swap changes nothing",
                "state the error of the pose as `position` or `rotation`, or leave the marker swap out",
            );
        }
    }
}

impl Scenario {
    /// Requires exposures in the order of the frames.
    pub(super) fn check_jitter(&self, cameras: &Cameras, key: &Key, found: &mut Findings) {
        let jitter = cameras.jitter;
        let Ok(schedule) = self.schedule() else { return };
        let period = seconds(schedule.time_ns(schedule.topic_rate(Topic::MocapPose).period));
        if jitter > period {
            found.add(
                key.clone(),
                format!("frames are exposed up to {jitter:?} s early, but their period is {period:?} s"),
                format!("lower `jitter` to {period:?} or less, or raise `schedule.period.\"mocap/pose\"`"),
            );
        }
    }
}
