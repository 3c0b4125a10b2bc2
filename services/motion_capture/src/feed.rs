//! Feed: from frames to accepted poses of the vehicle.
//!
//! Failure policy: a pose is accepted only if its frame is new, its time is known, its body is the vehicle's and tracked,
//! and the vehicle can have reached it since the last accepted pose. All others are counted by reason
//! ([`CaptureFigures`]). If one part of a pose is wrong or frozen, the other part is used alone, and the pose is counted by
//! reason. Without an accepted pose there is no output: missing poses never look like a vehicle at rest.

mod memory;
mod numbering;
mod stillness;
mod track;

use std::cmp::Ordering;

use scenario::{CaptureSystem, MotionCapture, Problem};
use shared_types::capture_figures::CaptureFigures;
use shared_types::rotation::to_row_major;
use shared_types::samples::MocapPose;
use shared_types::service::nanoseconds;
use zerocopy::FromZeros;

pub use memory::FeedMemory;
pub use stillness::PosePart;
pub use track::Bounds;

use crate::clock::{Mapped, RemoteClock};
use crate::conventions::{Calibration, WorldPose};
use crate::figures::Figures;
use crate::frame_clock::FrameClock;
use crate::wire::{Frame, MAX_NAME_LENGTH, Name, Stamp, WireBody};
use numbering::{Numbering, Order};
use stillness::Stillness;
use track::{PoseDecision, Tracks};

/// Maximum lead of a pose's capture time over its arrival, ns: an error of the clock estimate.
const FUTURE_NS: u64 = 1_000_000;
/// Maximum age of a pose on arrival, ns.
const MAX_AGE_NS: u64 = 1_000_000_000;
/// Consecutive frames with a rejected stamp after which the period of frames is measured again.
const MAX_REJECTED: u32 = 100;

/// Selector of the vehicle's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selector {
    name: Name,
    number: Option<i32>,
}

impl Selector {
    /// Makes the selector of a scenario.
    ///
    /// # Errors
    /// If the scenario was not checked.
    pub fn new(system: CaptureSystem, config: &MotionCapture) -> Result<Self, Problem> {
        let invalid = |reason: &str| {
            let key = ["motion_capture", "object"].into_iter().collect();
            Problem::new(key, reason, "write it as `quad`, `#7` or `quad#1`")
        };
        let (name, number) = config
            .name_and_number()
            .ok_or_else(|| invalid("there is no number after the #"))?;
        let name = Name::new(name.as_bytes())
            .map_err(|_| invalid(&format!("a name longer than {MAX_NAME_LENGTH} bytes")))?;
        let number = number.or(system.properties().numbers.unstated());
        Ok(Self { name, number })
    }

    /// Returns whether a body is the vehicle.
    #[must_use]
    pub fn matches(&self, body: &WireBody) -> bool {
        (self.name == Name::EMPTY || self.name == body.name)
            && self.number.is_none_or(|number| number == body.number)
    }
}

/// Accepted pose of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehiclePose {
    /// Time of the capture, ns of the local clock.
    pub captured_ns: u64,
    /// Time of the arrival, ns of the local clock.
    pub arrived_ns: u64,
    /// The pose.
    pub pose: WorldPose,
    /// The valid parts of the pose.
    pub parts: PoseParts,
}

/// Valid parts of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseParts {
    /// Position and attitude.
    Both,
    /// Position only.
    Position,
    /// Attitude only.
    Attitude,
}

impl VehiclePose {
    /// Writes the pose into a sample, except for its header, with times since the start of the flight.
    pub fn write(&self, flight_start_ns: u64, sample: &mut MocapPose) {
        sample.capture_time_ns = self.captured_ns.saturating_sub(flight_start_ns);
        sample.position_world = self.pose.position_world.into();
        sample.world_from_body = to_row_major(&self.pose.world_from_body);
        sample.velocity_body = [0.0; 3];
        sample.angular_velocity_body = [0.0; 3];
        sample.tracked = true.into();
        sample.velocities_measured = false.into();
        sample.set_parts(
            self.parts != PoseParts::Attitude,
            self.parts != PoseParts::Position,
        );
    }
}

/// Condition of the feed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Health {
    /// No frame received yet.
    Silent,
    /// No frame has contained the vehicle's body yet.
    Absent,
    /// No pose accepted yet.
    Settling,
    /// Poses are accepted.
    Good,
    /// No pose accepted for two periods of the slowest stated rate.
    Doubtful,
}

/// Filter from a capture system's frames to poses of the vehicle.
#[derive(Clone, Debug)]
pub struct Feed {
    selector: Selector,
    calibration: Calibration,
    latency_ns: u64,
    clock: RemoteClock,
    frame_clock: FrameClock,
    /// Consecutive frames with a rejected stamp.
    rejected: u32,
    numbering: Numbering,
    tracks: Tracks,
    figures: Figures,
    counts: CaptureFigures,
    last_stamp_ns: i64,
    stillness: Stillness,
    frozen: Option<PosePart>,
    /// Arrival of the last frame, ns of the local clock; 0 before the first.
    received_at_ns: u64,
    /// Arrival of the last accepted pose, ns of the local clock.
    accepted_at_ns: u64,
    /// Time without an accepted pose after which the feed is doubtful, ns.
    timeout_ns: u64,
    health: Health,
}

