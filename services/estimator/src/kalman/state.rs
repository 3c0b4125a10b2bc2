//! Filter state as a record, from which a restarted estimator resumes bit for bit.

use shared_types::rotation::{from_row_major, to_row_major};
use shared_types::sample::Flag;
use zerocopy::FromZeros;

use super::attitude_trust::AttitudeTrust;
use super::commands::{CAPACITY, Command, CommandHistory};
use super::error_state::{Covariance, ERRORS};
use super::filter::{KalmanFilter, PersistentState, Track};
use super::filter_state::{FilterState, Pose, PoseNoise};
use super::ground_contact::{Ground, Rest};
use super::motion::{Actuation, NominalState};
use super::scatter::Scatter;

shared_types::sample! {
    /// Nominal state of a vehicle.
    pub struct NominalRecord {
        /// p, position in {I}, m.
        pub position_world: [f64; 3],
        /// v, linear velocity in {I}, m/s.
        pub velocity_world: [f64; 3],
        /// R, body to inertial, row-major.
        pub world_from_body: [f64; 9],
        /// ω_bias in {B}, rad/s.
        pub rate_bias_body: [f64; 3],
        /// d in {I}, m/s².
        pub disturbance_world: [f64; 3],
        /// r in {B}, m.
        pub marker_offset_body: [f64; 3],
        /// T̂, N.
        pub thrust: f64,
        /// ω̂ in {B}, rad/s.
        pub rates_body: [f64; 3],
    }
}

shared_types::sample! {
    /// Memory of the filter from step to step.
    pub struct KalmanState {
        /// The time that the state speaks of, ns since the start of the flight.
        pub time_ns: u64,
        /// Time at which a position was used last, ns since the start of the flight.
        pub used_at_ns: u64,
        /// Time at which an attitude was used last, ns since the start of the flight.
        pub levelled_at_ns: u64,
        /// Exposure of the first of the captures refused in a row, ns since the start of the flight.
        pub refused_since_ns: u64,
        /// Time since which all frames have stopped the motors, ns since the start of the flight.
        pub rests_since_ns: u64,
        /// Time from which the newest frame with body rates acts, ns since the start of the flight; all ones for none.
        pub rates_stated_ns: u64,
        /// The nominal state.
        pub nominal: NominalRecord,
        /// P, covariance of (δp, δv, θ, δω_bias, δd, δr), column by column.
        pub covariance: [f64; 324],
        /// Mean of the variances that captures have shown of the position (m²) and the attitude (rad²).
        pub scatter: [f64; 2],
        /// Innovation of the capture before: position, m, and attitude, rad.
        pub innovation: [f64; 6],
        /// Exposure from which on attitudes settle before they are tested, ns since the start of the flight.
        pub settling_since_ns: u64,
        /// Time from which on frames have stated the body rates without a gap, ns since the start of the flight.
        pub turn_known_from_ns: u64,
        /// R_captured R_estimatedᵀ of the last trusted capture, row-major.
        pub captured_from_estimated: [f64; 9],
        /// Time of the last trusted capture, ns since the start of the flight.
        pub trusted_ns: u64,
        /// Time of the last capture, trusted or not, ns since the start of the flight.
        pub tested_ns: u64,
        /// Longest time since the last trusted capture in which the body was not seen, ns; 0 while no capture has followed it.
        pub unseen_ns: u64,
        /// The commands that act or are under way, oldest first.
        pub commands: [Command; 64],
        /// Number of these commands.
        pub command_count: u64,
        /// Captures refused since the start of the flight.
        pub captures_refused: u32,
        /// `true` if there is a state.
        pub started: Flag,
        /// `true` if the last tested capture was refused.
        pub refusing: Flag,
        /// `true` if all recent frames stop the motors.
        pub rests: Flag,
        /// `true` if the ground holds the vehicle.
        pub stands: Flag,
        /// z of the tracked point where the vehicle last stood before it flew, in {I}, m.
        pub stood_z: f64,
        /// Exposure of the capture since which the vehicle is compared with one at rest, ns since the start of the flight.
        pub rest_since_ns: u64,
        /// Position of that capture in {I}, m.
        pub rest_position_world: [f64; 3],
        /// Attitude of that capture, row-major.
        pub rest_world_from_body: [f64; 9],
        /// Time of the vehicle in free flight since then, ns since the start of the flight.
        pub free_ns: u64,
        /// That vehicle.
        pub free: NominalRecord,
        /// Captures that have shown the vehicle at rest since then; all ones once it is seen to move.
        pub rest_captures: u32,
        /// `true` if the vehicle has flown since it stood.
        pub has_flown: Flag,
        /// `true` if the attitude of the last capture was not trusted.
        pub attitude_refused: Flag,
        /// Explicit padding.
        pub pad0: [u8; 2],
    }
}

// The record's arrays are written as numbers, for the message definition.
const _: () = assert!(CAPACITY == 64 && ERRORS * ERRORS == 324);

