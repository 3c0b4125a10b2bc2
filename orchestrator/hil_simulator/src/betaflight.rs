//! A vehicle that Betaflight flies: its firmware, built for simulation, reads a gyro and turns four motors.
//!
//! Its simulator interface is UDP on the loopback, little-endian, as `src/platform/SIMULATOR` of its source (4.6) has it:
//!
//! * 9003, to it: 18 × f64: time, ω (3), specific force (3), attitude (w, x, y, z), velocity (3), position (3), pressure; axes
//!   forward, right, down, as ours;
//! * 9002, from it: 4 × f32, motors front right, rear left, front left, rear right, 0 to 1.
//!
//! The radio link does not come this way: a flight sends its frames to Betaflight itself.
//!
//! **Time.** From the time stamps Betaflight computes how much faster than the system's the world's clock goes, from packet to packet, and runs
//! by that: packets that come together would send its clock ahead. Ours is the system's clock, so the stamp stands still, with which it
//! never computes.
//!
//! ```text
//! Fi = T_max/4 ui     u̇i = (ui* − ui)/τT
//! ```
//!
//! ui motors in the order above, which is that of [`Rotors`]. The lag of T is the plant's own.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

use motion_capture::server::quaternion;
use radio_link::port::Target;
use scenario::Scenario;
use shared_types::rotation::from_row_major;
use shared_types::samples::{RcFrame, VehicleTruth};
use vehicle_model::lag::{Lag, between};
use zerocopy::FromZeros;

use super::link_loss_timer::LinkLossTimer;
use super::receiver_input::{ReceiverInput, ReceiverInputError};

pub use vehicle_model::rotors::Rotors;

/// Place where it sends what its motors do.
const MOTORS_AT: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9002);
/// Place where it takes what its sensors feel.
const SENSORS_AT: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9003);

/// Pressure of the air at the ground, Pa.
const PRESSURE: f64 = 101_325.0;

/// Betaflight and its motors.
#[derive(Debug)]
pub struct Betaflight {
    line: ReceiverInput,
    sensors: UdpSocket,
    rotors: Rotors,
    /// T_max/4, N.
    largest_force: f64,
    /// Share of its way that a motor goes in a tick.
    share: f64,
    /// The demand on its motors and their speeds, 0 to 1.
    asked: [f64; 4],
    motors: [f64; 4],
    silence: LinkLossTimer,
    packets: u64,
}

impl Betaflight {
    /// Takes the place of the simulator that it expects, for the vehicle of a scenario.
    ///
    /// # Errors
    /// [`ReceiverInputError`] if another process has that place.
    pub fn open(scenario: &Scenario, rotors: Rotors) -> Result<Self, ReceiverInputError> {
        let actuators = scenario.vehicle.actuators.clone().unwrap_or_default();
        let line = ReceiverInput::open(&Target::Udp(MOTORS_AT.into()))?;
        let sensors =
            UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(|source| ReceiverInputError::Socket {
                at: SENSORS_AT.into(),
                source,
            })?;
        Ok(Self {
            line,
            sensors,
            rotors,
            largest_force: actuators.thrust_max / 4.0,
            share: Lag::new(actuators.thrust_lag).gone(scenario.schedule.tick),
            asked: [0.0; 4],
            motors: [0.0; 4],
            silence: LinkLossTimer::default(),
            packets: 0,
        })
    }

    /// Takes what the motors are asked for until a time has come, ns of `CLOCK_MONOTONIC`.
    pub fn listen_until(&mut self, until_ns: u64) {
        let Self {
            line,
            asked,
            silence,
            packets,
            ..
        } = self;
        line.listen_until(until_ns, &mut |packet, now_ns| {
            if let Some(motors) = motors_of(packet) {
                *asked = motors;
                silence.ends_at(now_ns);
                *packets += 1;
            }
        });
    }

    /// Returns the commands that act in the tick before a time.
    pub fn acting(&mut self, at_ns: u64) -> RcFrame {
        if self.silence.becomes_too_long(at_ns) {
            self.asked = [0.0; 4];
        }
        for (motor, asked) in self.motors.iter_mut().zip(self.asked) {
            *motor = between(*motor, asked, self.share);
        }
        let mut frame = RcFrame::new_zeroed();
        frame.header.seq = self.packets;
        frame.mode = RcFrame::MODE_TORQUE;
        frame.thrust = self.largest_force * self.asked.iter().sum::<f64>();
        let forces = self.motors.map(|motor| self.largest_force * motor);
        frame.torque_body = self.rotors.wrench(&forces).torque_body.into();
        frame
    }

    /// Tells what the sensors feel. Who does not listen feels nothing.
    pub fn feel(&mut self, truth: &VehicleTruth) {
        let packet = sensors_of(truth);
        let _sent = self.sensors.send_to(&packet, SENSORS_AT);
    }

    /// Packets of motors so far, and how often they stayed away for too long.
    #[must_use]
    pub fn counts(&self) -> [u64; 2] {
        [self.packets, self.silence.losses()]
    }
}

/// Returns the demand of a packet on the motors, if it is one.
fn motors_of(packet: &[u8]) -> Option<[f64; 4]> {
    let packet: &[u8; 16] = packet.try_into().ok()?;
    let motors: [f32; 4] =
        std::array::from_fn(|motor| f32::from_le_bytes([0, 1, 2, 3].map(|byte| packet[4 * motor + byte])));
    let are_finite = motors.iter().all(|motor| motor.is_finite());
    are_finite.then(|| motors.map(|motor| f64::from(motor).clamp(0.0, 1.0)))
}

/// The packet of what the sensors feel.
fn sensors_of(truth: &VehicleTruth) -> [u8; 144] {
    let world_from_body = from_row_major(&truth.world_from_body);
    let [x, y, z, w] = quaternion(&world_from_body);
    // It flies by its gyro alone: of the force only the weight is told.
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