impl Feed {
    /// Makes the feed of a checked scenario.
    ///
    /// # Errors
    /// If the scenario was not checked.
    pub fn new(system: CaptureSystem, config: &MotionCapture) -> Result<Self, Problem> {
        let calibration = Calibration::new(
            system,
            config.world_from_capture.as_ref(),
            config.body_from_markers.as_ref(),
        );
        Ok(Self {
            selector: Selector::new(system, config)?,
            calibration,
            latency_ns: nanoseconds(config.latency.unwrap_or(system.properties().latency)),
            clock: RemoteClock::new(),
            frame_clock: FrameClock::default(),
            rejected: 0,
            numbering: Numbering::default(),
            tracks: Tracks::new(Bounds {
                max_speed: config.max_speed,
                max_turn_rate: config.max_turn_rate,
                settle_ns: nanoseconds(config.settle),
            }),
            figures: Figures::new(config.rate),
            counts: CaptureFigures::new_zeroed(),
            last_stamp_ns: i64::MIN,
            stillness: Stillness::new(&calibration.world_from_capture),
            frozen: None,
            received_at_ns: 0,
            accepted_at_ns: 0,
            timeout_ns: nanoseconds(2.0 / config.rate[0]),
            health: Health::Silent,
        })
    }

    /// Returns the counters since the start; other figures are zero. Each frame counts once: as believed, or for one reason
    /// of its refusal.
    #[must_use]
    pub fn counts(&self) -> &CaptureFigures {
        &self.counts
    }

    /// Returns rate, latency and jitter.
    #[must_use]
    pub fn figures(&self) -> &Figures {
        &self.figures
    }

    /// Returns the condition of the feed.
    #[must_use]
    pub fn health(&self) -> Health {
        self.health
    }

    /// Returns the frozen part of the vehicle's last pose.
    #[must_use]
    pub fn frozen_part(&self) -> Option<PosePart> {
        self.frozen
    }

    /// Returns the rate at which the local clock gains on the sender's, s/s.
    #[must_use]
    pub fn drift(&self) -> f64 {
        self.clock.drift()
    }

    /// Processes a frame with its arrival time (ns of the local clock, never decreasing). Returns the vehicle's pose if at
    /// least a part of it is accepted.
    pub fn accept(&mut self, frame: &Frame, arrived_ns: u64) -> Option<VehiclePose> {
        let vehicle = frame.bodies().iter().position(|body| self.selector.matches(body));
        if self.health == Health::Silent {
            self.health = Health::Absent;
        }
        if vehicle.is_none() && !frame.is_complete {
            // A packet of another body is only needed to detect an exchange with the vehicle.
            self.track_others(frame, None, arrived_ns);
            return None;
        }
        self.counts.frames += 1;
        self.received_at_ns = arrived_ns;
        let pose = self.process(frame, vehicle, arrived_ns);
        match (&pose, self.health) {
            (Some(pose), _) if pose.parts == PoseParts::Both => {
                self.accepted_at_ns = pose.arrived_ns;
                self.health = Health::Good;
            }
            (_, Health::Good) if arrived_ns.saturating_sub(self.accepted_at_ns) > self.timeout_ns => {
                self.health = Health::Doubtful;
            }
            (_, Health::Absent) if vehicle.is_some() => self.health = Health::Settling,
            _ => {}
        }
        pose
    }

    /// Returns the vehicle's pose in a frame, if its time is known and it is accepted.
    fn process(&mut self, frame: &Frame, vehicle: Option<usize>, arrived_ns: u64) -> Option<VehiclePose> {
        if !self.is_new(frame) {
            return None;
        }
        self.figures.add_arrival(arrived_ns, &mut self.counts);
        let captured_ns = self.captured_ns(frame, arrived_ns)?;
        let pose = self.judge(frame, vehicle, captured_ns);
        self.track_others(frame, vehicle, captured_ns);
        let (pose, parts) = pose?;
        if parts == PoseParts::Both {
            self.counts.believed += 1;
            self.figures.add_latency(arrived_ns.saturating_sub(captured_ns));
        }
        Some(VehiclePose {
            captured_ns,
            arrived_ns,
            pose,
            parts,
        })
    }

    /// Returns whether a frame is newer than all previous ones.
    fn is_new(&mut self, frame: &Frame) -> bool {
        match frame.number.map(|number| self.numbering.classify(number)) {
            Some(Order::Next { lost }) => self.counts.lost += u64::from(lost),
            Some(Order::Repeated) => {
                self.counts.repeated += 1;
                return false;
            }
            Some(Order::Late) => {
                self.counts.late += 1;
                return false;
            }
            Some(Order::Restarted) => self.counts.restarted += 1,
            None => {}
        }
        true
    }

