//! Filter's memory as a record, so that a restarted estimator goes on with the same bytes.

use nalgebra::Vector3;
use shared_types::rotation::{from_row_major, to_row_major};
use shared_types::sample::Flag;
use zerocopy::FromZeros;

use super::attitude_trust::AttitudeTrust;
use super::commands::{CAPACITY, Command, CommandHistory};
use super::error_state::{Covariance, ERRORS};
use super::filter::{KalmanFilter, Memory, Track};
use super::filter_state::{FilterState, PoseNoise};
use super::motion::{Actuation, NominalState};
use super::scatter::Scatter;

shared_types::sample! {
    /// Memory of the filter from step to step.
    pub struct KalmanState {
        /// The time that the state speaks of, ns since the start of the flight.
        pub time_ns: u64,
        /// Time at which a capture was used last, ns since the start of the flight.
        pub used_at_ns: u64,
        /// Exposure of the first of the captures refused in a row, ns since the start of the flight.
        pub refused_since_ns: u64,
        /// Time since which all frames have stopped the motors, ns since the start of the flight.
        pub rests_since_ns: u64,
        /// Time from which the newest frame with body rates acts, ns since the start of the flight; all ones for none.
        pub rates_stated_ns: u64,
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
        /// P, covariance of (δp, δv, θ, δω_bias, δd, δr), column by column.
        pub covariance: [f64; 324],
        /// Mean of the variances that captures have shown of the position (m²) and the attitude (rad²).
        pub scatter: [f64; 2],
        /// Innovation of the capture before: position, m, and attitude, rad.
        pub innovation: [f64; 6],
        /// Time at which the filter started first, ns since the start of the flight.
        pub started_ns: u64,
        /// R_captured R_estimatedᵀ of the last trusted capture, row-major.
        pub captured_from_estimated: [f64; 9],
        /// Time of the last trusted capture, ns since the start of the flight.
        pub trusted_ns: u64,
        /// Time from the last trusted capture to the first one after it, ns.
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
    }
}

// The record's arrays are written as numbers, for the message definition.
const _: () = assert!(CAPACITY == 64 && ERRORS * ERRORS == 324);

impl KalmanFilter {
    /// Returns the filter's memory as a record.
    #[must_use]
    pub fn save(&self) -> KalmanState {
        let mut state = KalmanState::new_zeroed();
        let (commands, count) = self.memory.history.save();
        state.commands = commands;
        state.command_count = count as u64;
        state.captures_refused = self.memory.captures_refused;
        let Scatter { seen, innovation } = self.memory.scatter;
        state.scatter = [seen.position, seen.attitude];
        state.innovation = innovation.into();
        state.rests = self.memory.rests_since_ns.is_some().into();
        state.rests_since_ns = self.memory.rests_since_ns.unwrap_or(0);
        state.rates_stated_ns = self.memory.rates_stated_ns.unwrap_or(u64::MAX);
        if let Some(track) = &self.memory.track {
            save_track(track, &mut state);
        }
        state
    }

    /// Restores a saved memory.
    pub fn restore(&mut self, state: &KalmanState) {
        let count = usize::try_from(state.command_count).unwrap_or(CAPACITY);
        self.memory = Memory {
            history: CommandHistory::restored(state.commands, count),
            track: state.started.is_set().then(|| restored_track(state)),
            rests_since_ns: state.rests.is_set().then_some(state.rests_since_ns),
            rates_stated_ns: Some(state.rates_stated_ns).filter(|&at| at != u64::MAX),
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
    let nominal = &track.state.nominal;
    state.started = true.into();
    state.time_ns = track.state.time_ns;
    state.used_at_ns = track.used_at_ns;
    state.stands = track.state.stands.into();
    state.refusing = track.refused_since_ns.is_some().into();
    state.refused_since_ns = track.refused_since_ns.unwrap_or(0);
    state.position_world = nominal.position_world.into();
    state.velocity_world = nominal.velocity_world.into();
    state.world_from_body = to_row_major(&nominal.world_from_body);
    state.rate_bias_body = nominal.rate_bias_body.into();
    state.disturbance_world = nominal.disturbance_world.into();
    state.marker_offset_body = nominal.marker_offset_body.into();
    state.thrust = nominal.actuation.thrust;
    state.rates_body = nominal.actuation.rates_body.into();
    state
        .covariance
        .copy_from_slice(track.state.covariance.as_slice());
    state.captured_from_estimated = to_row_major(&track.trust.captured_from_estimated);
    state.started_ns = track.started_ns;
    state.trusted_ns = track.trust.trusted_ns;
    state.unseen_ns = track.trust.unseen_ns;
}

fn restored_track(state: &KalmanState) -> Track {
    Track {
        state: FilterState {
            time_ns: state.time_ns,
            nominal: NominalState {
                position_world: state.position_world.into(),
                velocity_world: state.velocity_world.into(),
                world_from_body: from_row_major(&state.world_from_body),
                rate_bias_body: state.rate_bias_body.into(),
                disturbance_world: state.disturbance_world.into(),
                marker_offset_body: state.marker_offset_body.into(),
                actuation: Actuation {
                    thrust: state.thrust,
                    rates_body: Vector3::from(state.rates_body),
                },
            },
            covariance: Covariance::from_column_slice(&state.covariance),
            stands: state.stands.is_set(),
        },
        used_at_ns: state.used_at_ns,
        refused_since_ns: state.refusing.is_set().then_some(state.refused_since_ns),
        started_ns: state.started_ns,
        trust: AttitudeTrust {
            captured_from_estimated: from_row_major(&state.captured_from_estimated),
            trusted_ns: state.trusted_ns,
            unseen_ns: state.unseen_ns,
        },
    }
}
