//! Samples of the flight. Frames: {I} ("world", z down) and {B} ("body"). SI units, radians.

use std::borrow::Cow;

use nalgebra::Vector3;

use crate::rotation::from_row_major;
use crate::sample::{Field, Flag, Header};

crate::sample! {
    /// The plant's true state at the sample's tick.
    pub struct VehicleTruth {
        /// Common header.
        pub header: Header,
        /// p, position in {I}, m.
        pub position_world: [f64; 3],
        /// R, body to inertial, row-major.
        pub world_from_body: [f64; 9],
        /// v, linear velocity in {B}, m/s.
        pub velocity_body: [f64; 3],
        /// ω, angular velocity in {B}, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// T, thrust that acted up to this tick, N.
        pub thrust: f64,
        /// τ, torque that acted up to this tick, in {B}, N m.
        pub torque_body: [f64; 3],
        /// m, mass from this tick on, kg.
        pub mass: f64,
        /// Diagonal of J from this tick on, kg m².
        pub inertia: [f64; 3],
        /// b, disturbance from this tick on, an acceleration in {I}, m/s²: the constant one, fan, turbulence and
        /// drag together.
        pub disturbance_world: [f64; 3],
    }

    /// Pose captured by the motion-capture system.
    pub struct MocapPose {
        /// Common header.
        pub header: Header,
        /// Time of the exposure, ns since the start of the flight.
        pub capture_time_ns: u64,
        /// Position of the body in {I}, m.
        pub position_world: [f64; 3],
        /// Attitude, body to inertial, row-major.
        pub world_from_body: [f64; 9],
        /// Linear velocity in {B}, m/s; only with `velocities_measured`.
        pub velocity_body: [f64; 3],
        /// Angular velocity in {B}, rad/s; only with `velocities_measured`.
        pub angular_velocity_body: [f64; 3],
        /// `true` if the body was tracked; if not, all else is zero.
        pub tracked: Flag,
        /// `true` if the velocities are measured (ideal cameras); if not, they are zero.
        pub velocities_measured: Flag,
        /// Explicit padding.
        pub pad0: [u8; 6],
    }

    /// Estimated state of the vehicle.
    pub struct VehicleState {
        /// Common header.
        pub header: Header,
        /// Time of the state, ns since the start of the flight.
        pub state_time_ns: u64,
        /// p, position in {I}, m.
        pub position_world: [f64; 3],
        /// R, body to inertial, row-major.
        pub world_from_body: [f64; 9],
        /// v, linear velocity in {B}, m/s.
        pub velocity_body: [f64; 3],
        /// ω, angular velocity in {B}, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// p̈, acceleration of the position in {I} at that time, m/s², which is 0 in hover; always 0 without a filter.
        pub acceleration_world: [f64; 3],
        /// T, thrust that acts at that time by the frames sent so far, N; 0 without a filter.
        pub thrust: f64,
        /// Standard deviation of the position, the largest axis, m.
        pub position_sigma: f64,
        /// Captures refused as outliers since the start of the flight.
        pub captures_refused: u32,
        /// `true` if the state is based on a measurement of the body that is recent enough.
        pub tracked: Flag,
        /// `true` if due captures are missing, so that the state is predicted further than usual.
        pub coasting: Flag,
        /// Explicit padding.
        pub pad0: [u8; 2],
    }

    /// Reference: the point of the path, its γ-derivatives and the timing law's terms.
    ///
    /// During take-off and landing, the path is a straight line, and γ the time on it in s.
    pub struct PathReference {
        /// Common header.
        pub header: Header,
        /// Time of the reference, ns since the start of the flight: that of the state it was made from, and later by
        /// the excess of that state's age over its usual age.
        pub reference_time_ns: u64,
        /// γ, path parameter.
        pub gamma: f64,
        /// γ̇, 1/s.
        pub gamma_dot: f64,
        /// γ̈ of the timing law (25), 1/s².
        pub gamma_ddot: f64,
        /// γ̇d = vd ψ(‖z1‖), 1/s.
        pub gamma_dot_desired: f64,
        /// Constant part of γ⃛ = c0 + c1 d²‖z1‖/dt², 1/s³.
        pub gamma_dddot_constant: f64,
        /// Coefficient c1 of d²‖z1‖/dt² in γ⃛, 1/(m s).
        pub gamma_dddot_slope: f64,
        /// pd(γ) in {I}, m.
        pub position_world: [f64; 3],
        /// dpd/dγ in {I}, m.
        pub derivative1_world: [f64; 3],
        /// d²pd/dγ² in {I}, m.
        pub derivative2_world: [f64; 3],
        /// d³pd/dγ³ in {I}, m.
        pub derivative3_world: [f64; 3],
        /// ψd, desired yaw, rad.
        pub yaw: f64,
        /// Rate of the desired yaw, rad/s.
        pub yaw_rate: f64,
        /// Impossible states refused since the start of the flight.
        pub states_refused: u32,
        /// `true` if the position of the vehicle is known; if not, the path stands still.
        pub vehicle_known: Flag,
        #[values(
            PHASE_DISARMED = 0, PHASE_ARMED = 1, PHASE_TAKE_OFF = 2, PHASE_FLY = 3, PHASE_LAND = 4
        )]
        /// Phase of the flight; a flight without phases is in the phase `fly` from its start.
        pub phase: u8,
        /// `true` if the vehicle is airborne, as far as its motion shows.
        pub airborne: Flag,
        #[values(
            CAUSE_NONE = 0, CAUSE_OPERATOR_KILLS = 1, CAUSE_OPERATOR_DISARMS = 2, CAUSE_OPERATOR_LANDS = 3,
            CAUSE_NOT_READY = 4, CAUSE_OVERDUE = 5, CAUSE_TOUCHED_DOWN = 6, CAUSE_FOUND_FLYING = 7,
            CAUSE_STRAYED = 8,
            CAUSE_ENVELOPE_LANDS = 16, CAUSE_ENVELOPE_KILLS = 32
        )]
        /// Cause of the phase. The causes of the envelope are added to the exceeded limit (`limit` of the frame).
        pub cause: u8,
    }

    /// Command of the controller.
    pub struct ControlCommand {
        /// Common header.
        pub header: Header,
        /// T, thrust along −R e3, N.
        pub thrust: f64,
        /// τ, torque in {B}, N m; with `MODE_TORQUE`.
        pub torque_body: [f64; 3],
        /// Body rates in {B}, rad/s; with `MODE_RATES`.
        pub rates_body: [f64; 3],
        #[values(MODE_TORQUE = 0, MODE_RATES = 1, MODE_FAILSAFE = 2)]
        /// Quantities that the vehicle shall follow; none in failsafe.
        pub mode: u32,
        /// Explicit padding.
        pub pad0: u32,
    }

    /// Estimates of the unknown parameters, for display.
    pub struct ControlAdaptation {
        /// Common header.
        pub header: Header,
        /// η̂, estimate of 1/m before projection, 1/kg.
        pub eta_hat: f64,
        /// π(η̂), 1/kg.
        pub eta_projected: f64,
        /// m̂ = 1/π(η̂), kg.
        pub mass_estimate: f64,
        /// b̂ in {I} before projection, m/s².
        pub disturbance_hat_world: [f64; 3],
        /// π(b̂) in {I}, m/s².
        pub disturbance_projected_world: [f64; 3],
        /// ŵ: Diag(J), η Diag(J), J1 b, J2 b, J3 b.
        pub w_hat: [f64; 15],
        /// m̂ of the immersion-and-invariance observer, kg; 0 without one.
        pub observer_mass_estimate: f64,
        /// Impossible inputs refused since the start of the flight.
        pub inputs_refused: u32,
        /// `true` if the estimates are frozen, because there are no valid data to adapt to.
        pub resting: Flag,
        #[values(STAGE_LAW = 0, STAGE_HOLD = 1, STAGE_LEVEL = 2, STAGE_DESCEND = 3, STAGE_FAILSAFE = 4)]
        /// Failsafe stage: the law, or by the age of its inputs a safer command.
        pub stage: u8,
        /// Explicit padding.
        pub pad0: [u8; 2],
    }

    /// Errors of the backstepping design at the time of the state from which they were computed.
    pub struct ControlErrors {
        /// Common header.
        pub header: Header,
        /// z1 = p − pd(γ), eq. (7), m.
        pub z1: [f64; 3],
        /// z2, eq. (9), m/s.
        pub z2: [f64; 3],
        /// z3 = ω − ωd, eq. (18), rad/s.
        pub z3: [f64; 3],
        /// z4 = γ̇ − γ̇d, eq. (22), 1/s.
        pub z4: f64,
        /// ζ of section IV, m/s².
        pub zeta: [f64; 3],
        /// ωd, virtual angular velocity, rad/s.
        pub omega_desired: [f64; 3],
    }

    /// Frame of the radio link and its meaning.
    pub struct RcFrame {
        /// Common header.
        pub header: Header,
        /// Channels as sent, in the link's units: thrust, roll rate, pitch rate, yaw rate, then unused ones; all zero
        /// on the ideal link and in failsafe frames.
        pub channels: [u16; 16],
        /// T commanded by the frame, N.
        pub thrust: f64,
        /// τ commanded by the frame in {B}, N m; with `MODE_TORQUE`.
        pub torque_body: [f64; 3],
        /// Body rates commanded by the frame in {B}, rad/s; with `MODE_RATES`.
        pub rates_body: [f64; 3],
        #[values(MODE_TORQUE = 0, MODE_RATES = 1)]
        /// Quantities that the vehicle shall follow.
        pub mode: u32,
        /// Saturated frames since the start of the flight, this one included.
        pub saturated_frames: u32,
        /// Invalid commands refused since the start of the flight.
        pub commands_refused: u32,
        /// `true` for a failsafe frame: the motors stop.
        pub failsafe: Flag,
        /// `true` if a limit changed the controller's command by more than the link's resolution.
        pub saturated: Flag,
        #[values(STAGE_COMMAND = 0, STAGE_HOLD = 1, STAGE_FAILSAFE = 4)]
        /// Content of the frame: the newest command, or by its age a safer one.
        pub stage: u8,
        #[values(
            LIMIT_NONE = 0, LIMIT_BOX = 1, LIMIT_TILT = 2, LIMIT_SPEED = 3, LIMIT_ESTIMATE = 4, LIMIT_THRUST = 5,
            LIMIT_TORQUE = 6, LIMIT_RATES = 7, LIMIT_LANDING_TIME = 8
        )]
        /// Limit of the envelope to which `action` belongs; none if the operator killed.
        pub limit: u8,
        #[values(ACTION_NONE = 0, ACTION_WARN = 1, ACTION_LAND = 2, ACTION_KILL = 3)]
        /// Action of the transmitter for the limit: a warning, a demand to land, or a permanent stop of the motors.
        pub action: u8,
        /// `true` if the transmitter's required inputs exist and are recent.
        pub inputs_fresh: Flag,
        /// Explicit padding.
        pub pad0: [u8; 6],
    }

    /// Event that the scenario schedules, never an event of the machine.
    pub struct RunEvent {
        /// Common header.
        pub header: Header,
        #[values(
            KIND_FLIGHT_STARTS = 1, KIND_VEHICLE_CHANGES = 2, KIND_FLIGHT_ENDS = 3, KIND_OUTAGE_BEGINS = 4,
            KIND_OUTAGE_ENDS = 5, KIND_EDGE_FAULT_BEGINS = 6, KIND_EDGE_FAULT_ENDS = 7, KIND_OPERATOR_ARMS = 8,
            KIND_OPERATOR_LANDS = 9, KIND_OPERATOR_KILLS = 10, KIND_OPERATOR_DISARMS = 11
        )]
        /// Kind of the event.
        pub kind: u32,
        /// Length of `text`, bytes.
        pub text_length: u32,
        /// The event as text, UTF-8, filled up with zeros.
        pub text: [u8; 120],
    }

    /// Numbers of a controller that is not Gerono's own. Logs call each by the name in `controller.telemetry`.
    pub struct ControlTelemetry {
        /// Common header.
        pub header: Header,
        /// The numbers in the order of their names; zero after them.
        pub values: [f64; ControlTelemetry::NUMBERS],
    }

    /// Sample of an inertial measurement unit: means over the time since the sample before.
    pub struct ImuSample {
        /// Common header.
        pub header: Header,
        /// End of this time, ns since the start of the flight.
        pub measured_ns: u64,
        /// Angular velocity in {B}, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// Specific force in {B}, m/s².
        pub specific_force_body: [f64; 3],
        /// `true` if something was measured; if not, all else is zero.
        pub measured: Flag,
        /// `true` if a component is at the end of its range.
        pub clipped: Flag,
        /// Explicit padding.
        pub pad0: [u8; 6],
    }

    /// Fix of a satellite receiver, of its antenna.
    pub struct GnssFix {
        /// Common header.
        pub header: Header,
        /// Time at which the fix is valid, ns since the start of the flight.
        pub valid_ns: u64,
        /// Geodetic latitude (WGS-84), degrees.
        pub latitude: f64,
        /// Longitude (WGS-84), degrees.
        pub longitude: f64,
        /// Height above the ellipsoid, m.
        pub height: f64,
        /// Velocity to the north, to the east and downwards, m/s.
        pub velocity_ned: [f64; 3],
        /// Standard deviation of the horizontal position over both directions, as reported, m.
        pub horizontal_accuracy: f64,
        /// Standard deviation of the height, as reported, m.
        pub vertical_accuracy: f64,
        /// Standard deviation of a component of the velocity, as reported, m/s.
        pub speed_accuracy: f64,
        #[values(KIND_SINGLE_POINT = 0, KIND_RTK_FLOAT = 1, KIND_RTK_FIXED = 2)]
        /// What the receiver has solved.
        pub kind: u8,
        /// `true` if there is a fix; if not, all else is zero.
        pub measured: Flag,
        /// Explicit padding.
        pub pad0: [u8; 6],
    }

    /// Altitude that a barometer measures.
    pub struct BaroAltitude {
        /// Common header.
        pub header: Header,
        /// Time of the measurement, ns since the start of the flight.
        pub measured_ns: u64,
        /// Altitude above the origin of {I}, m.
        pub altitude: f64,
        /// `true` if something was measured; if not, all else is zero.
        pub measured: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }

    /// Magnetic field that a magnetometer measures.
    pub struct MagField {
        /// Common header.
        pub header: Header,
        /// Time of the measurement, ns since the start of the flight.
        pub measured_ns: u64,
        /// Field in {B}, G.
        pub field_body: [f64; 3],
        /// `true` if something was measured; if not, all else is zero.
        pub measured: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }

    /// Innovations of inertial navigation: of each source the last, and what became of its measurements.
    pub struct NavigationInnovations {
        /// Common header.
        pub header: Header,
        /// Time of validity of the last measurement of each source, ns since the start of the flight; 0 for none. Sources: position
        /// and velocity of a fix, field, altitude, zero velocity and rate of a vehicle at rest.
        pub valid_ns: [u64; 6],
        /// Innovations of these measurements, three numbers a source: m and m/s in {I}, G in {B}, m and two zeros, m/s in {I},
        /// rad/s in {B}.
        pub innovations: [f64; 18],
        /// Their predicted variances.
        pub variances: [f64; 18],
        /// Their normalised squares: χ² of three degrees of freedom, of an altitude of one.
        pub normalised_squares: [f64; 6],
        /// Measurements fused since the start of the flight.
        pub fused: [u32; 6],
        /// Measurements beyond the gate since the start of the flight.
        pub refused: [u32; 6],
        /// Measurements that were late, from the future, not finite, or too many, since the start of the flight.
        pub unusable: [u32; 6],
        /// `true` if the last measurement was within the gate.
        pub accepted: [Flag; 6],
        /// Explicit padding.
        pub pad0: [u8; 2],
    }

    /// Innovations of the poses that inertial navigation fuses: of position and attitude the last, and what became of them.
    pub struct PoseInnovations {
        /// Common header.
        pub header: Header,
        /// Time of validity of the last measurement of each source, ns since the start of the flight; 0 for none. Sources: position
        /// and attitude of a pose.
        pub valid_ns: [u64; 2],
        /// Innovations of these measurements, three numbers a source: m in {I}, and rad in {B}.
        pub innovations: [f64; 6],
        /// Their predicted variances.
        pub variances: [f64; 6],
        /// Their normalised squares: χ² of three degrees of freedom.
        pub normalised_squares: [f64; 2],
        /// Measurements fused since the start of the flight.
        pub fused: [u32; 2],
        /// Measurements beyond the gate since the start of the flight.
        pub refused: [u32; 2],
        /// Measurements that were late, from the future, not finite, or too many, since the start of the flight.
        pub unusable: [u32; 2],
        /// `true` if the last measurement was within the gate.
        pub accepted: [Flag; 2],
        /// Explicit padding.
        pub pad0: [u8; 6],
    }

    /// Baseline of a receiver with two antennas, from the main one to the second.
    pub struct GnssBaseline {
        /// Common header.
        pub header: Header,
        /// Time at which the baseline is valid, ns since the start of the flight.
        pub valid_ns: u64,
        /// Baseline to the north, to the east and downwards, m.
        pub baseline_ned: [f64; 3],
        /// Its standard deviations, as reported, m.
        pub accuracies_ned: [f64; 3],
        /// `true` if the numbers of carrier waves are known; else it is too inaccurate to be used.
        pub fixed: Flag,
        /// `true` if there is a baseline; if not, all else is zero.
        pub measured: Flag,
        /// Explicit padding.
        pub pad0: [u8; 6],
    }

    /// Innovations of the baselines that inertial navigation fuses: the last, and what became of them.
    pub struct BaselineInnovations {
        /// Common header.
        pub header: Header,
        /// Time of validity of the last baseline, ns since the start of the flight; 0 for none.
        pub valid_ns: [u64; 1],
        /// Its innovation in {I}, m.
        pub innovations: [f64; 3],
        /// Its predicted variances.
        pub variances: [f64; 3],
        /// Its normalised square: χ² of three degrees of freedom.
        pub normalised_squares: [f64; 1],
        /// Baselines fused since the start of the flight.
        pub fused: [u32; 1],
        /// Baselines beyond the gate since the start of the flight.
        pub refused: [u32; 1],
        /// Baselines that were late, from the future, not finite, or too many, since the start of the flight.
        pub unusable: [u32; 1],
        /// `true` if the last baseline was within the gate.
        pub accepted: [Flag; 1],
        /// Explicit padding.
        pub pad0: [u8; 3],
    }
}

