//! Saved state of a feed, so that a restarted driver resumes with the clock and the pose of its predecessor.
//!
//! The driver runs on the same machine and receives from the same server, so the clock line is still valid, and the
//! vehicle is within reach of its last pose. Errors are handled as in a feed that never stopped: packets that disagree
//! restart the clock estimate, and poses out of reach must settle. A state with invalid numbers is not used.

use nalgebra::Matrix3;
use shared_types::rotation::{defect, from_row_major, to_row_major};
use shared_types::sample::{Field, Flag};

use super::Feed;
use super::numbering::Numbering;
use super::track::{Candidate, PoseDecision, TimedPose};
use crate::clock::{ClockLine, RemoteClock};
use crate::frame_clock::FrameClock;
use crate::wire::CapturePose;

/// Maximum age of a saved state, ns.
const MAX_AGE_NS: u64 = 2_000_000_000;
/// Maximum distance from SO(3) of a rotation: single precision passes.
const ATTITUDE_DEFECT: f64 = 1e-3;

shared_types::sample! {
    /// Memory of a feed. Times are of the local clock.
    pub struct FeedMemory {
        /// Arrival of the last frame, ns; 0 before the first.
        pub heard_at_ns: u64,
        /// Arrival of the packet through which the clock's line goes, ns.
        pub arrived_ns: u64,
        /// Its arrival minus its stamp, ns.
        pub offset_ns: i64,
        /// Rate at which the local clock gains on the sender's.
        pub slope: f64,
        /// Time between two frames of a sender that does not stamp them, ns; 0 while it is not known.
        pub period_ns: f64,
        /// Stamp that its newest frame was given, ns.
        pub given_stamp_ns: i64,
        /// Exposure of the newest frame by the sender's clock, ns.
        pub last_stamp_ns: i64,
        /// Capture of the last accepted position, ns.
        pub at_ns: u64,
        /// Capture of the last accepted rotation, ns.
        pub turned_at_ns: u64,
        /// Its position in the system's frame, m.
        pub position: [f64; 3],
        /// Its rotation from the markers' frame to the system's, row-major.
        pub rotation: [f64; 9],
        /// Position of the last pose, also if it was refused, in the system's frame, m.
        pub seen_position: [f64; 3],
        /// Its rotation from the markers' frame to the system's, row-major.
        pub seen_rotation: [f64; 9],
        /// Number of the newest frame.
        pub number: u32,
        /// Number of the frame that was given the stamp.
        pub given_to: u32,
        /// Capture of the newest of the poses that are not accepted yet, ns.
        pub candidate_at_ns: u64,
        /// Capture of the first of them, ns.
        pub candidate_since_ns: u64,
        /// Position of the newest in the system's frame, m.
        pub candidate_position: [f64; 3],
        /// Its rotation from the markers' frame to the system's, row-major.
        pub candidate_rotation: [f64; 9],
        /// `true` if the clock's line is known.
        pub is_timed: Flag,
        /// `true` if frames have numbers.
        pub is_numbered: Flag,
        /// `true` if a pose was accepted.
        pub is_tracked: Flag,
        /// `true` if a pose has come.
        pub is_seen: Flag,
        /// Frames in a row in which x, y, z and the heading have stood still alone.
        pub still_for: [u8; 4],
        /// Why poses are not accepted yet, by its place in [`VERDICTS`] from 1 on; 0 if there are none.
        pub candidate_verdict: u8,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

impl Feed {
    /// Returns the state.
    #[must_use]
    pub fn save(&self) -> FeedMemory {
        let line = self.clock.line();
        let (given_to, given_stamp_ns, period_ns) = self.frame_clock.newest().unwrap_or_default();
        let accepted = self.tracks.accepted();
        let number = self.numbering.newest();
        let seen = self.stillness.last.as_ref();
        let candidate = self.tracks.candidate();
        let newest = candidate.map(|candidate| &candidate.newest);
        FeedMemory {
            heard_at_ns: self.received_at_ns,
            arrived_ns: line.map_or(0, |line| line.arrived_ns),
            offset_ns: line.map_or(0, |line| line.offset_ns),
            slope: line.map_or(0.0, |line| line.slope),
            period_ns,
            given_stamp_ns,
            given_to,
            last_stamp_ns: self.last_stamp_ns,
            at_ns: accepted.map_or(0, |pose| pose.at_ns),
            turned_at_ns: accepted.map_or(0, |pose| pose.turned_at_ns),
            position: accepted.map_or([0.0; 3], |pose| pose.position.into()),
            rotation: to_row_major(&accepted.map_or(Matrix3::identity(), |pose| pose.rotation)),
            seen_position: seen.map_or([0.0; 3], |seen| seen.position.into()),
            seen_rotation: to_row_major(&seen.map_or(Matrix3::identity(), |seen| seen.capture_from_markers)),
            candidate_at_ns: newest.map_or(0, |newest| newest.at_ns),
            candidate_since_ns: candidate.map_or(0, |candidate| candidate.since_ns),
            candidate_position: newest.map_or([0.0; 3], |newest| newest.position.into()),
            candidate_rotation: to_row_major(&newest.map_or(Matrix3::identity(), |newest| newest.rotation)),
            candidate_verdict: candidate.map_or(0, |candidate| decision_number(candidate.decision)),
            pad0: [0; 7],
            still_for: self.stillness.still_for,
            is_seen: seen.is_some().into(),
            number: number.unwrap_or(0),
            is_timed: line.is_some().into(),
            is_numbered: number.is_some().into(),
            is_tracked: accepted.is_some().into(),
        }
    }

    /// Restores a state at a time of the local clock, ns, unless it is too old or invalid.
    pub fn restore(&mut self, memory: &FeedMemory, now_ns: u64) {
        let is_recent = memory.heard_at_ns != 0 && now_ns.saturating_sub(memory.heard_at_ns) <= MAX_AGE_NS;
        if !is_recent || !is_valid(memory) {
            return;
        }
        self.received_at_ns = memory.heard_at_ns;
        self.last_stamp_ns = memory.last_stamp_ns;
        if memory.is_timed.is_set() {
            self.clock = RemoteClock::with_line(ClockLine {
                arrived_ns: memory.arrived_ns,
                offset_ns: memory.offset_ns,
                slope: memory.slope,
            });
        }
        if memory.is_numbered.is_set() {
            self.numbering = Numbering::after(memory.number);
        }
        if memory.period_ns > 0.0 {
            self.frame_clock = FrameClock::after(memory.given_to, memory.given_stamp_ns, memory.period_ns);
        }
        let accepted = memory.is_tracked.is_set().then(|| TimedPose {
            position: memory.position.into(),
            rotation: from_row_major(&memory.rotation),
            at_ns: memory.at_ns,
            turned_at_ns: memory.turned_at_ns,
        });
        let candidate = decision_of_number(memory.candidate_verdict).map(|decision| Candidate {
            newest: TimedPose {
                position: memory.candidate_position.into(),
                rotation: from_row_major(&memory.candidate_rotation),
                at_ns: memory.candidate_at_ns,
                turned_at_ns: memory.candidate_at_ns,
            },
            since_ns: memory.candidate_since_ns,
            decision,
        });
        self.tracks.restore(accepted, candidate);
        if memory.is_seen.is_set() {
            self.stillness.last = Some(CapturePose {
                position: memory.seen_position.into(),
                capture_from_markers: from_row_major(&memory.seen_rotation),
            });
            self.stillness.still_for = memory.still_for;
        }
    }
}

/// Decisions on poses that are not accepted, in the order of `candidate_verdict`.
const DECISIONS: [PoseDecision; 4] = [
    PoseDecision::Unsettled,
    PoseDecision::Turned,
    PoseDecision::Jumped,
    PoseDecision::Exchanged,
];

fn decision_number(decision: PoseDecision) -> u8 {
    (1..)
        .zip(DECISIONS)
        .find(|(_, other)| *other == decision)
        .map_or(0, |(number, _)| number)
}

fn decision_of_number(number: u8) -> Option<PoseDecision> {
    DECISIONS.get(usize::from(number.checked_sub(1)?)).copied()
}

/// Returns whether a state has finite numbers and valid rotations.
fn is_valid(memory: &FeedMemory) -> bool {
    memory.is_finite()
        && [
            &memory.rotation,
            &memory.seen_rotation,
            &memory.candidate_rotation,
        ]
        .into_iter()
        .all(|rotation| defect(&from_row_major(rotation)) <= ATTITUDE_DEFECT)
}
