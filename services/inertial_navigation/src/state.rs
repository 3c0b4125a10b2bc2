//! State of the filter as a record, from which a restarted one continues bit by bit.

use shared_types::gnss::FixKind;
use shared_types::rotation::{from_row_major, to_row_major};
use shared_types::sample::Flag;
use zerocopy::FromZeros;

use crate::alignment::Alignment;
use crate::error_state::{Covariance, ERRORS, Transition};
use crate::filter::{ImuRecord, InertialFilter, Memory, QUEUE, QueuedMeasurement, RING, Rest, SourceStatus};
use crate::horizon::Horizon;
use crate::nominal::{Biases, Kinematics};

shared_types::sample! {
    /// Motion of the body's origin.
    pub struct KinematicsRecord {
        /// p, position in {I}, m.
        pub position_world: [f64; 3],
        /// V, velocity in {I}, m/s.
        pub velocity_world: [f64; 3],
        /// R, body to inertial, row-major.
        pub world_from_body: [f64; 9],
    }
}

shared_types::sample! {
    /// State of the filter from step to step.
    pub struct InertialState {
        /// Time of the horizon, ns since the start of the flight.
        pub time_ns: u64,
        /// Mean at the horizon: motion.
        pub kinematics: KinematicsRecord,
        /// b_g (rad/s), b_a (m/s²), b_m (G), e_p (m) and e_V (m/s).
        pub biases: [f64; 15],
        /// b_h, m.
        pub altitude_bias: f64,
        /// P, column by column.
        pub covariance: [f64; 625],
        /// h of the steps since P was carried, s.
        pub transition_time: f64,
        /// Φpθ, Φpg, Φpa, ΦVθ, ΦVg, ΦVa, Φθθ and Φθg of these steps, each row-major.
        pub transition: [f64; 72],
        /// The motion at present.
        pub present: KinematicsRecord,
        /// Samples of the inertial measurement unit after the horizon, oldest first.
        pub ring: [ImuRecord; 256],
        /// Number of these samples.
        pub count: u64,
        /// Measurements after the horizon, oldest first.
        pub queue: [QueuedMeasurement; 64],
        /// Number of these measurements.
        pub queued: u64,
        /// The newest sample.
        pub newest: ImuRecord,
        /// The alignment.
        pub alignment: Alignment,
        /// The vehicle at rest.
        pub rest: Rest,
        /// Time at which the motors have started, until the horizon has come there, ns since the start of the flight; then all ones.
        pub starts_ns: u64,
        /// What has become of the measurements of each source.
        pub sources: [SourceStatus; 9],
        /// Sum of the jumps of the position by resets in {I}, m.
        pub jump_world: [f64; 3],
        /// `true` if there is a horizon.
        pub is_aligned: Flag,
        /// `true` if the motors turn.
        pub motors_turn: Flag,
        /// Kind of the last fix, and one more; 0 before the first.
        pub kind: u8,
        /// Explicit padding.
        pub pad0: [u8; 5],
    }
}

// The record's arrays are written as numbers, for the message definition.
const _: () = assert!(RING == 256 && QUEUE == 64 && ERRORS * ERRORS == 625);

impl From<&Kinematics> for KinematicsRecord {
    fn from(kinematics: &Kinematics) -> Self {
        Self {
            position_world: kinematics.position_world.into(),
            velocity_world: kinematics.velocity_world.into(),
            world_from_body: to_row_major(&kinematics.world_from_body),
        }
    }
}

impl From<&KinematicsRecord> for Kinematics {
    fn from(record: &KinematicsRecord) -> Self {
        Self {
            position_world: record.position_world.into(),
            velocity_world: record.velocity_world.into(),
            world_from_body: from_row_major(&record.world_from_body),
        }
    }
}

impl InertialFilter {
    /// Returns the state as a record.
    #[must_use]
    pub fn save(&self) -> InertialState {
        let memory = &self.memory;
        let mut state = InertialState::new_zeroed();
        if let Some(horizon) = &memory.horizon {
            state.is_aligned = true.into();
            state.time_ns = horizon.time_ns;
            state.kinematics = (&horizon.kinematics).into();
            let Biases {
                gyroscope_body,
                accelerometer_body,
                field_body,
                fix_position_world,
                fix_velocity_world,
                altitude,
            } = &horizon.biases;
            let biases = [
                gyroscope_body,
                accelerometer_body,
                field_body,
                fix_position_world,
                fix_velocity_world,
            ];
            for (place, bias) in state.biases.chunks_exact_mut(3).zip(biases) {
                place.copy_from_slice(bias.as_slice());
            }
            state.altitude_bias = *altitude;
            state.covariance.copy_from_slice(horizon.covariance.as_slice());
            let Transition {
                h,
                position,
                velocity,
                attitude,
            } = &horizon.transition;
            state.transition_time = *h;
            let blocks = position.iter().chain(velocity).chain(attitude);
            for (place, block) in state.transition.chunks_exact_mut(9).zip(blocks) {
                place.copy_from_slice(&to_row_major(block));
            }
        }
        state.present = (&memory.present).into();
        for (index, record) in state.ring[..memory.count].iter_mut().enumerate() {
            *record = memory.ring[(memory.first + index) % RING];
        }
        state.count = memory.count as u64;
        state.queue[..memory.queued].copy_from_slice(&memory.queue[..memory.queued]);
        state.queued = memory.queued as u64;
        state.newest = memory.newest;
        state.alignment = memory.alignment;
        state.rest = memory.rest;
        state.sources = memory.sources;
        state.jump_world = memory.jump_world.into();
        state.motors_turn = memory.motors_turn.into();
        state.starts_ns = memory.starts_ns.unwrap_or(u64::MAX);
        state.kind = memory.kind.map_or(0, |kind| kind as u8 + 1);
        state
    }

    /// Restores a state.
    pub fn restore(&mut self, state: &InertialState) {
        let block = |index: usize| {
            let mut numbers = [0.0; 9];
            numbers.copy_from_slice(&state.transition[9 * index..9 * index + 9]);
            from_row_major(&numbers)
        };
        let bias = |index: usize| nalgebra::Vector3::from_row_slice(&state.biases[3 * index..3 * index + 3]);
        let horizon = Horizon {
            time_ns: state.time_ns,
            kinematics: (&state.kinematics).into(),
            biases: Biases {
                gyroscope_body: bias(0),
                accelerometer_body: bias(1),
                field_body: bias(2),
                fix_position_world: bias(3),
                fix_velocity_world: bias(4),
                altitude: state.altitude_bias,
            },
            covariance: Covariance::from_column_slice(&state.covariance),
            transition: Transition {
                h: state.transition_time,
                position: [0, 1, 2].map(block),
                velocity: [3, 4, 5].map(block),
                attitude: [6, 7].map(block),
            },
        };
        let bounded = |count: u64, most: usize| usize::try_from(count).unwrap_or(most).min(most);
        self.memory = Memory {
            ring: state.ring,
            first: 0,
            count: bounded(state.count, RING),
            queue: state.queue,
            queued: bounded(state.queued, QUEUE),
            newest: state.newest,
            alignment: state.alignment,
            horizon: state.is_aligned.is_set().then_some(horizon),
            present: (&state.present).into(),
            rest: state.rest,
            motors_turn: state.motors_turn.is_set(),
            starts_ns: Some(state.starts_ns).filter(|&starts| starts != u64::MAX),
            kind: FixKind::ALL
                .into_iter()
                .find(|kind| *kind as u8 + 1 == state.kind),
            sources: state.sources,
            jump_world: state.jump_world.into(),
        };
    }
}