    /// Returns the capture time of a frame, ns of the local clock; `None` if it is not known.
    fn captured_ns(&mut self, frame: &Frame, arrived_ns: u64) -> Option<u64> {
        let stamp = match (frame.stamp, frame.number) {
            (Some(stamp), _) => stamp,
            (None, Some(number)) => self.stamp_of_number(number, arrived_ns)?,
            // The body is not tracked.
            (None, None) => return Some(arrived_ns.saturating_sub(self.latency_ns)),
        };
        match self.clock.map(stamp.sent_ns, arrived_ns) {
            Mapped::At(sent_ns) => {
                self.rejected = 0;
                self.captured_in_order(stamp, sent_ns, arrived_ns)
            }
            Mapped::Collecting => {
                self.counts.unsettled += 1;
                None
            }
            Mapped::Rejected => {
                self.counts.mistimed += 1;
                self.rejected += 1;
                None
            }
            Mapped::Stepped => {
                self.counts.clock_steps += 1;
                self.last_stamp_ns = i64::MIN;
                None
            }
        }
    }

    /// Returns the stamp of a frame that has only a number.
    fn stamp_of_number(&mut self, number: u32, arrived_ns: u64) -> Option<Stamp> {
        if self.rejected > MAX_REJECTED {
            // The rate of the sender has changed.
            self.frame_clock = FrameClock::default();
            self.rejected = 0;
        }
        let Some(stamp_ns) = self.frame_clock.stamp(number, arrived_ns) else {
            self.counts.unsettled += 1;
            return None;
        };
        Some(Stamp {
            exposed_ns: stamp_ns,
            sent_ns: stamp_ns,
        })
    }

    /// As [`Feed::captured_ns`], for a frame that was sent at `sent_ns` of the local clock. Checks the order of the stamps,
    /// which also covers frames without numbers.
    fn captured_in_order(&mut self, stamp: Stamp, sent_ns: i64, arrived_ns: u64) -> Option<u64> {
        match stamp.exposed_ns.cmp(&self.last_stamp_ns) {
            Ordering::Greater => {}
            Ordering::Equal => {
                self.counts.repeated += 1;
                return None;
            }
            Ordering::Less => {
                self.counts.late += 1;
                return None;
            }
        }
        let aged_ns = stamp.sent_ns.saturating_sub(stamp.exposed_ns);
        let latency_ns = i64::try_from(self.latency_ns).unwrap_or(i64::MAX);
        let captured_ns = sent_ns.saturating_sub(aged_ns).saturating_sub(latency_ns);
        let captured_ns = u64::try_from(captured_ns)
            .ok()
            .filter(|&at_ns| aged_ns >= 0 && at_ns <= arrived_ns.saturating_add(FUTURE_NS));
        if captured_ns.is_none_or(|at_ns| arrived_ns.saturating_sub(at_ns) > MAX_AGE_NS) {
            self.counts.mistimed += 1;
            return None;
        }
        self.last_stamp_ns = stamp.exposed_ns;
        captured_ns.map(|at_ns| at_ns.min(arrived_ns))
    }

    /// Returns the vehicle's pose in a frame with its accepted parts, if any.
    fn judge(
        &mut self,
        frame: &Frame,
        vehicle: Option<usize>,
        captured_ns: u64,
    ) -> Option<(WorldPose, PoseParts)> {
        let Some(index) = vehicle else {
            self.counts.absent += 1;
            return None;
        };
        let body = &frame.bodies()[index];
        let Some(captured) = &body.pose else {
            self.counts.occluded += 1;
            return None;
        };
        let pose = self.calibration.world_pose(captured);
        let (position, rotation) = (&captured.position, &captured.capture_from_markers);
        self.frozen = self.stillness.update(captured);
        if let Some(frozen) = self.frozen {
            self.counts.frozen += 1;
            let parts = frozen.remaining_parts()?;
            let follows = match parts {
                PoseParts::Position => self.tracks.follow_position(position, captured_ns),
                _ => self.tracks.follow_attitude(rotation, captured_ns),
            };
            return follows.then_some((pose, parts));
        }
        let counter = match self.tracks.add_vehicle(position, rotation, captured_ns) {
            PoseDecision::Follows => return Some((pose, PoseParts::Both)),
            PoseDecision::Settled => {
                self.counts.settled += 1;
                return Some((pose, PoseParts::Both));
            }
            PoseDecision::Turned => {
                self.counts.jumped += 1;
                return Some((pose, PoseParts::Position));
            }
            PoseDecision::Unsettled => &mut self.counts.unsettled,
            PoseDecision::Jumped => &mut self.counts.jumped,
            PoseDecision::Exchanged => &mut self.counts.exchanged,
        };
        *counter += 1;
        None
    }

    fn track_others(&mut self, frame: &Frame, vehicle: Option<usize>, at_ns: u64) {
        for (index, body) in frame.bodies().iter().enumerate() {
            if Some(index) != vehicle
                && !self.selector.matches(body)
                && let Some(pose) = &body.pose
            {
                self.tracks
                    .add_other(index, body, &pose.position, &pose.capture_from_markers, at_ns);
            }
        }
    }
}

#[cfg(test)]
mod tests;
