//! A quadcopter flown by Betaflight: its firmware, built for simulation, reads a gyro and commands four motors.
//!
//! Its simulator interface is UDP on the loopback, little-endian, as `src/platform/SIMULATOR` of its source (4.6) has it:
//!
//! * 9003, to Betaflight: 18 × f64: time, ω (3), specific force (3), attitude (w, x, y, z), velocity (3), position (3), pressure;
//!   axes forward, right, down, as in {B};
//! * 9002, from Betaflight: 4 × f32, motors front right, rear left, front left, rear right, 0 to 1.
//!
//! The radio link bypasses this interface: a flight sends its frames to Betaflight directly.
//!
//! **Time.** Betaflight estimates the ratio of the simulator's clock to the system's from the stamps of successive packets, and
//! scales its clock by it: packets that arrive together would advance its clock too far. Here both clocks are the system's:
//! every packet has the same stamp, from which Betaflight computes no ratio.
//!
//! ```text
//! Fi = T_max/4 ui     u̇i = (ui* − ui)/τT
//! ```
//!
//! ui motors in the order above. The lag of T is the plant's own.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

use motion_capture::server::quaternion;
use radio_link::port::Target;
use scenario::Scenario;
use shared_types::rotation::from_row_major;
use shared_types::samples::{RcFrame, VehicleTruth};
use vehicle_model::lag::{Lag, between};
use vehicle_model::rigid_body::Wrench;
use zerocopy::FromZeros;

use super::link_loss_timer::LinkLossTimer;
use super::receiver_input::{ReceiverInput, ReceiverInputError};

use vehicle_model::rotors::{Rotor, Rotors, Spin};

/// Number of motors in a packet.
const MOTORS: usize = 4;

/// Address to which Betaflight sends motor commands.
const MOTORS_AT: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9002);
/// Address at which Betaflight receives sensor readings.
const SENSORS_AT: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9003);

/// Air pressure at the ground, Pa.
const PRESSURE: f64 = 101_325.0;

/// Betaflight and its motors.
#[derive(Debug)]
pub struct Betaflight {
    line: ReceiverInput,
    sensors: UdpSocket,
    rotors: Box<[Rotor; MOTORS]>,
    mixer: Box<Rotors>,
    /// Response of a motor within a tick, as a share of the step to its command.
    share: f64,
    /// Motor commands, 0 to 1.
    commands: [f64; MOTORS],
    /// Motor states after the lag, 0 to 1.
    motors: [f64; MOTORS],
    link_loss: LinkLossTimer,
    packets: u64,
    /// Number of frames that have acted: the sequence number of the next one.
    acted: u64,
}

impl Betaflight {
    /// Opens the sockets of Betaflight's simulator interface, for the vehicle of a scenario whose rotors have this arm and this
    /// reaction torque per force, m; neither is 0.
    ///
    /// # Errors
    /// [`ReceiverInputError`] if another process uses these ports.
    pub fn open(scenario: &Scenario, arm: f64, torque_per_force: f64) -> Result<Self, ReceiverInputError> {
        let actuators = scenario.vehicle.actuators.clone().unwrap_or_default();
        let rotors = rotors(arm, torque_per_force, actuators.thrust_max);
        let mixer = Rotors::new(&rotors).expect("a quadcopter with an arm can exert every wrench");
        let line = ReceiverInput::open(&Target::Udp(MOTORS_AT.into()))?;
        let sensors =
            UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(|source| ReceiverInputError::Socket {
                at: SENSORS_AT.into(),
                source,
            })?;
        Ok(Self {
            line,
            sensors,
            rotors: Box::new(rotors),
            mixer: Box::new(mixer),
            share: Lag::new(actuators.thrust_lag).covered(scenario.schedule.tick),
            commands: [0.0; MOTORS],
            motors: [0.0; MOTORS],
            link_loss: LinkLossTimer::default(),
            packets: 0,
            acted: 0,
        })
    }

    /// Receives motor commands until a time, ns of `CLOCK_MONOTONIC`.
    pub fn listen_until(&mut self, until_ns: u64) {
        let Self {
            line,
            commands,
            link_loss,
            packets,
            ..
        } = self;
        line.listen_until(until_ns, &mut |packet, now_ns| {
            if let Some(motors) = motors_of(packet) {
                *commands = motors;
                link_loss.restart(now_ns);
                *packets += 1;
            }
        });
    }

    /// Returns the commands that act in the tick before a time.
    pub fn acting(&mut self, at_ns: u64) -> RcFrame {
        if self.link_loss.expires(at_ns) {
            self.commands = [0.0; MOTORS];
        }
        for (motor, command) in self.motors.iter_mut().zip(self.commands) {
            *motor = between(*motor, command, self.share);
        }
        let mut frame = RcFrame::new_zeroed();
        frame.header.seq = self.acted;
        self.acted += 1;
        frame.mode = RcFrame::MODE_TORQUE;
        frame.thrust = self.wrench(&self.commands).thrust;
        frame.torque_body = self.wrench(&self.motors).torque_body.into();
        frame
    }