impl MocapPose {
    /// Bits of the first byte of the padding: invalid parts of the pose. They are not in the message definition, which
    /// would change the layout of every log.
    const POSITION_REFUSED: u8 = 1;
    const ATTITUDE_REFUSED: u8 = 2;

    /// Sets which parts of the pose are valid.
    pub fn set_parts(&mut self, has_position: bool, has_attitude: bool) {
        let bit = |is_there: bool, bit: u8| if is_there { 0 } else { bit };
        self.pad0[0] = bit(has_position, Self::POSITION_REFUSED) | bit(has_attitude, Self::ATTITUDE_REFUSED);
    }

    /// Returns whether the body was tracked with a valid position.
    #[must_use]
    #[inline]
    pub fn has_position(&self) -> bool {
        self.tracked.is_set() && self.pad0[0] & Self::POSITION_REFUSED == 0
    }

    /// Returns whether the body was tracked with a valid attitude.
    #[must_use]
    #[inline]
    pub fn has_attitude(&self) -> bool {
        self.tracked.is_set() && self.pad0[0] & Self::ATTITUDE_REFUSED == 0
    }

    /// Returns whether the body was tracked with a valid position and attitude.
    #[must_use]
    #[inline]
    pub fn is_whole(&self) -> bool {
        self.has_position() && self.has_attitude()
    }
}