impl KalmanFilter {
    /// Returns the filter state as a record.
    #[must_use]
    pub fn save(&self) -> KalmanState {
        let mut state = KalmanState::new_zeroed();
        let (commands, count) = self.persistent.history.save();
        state.commands = commands;
        state.command_count = count as u64;
        state.captures_refused = self.persistent.captures_refused;
        let Scatter { seen, innovation } = self.persistent.scatter;
        state.scatter = [seen.position, seen.attitude];
        state.innovation = innovation.into();
        state.rests = self.persistent.rests_since_ns.is_some().into();
        state.rests_since_ns = self.persistent.rests_since_ns.unwrap_or(0);
        state.rates_stated_ns = self.persistent.rates_stated_ns.unwrap_or(u64::MAX);
        state.turn_known_from_ns = self.persistent.turn_known_from_ns;
        if let Some(track) = &self.persistent.track {
            save_track(track, &mut state);
        }
        state
    }

    /// Restores a saved filter state.
    pub fn restore(&mut self, state: &KalmanState) {
        let count = usize::try_from(state.command_count).unwrap_or(CAPACITY);
        self.persistent = PersistentState {
            history: CommandHistory::restored(state.commands, count),
            track: state.started.is_set().then(|| restored_track(state)),
            rests_since_ns: state.rests.is_set().then_some(state.rests_since_ns),
            rates_stated_ns: Some(state.rates_stated_ns).filter(|&at| at != u64::MAX),
            turn_known_from_ns: state.turn_known_from_ns,
            captures_refused: state.captures_refused,
            scatter: Scatter {
                seen: PoseNoise {
                    position: state.scatter[0],
                    attitude: state.scatter[1],
                },
                innovation: state.innovation.into(),
            },
        };
    }
}

fn save_track(track: &Track, state: &mut KalmanState) {
    state.started = true.into();
    state.time_ns = track.state.time_ns;
    state.used_at_ns = track.used_at_ns;
    state.levelled_at_ns = track.levelled_at_ns;
    state.stands = track.state.stands.into();
    state.refusing = track.refused_since_ns.is_some().into();
    state.refused_since_ns = track.refused_since_ns.unwrap_or(0);
    state.nominal = (&track.state.nominal).into();
    state
        .covariance
        .copy_from_slice(track.state.covariance.as_slice());
    state.captured_from_estimated = to_row_major(&track.trust.captured_from_estimated);
    state.settling_since_ns = track.settling_since_ns;
    state.trusted_ns = track.trust.trusted_ns;
    (state.tested_ns, state.unseen_ns) = (track.trust.tested_ns, track.trust.unseen_ns);
    state.attitude_refused = track.trust.is_refused.into();
    save_ground(&track.ground, state);
}

fn save_ground(ground: &Ground, state: &mut KalmanState) {
    let Rest { pose, free, .. } = &ground.rest;
    (state.stood_z, state.has_flown) = (ground.stood_z, ground.has_flown.into());
    (state.rest_since_ns, state.rest_captures) = (ground.rest.since_ns, ground.rest.captures);
    state.rest_position_world = pose.position_world.into();
    state.rest_world_from_body = to_row_major(&pose.world_from_body);
    state.free_ns = ground.rest.free_ns;
    state.free = free.into();
}

fn restored_ground(state: &KalmanState) -> Ground {
    Ground {
        stood_z: state.stood_z,
        has_flown: state.has_flown.is_set(),
        rest: Rest {
            since_ns: state.rest_since_ns,
            pose: Pose {
                position_world: state.rest_position_world.into(),
                world_from_body: from_row_major(&state.rest_world_from_body),
            },
            captures: state.rest_captures,
            free: (&state.free).into(),
            free_ns: state.free_ns,
        },
    }
}

fn restored_track(state: &KalmanState) -> Track {
    Track {
        state: FilterState {
            time_ns: state.time_ns,
            nominal: (&state.nominal).into(),
            covariance: Covariance::from_column_slice(&state.covariance),
            stands: state.stands.is_set(),
        },
        used_at_ns: state.used_at_ns,
        levelled_at_ns: state.levelled_at_ns,
        refused_since_ns: state.refusing.is_set().then_some(state.refused_since_ns),
        settling_since_ns: state.settling_since_ns,
        trust: AttitudeTrust {
            captured_from_estimated: from_row_major(&state.captured_from_estimated),
            trusted_ns: state.trusted_ns,
            tested_ns: state.tested_ns,
            is_refused: state.attitude_refused.is_set(),
            unseen_ns: state.unseen_ns,
        },
        ground: restored_ground(state),
    }
}

impl From<&NominalState> for NominalRecord {
    fn from(state: &NominalState) -> Self {
        Self {
            position_world: state.position_world.into(),
            velocity_world: state.velocity_world.into(),
            world_from_body: to_row_major(&state.world_from_body),
            rate_bias_body: state.rate_bias_body.into(),
            disturbance_world: state.disturbance_world.into(),
            marker_offset_body: state.marker_offset_body.into(),
            thrust: state.actuation.thrust,
            rates_body: state.actuation.rates_body.into(),
        }
    }
}

impl From<&NominalRecord> for NominalState {
    fn from(record: &NominalRecord) -> Self {
        Self {
            position_world: record.position_world.into(),
            velocity_world: record.velocity_world.into(),
            world_from_body: from_row_major(&record.world_from_body),
            rate_bias_body: record.rate_bias_body.into(),
            disturbance_world: record.disturbance_world.into(),
            marker_offset_body: record.marker_offset_body.into(),
            actuation: Actuation {
                thrust: record.thrust,
                rates_body: record.rates_body.into(),
            },
        }
    }
}