    /// Returns the wrench of motors at a share of their full speed.
    fn wrench(&self, motors: &[f64; MOTORS]) -> Wrench {
        let rotors = self.rotors.iter().zip(motors);
        self.mixer
            .wrench(rotors.map(|(rotor, share)| rotor.force_max * share))
    }

    /// Sends the readings of the sensors; a missing Betaflight is not an error.
    pub fn update_sensors(&mut self, truth: &VehicleTruth) {
        let packet = sensors_of(truth);
        let _sent = self.sensors.send_to(&packet, SENSORS_AT);
    }

    /// Returns the numbers of motor packets and of link losses.
    #[must_use]
    pub fn counts(&self) -> [u64; 2] {
        [self.packets, self.link_loss.losses()]
    }
}

/// Returns the rotors in Betaflight's order, in an X between the axes of {B}; `thrust_max` is the total at full speed, N.
fn rotors(arm: f64, torque_per_force: f64, thrust_max: f64) -> [Rotor; MOTORS] {
    let l = arm * std::f64::consts::FRAC_1_SQRT_2;
    [
        (l, l, Spin::Left),
        (-l, -l, Spin::Left),
        (l, -l, Spin::Right),
        (-l, l, Spin::Right),
    ]
    .map(|(x, y, spin)| Rotor {
        position_body: [x, y, 0.0].into(),
        spin,
        torque_per_force,
        force_max: thrust_max / MOTORS as f64,
    })
}

/// Returns the motor commands of a packet, if it is valid.
fn motors_of(packet: &[u8]) -> Option<[f64; MOTORS]> {
    let packet: &[u8; 4 * MOTORS] = packet.try_into().ok()?;
    let motors: [f32; MOTORS] =
        std::array::from_fn(|motor| f32::from_le_bytes([0, 1, 2, 3].map(|byte| packet[4 * motor + byte])));
    let are_finite = motors.iter().all(|motor| motor.is_finite());
    are_finite.then(|| motors.map(|motor| f64::from(motor).clamp(0.0, 1.0)))
}

/// Returns a packet with sensor readings.
fn sensors_of(truth: &VehicleTruth) -> [u8; 144] {
    let world_from_body = from_row_major(&truth.world_from_body);
    let [x, y, z, w] = quaternion(&world_from_body);
    // Betaflight flies by its gyro alone: the specific force is that of a hover.
    let force_body = world_from_body.row(2) * -scenario::GRAVITY;
    let stamp = 0.0;
    let numbers = [stamp]
        .into_iter()
        .chain(truth.angular_velocity_body)
        .chain([force_body[0], force_body[1], force_body[2]])
        .chain([w, x, y, z])
        .chain([0.0; 6])
        .chain([PRESSURE]);
    let mut packet = [0; 144];
    for (bytes, number) in packet.chunks_exact_mut(8).zip(numbers) {
        bytes.copy_from_slice(&number.to_le_bytes());
    }
    packet
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;
    use shared_types::rotation::to_row_major;

    /// Front right and rear left spin left, and their reaction turns the body right.
    #[test]
    fn each_motor_of_a_packet_is_the_rotor_of_its_place() {
        use std::cmp::Ordering::{Greater, Less};
        let mixer = Rotors::new(&rotors(0.1, 0.03, 8.0)).unwrap();
        let turns = |motor: usize| {
            let mut forces = [0.0; MOTORS];
            forces[motor] = 1.0;
            let torque: [f64; 3] = mixer.wrench(forces).torque_body.into();
            torque.map(|torque| torque.partial_cmp(&0.0).unwrap())
        };
        assert_eq!(turns(0), [Less, Greater, Greater], "front right");
        assert_eq!(turns(1), [Greater, Less, Greater], "rear left");
        assert_eq!(turns(2), [Greater, Greater, Less], "front left");
        assert_eq!(turns(3), [Less, Less, Less], "rear right");
    }

    #[test]
    fn a_packet_of_motors_is_sixteen_bytes_of_finite_numbers() {
        let packet = |motors: [f32; 4]| motors.map(f32::to_le_bytes).concat();
        assert_eq!(
            motors_of(&packet([0.25, 1.5, -0.1, 1.0])),
            Some([0.25, 1.0, 0.0, 1.0])
        );
        assert_eq!(motors_of(&packet([0.25, f32::NAN, 0.0, 1.0])), None);
        assert_eq!(motors_of(&[0; 34]), None, "the packet for another simulator");
    }

    #[test]
    fn a_level_vehicle_at_rest_feels_its_weight_and_no_rate() {
        let mut truth = VehicleTruth::new_zeroed();
        truth.world_from_body = to_row_major(&Matrix3::identity());
        truth.angular_velocity_body = [0.1, 0.2, 0.3];
        let packet = sensors_of(&truth);
        let number = |at: usize| f64::from_le_bytes(packet[8 * at..8 * at + 8].try_into().unwrap());
        let numbers: Vec<f64> = (0..18).map(number).collect();
        assert_eq!(numbers[..4], [0.0, 0.1, 0.2, 0.3]);
        assert_eq!(numbers[4..7], [0.0, 0.0, -9.81]);
        assert_eq!(numbers[7..11], [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(numbers[17], PRESSURE);
    }
}