impl ControlTelemetry {
    /// Maximum number of values.
    pub const NUMBERS: usize = 32;
}

impl RunEvent {
    /// A value of [`kind`](Self::kind): the operator changes a gain in flight. The text is the key with its value and the
    /// number of the change, such as `controller.k1=3.0 (change 2)`. It is not in the message definition, which would
    /// change the layout of every log.
    pub const KIND_OPERATOR_TUNES: u32 = 12;

    /// A value of [`kind`](Self::kind): gains change as the scenario plans. Not in the message definition either.
    pub const KIND_GAINS_CHANGE: u32 = 13;

    /// A value of [`kind`](Self::kind): the kill switch of a flight in real time is lost or connected again. Not in the
    /// message definition either.
    pub const KIND_KILL_SWITCH: u32 = 14;

    /// A value of [`kind`](Self::kind): a planned fault of the satellite receiver begins. Not in the message definition either.
    pub const KIND_RECEIVER_FAULT_BEGINS: u32 = 15;

    /// A value of [`kind`](Self::kind): it ends. Not in the message definition either.
    pub const KIND_RECEIVER_FAULT_ENDS: u32 = 16;

    /// A value of [`kind`](Self::kind): the radio link of a flight in real time is lost. Not in the message definition either.
    pub const KIND_LINK_LOST: u32 = 17;

    /// A value of [`kind`](Self::kind): it is found again. Not in the message definition either.
    pub const KIND_LINK_FOUND: u32 = 18;

    /// Returns the event as text; the readable part of a text that is not valid UTF-8.
    #[must_use]
    pub fn words(&self) -> Cow<'_, str> {
        let length = (self.text_length as usize).min(self.text.len());
        String::from_utf8_lossy(&self.text[..length])
    }
}

impl PathReference {
    /// Values of [`cause`](Self::cause): the condition of readiness that was missing
    /// ([`NotReady`](crate::flight_phase::NotReady)). They are not in the message definition, which would change the layout
    /// of every log.
    pub const CAUSE_NOT_READY_STATE: u8 = 9;
    /// The vehicle was not tracked.
    pub const CAUSE_NOT_READY_SIGHT: u8 = 10;
    /// The estimator had not converged.
    pub const CAUSE_NOT_READY_ESTIMATE: u8 = 11;
    /// The vehicle did not stand level.
    pub const CAUSE_NOT_READY_LEVEL: u8 = 12;
    /// The transmitter lacked an input, or its frames were old.
    pub const CAUSE_NOT_READY_TRANSMITTER: u8 = 13;
    /// The transmitter demanded a landing or a kill.
    pub const CAUSE_NOT_READY_DEMAND: u8 = 14;
    /// The vehicle moved.
    pub const CAUSE_NOT_READY_MOTION: u8 = 15;
}

impl VehicleState {
    /// Returns ṗ = R v, the velocity in {I}, m/s (1).
    #[must_use]
    #[inline]
    pub fn velocity_world(&self) -> Vector3<f64> {
        from_row_major(&self.world_from_body) * Vector3::from(self.velocity_body)
    }
}

impl RcFrame {
    /// A value of [`limit`](Self::limit): the modelled battery is below its lowest voltage. It is not in the message
    /// definition, which would change the layout of every log.
    pub const LIMIT_BATTERY: u8 = 9;

    /// Returns whether a receiver accepts the frame: its numbers are finite, and its mode is known.
    #[must_use]
    #[inline]
    pub fn is_whole(&self) -> bool {
        self.is_finite() && matches!(self.mode, Self::MODE_TORQUE | Self::MODE_RATES)
    }
}
