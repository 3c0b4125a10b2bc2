//! Test of the motors' sense, propellers off: moves one stick after another, armed, and compares which motors of the flight controller
//! speed up with the commanded body rate.
//!
//! It needs a link over which the flight controller sends the pulses of its motors: MSP, with the motors of a quadcopter in X in
//! Betaflight's order. Whether a motor's wires and its propeller fit its number only eyes can tell.

use std::fmt::Write as _;
use std::time::Duration;

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::print;
use flight::interrupt::Interrupt;
use identification::link::STICKS;
use nalgebra::{Matrix3, Vector3, Vector4};
use radio_link::channel_map::{ChannelMap, StickTravel};
use radio_link::encoder::Encoder;
use radio_link::frame::Frame;
use radio_link::msp::{self, Direction, Receiver, Step};
use radio_link::port::{Port, Target};
use radio_link::sender::monotonic_ns;
use radio_link::sticks::Sticks;
use scenario::{RadioProtocol, RcLink, Scenario};

/// Command that reads the pulses of the motors, µs.
const MOTOR: u8 = 104;
/// Command that reads the kind of the mixer, and whether the motors turn the other way round.
const MIXER_CONFIG: u8 = 42;
/// Mixer of a quadcopter in X.
const QUAD_X: u8 = 3;

/// Share of the largest thrust during the test.
const THRUST: f64 = 0.2;
/// Share of the largest body rate.
const RATE: f64 = 0.3;
/// Time at rest, disarmed and armed, and of each body rate, s. Motors are read in its second half.
const REST: f64 = 1.0;
const HELD: f64 = 0.6;
/// Attempts to disarm, of half a time at rest each.
const STOPPING: u32 = 10;
/// Pulse above which a motor turns, and least answer to a body rate, µs.
const TURNS: f64 = 1010.0;
const ANSWERS: f64 = 5.0;

/// Motors in Betaflight's order, rear right, front right, rear left, front left: whether each speeds up for a body rate about x
/// (right side down), y (nose up) and z (clockwise from above), if their propellers turn inwards at the front.
const SPEEDS_UP: [[f64; 4]; 3] = [
    [-1.0, -1.0, 1.0, 1.0],
    [-1.0, 1.0, -1.0, 1.0],
    [-1.0, 1.0, 1.0, -1.0],
];

/// Tests the motors of a scenario's vehicle.
///
/// # Errors
/// [`Failure`] if its link is not MSP, the flight controller does not answer or arm, or its motors may still turn.
pub fn test(scenario: &Scenario) -> Result<Exit, Failure> {
    let link = scenario.rc_output.as_ref();
    let link = link
        .filter(|link| link.link == RadioProtocol::Msp)
        .ok_or_else(no_motors)?;
    let interrupt = interrupt::install_in_terminal().map_err(Failure::trouble)?;
    let mut controller = Controller::open(link)?;
    let found = controller.test(&interrupt);
    controller.stop_motors()?;
    if let Some(signal) = interrupt.signal() {
        return Ok(Exit::Signal(signal));
    }
    let answers = found?;
    print(table(&answers));
    let wrong = verdicts(&answers).iter().any(Option::is_some);
    Ok(if wrong { Exit::Unfit } else { Exit::Success })
}

fn no_motors() -> Failure {
    let reason = "only over MSP a flight controller sends the pulses of its motors (`rc_output.link = \"msp\"`); with another link \
                  arm, move the sticks and look: docs/first_flight.md, The hand test";
    Failure::bad_input(reason)
}

/// Flight controller at the other end of the link.
struct Controller {
    port: Port,
    encoder: Encoder,
    map: ChannelMap,
    rate_slope: [f64; 3],
    period: f64,
    receiver: Receiver,
    /// Newest pulses of the motors, µs, and mixer.
    motors: Option<Vector4<f64>>,
    mixer: Option<[u8; 2]>,
    was_armed: bool,
}

impl Controller {
    fn open(link: &RcLink) -> Result<Self, Failure> {
        // The motors must follow the sticks alone.
        let plain = RcLink {
            battery: None,
            ..link.clone()
        };
        let opened = plain.transmitter.as_ref().and_then(|transmitter| {
            let target = Target::new(plain.link, transmitter)?;
            Some((
                Encoder::new(&plain, transmitter)?,
                target,
                transmitter.frame_rate_on(plain.link),
            ))
        });
        let (encoder, target, rate) = opened.ok_or_else(no_motors)?;
        Ok(Self {
            port: Port::open(target).map_err(Failure::trouble)?,
            map: encoder.map().clone(),
            encoder,
            rate_slope: plain.rate_slope,
            period: 1.0 / rate,
            receiver: Receiver::default(),
            motors: None,
            mixer: None,
            was_armed: false,
        })
    }

    /// Returns the answers to body rates about x, y and z (columns), each as components about x, y and z, µs.
    fn test(&mut self, interrupt: &Interrupt) -> Result<Matrix3<f64>, Failure> {
        print("disarmed, then armed with the thrust at its end, then each body rate in both senses\n");
        self.hold(&Sticks::MOTORS_OFF, REST, interrupt);
        let [mixer, is_reversed] = self.mixer.ok_or_else(|| self.silent())?;
        if mixer != QUAD_X {
            let reason = format!(
                "the flight controller has mixer {mixer}, and only a quadcopter in X (3) is known here"
            );
            return Err(Failure::trouble(reason));
        }
        self.hold(&self.sticks(0.0, None), REST, interrupt);
        self.hold(&self.sticks(THRUST, None), REST, interrupt);
        let idle = self.motors.ok_or_else(|| self.silent())?;
        if idle.max() < TURNS && interrupt.signal().is_none() {
            let reason = "the motors do not turn: the flight controller has not armed; `status` of its command line says why, and \
                          `gerono rc probe` which channel arms";
            return Err(Failure::trouble(reason));
        }
        let mut answers = Matrix3::zeros();
        for axis in 0..3 {
            let [up, down] = [RATE, -RATE].map(|rate| {
                self.hold(&self.sticks(THRUST, Some((axis, rate))), HELD, interrupt);
                self.motors.ok_or_else(|| self.silent())
            });
            let (up, down) = (up?, down?);
            let difference = 0.5 * (up - down);
            let mut answer =
                Vector3::from(SPEEDS_UP.map(|signs| Vector4::from(signs).dot(&difference) / 4.0));
            if is_reversed != 0 {
                answer.z = -answer.z;
            }
            answers.set_column(axis, &answer);
        }
        Ok(answers)
    }

    /// Disarms until the flight controller confirms that no motor turns.
    fn stop_motors(&mut self) -> Result<(), Failure> {
        if !self.was_armed {
            return Ok(());
        }
        for _ in 0..STOPPING {
            self.hold(&Sticks::MOTORS_OFF, REST / 2.0, &Interrupt::never());
            if self.motors.is_some_and(|motors| motors.max() < TURNS) {
                return Ok(());
            }
        }
        let reason = "the flight controller has not confirmed that its motors stand still: cut the power";
        Err(Failure::trouble(reason))
    }

    fn silent(&self) -> Failure {
        Failure::trouble(if self.port.is_open() {
            "the flight controller does not answer: is MSP enabled on this port?"
        } else {
            "the connection to the flight controller was lost"
        })
    }

    /// Returns armed sticks with a share of the largest thrust, and of the largest body rate about an axis.
    fn sticks(&self, thrust: f64, rate: Option<(usize, f64)>) -> Sticks {
        let least = self.map.least_thrust().value();
        let mut travels = [StickTravel::new(least * (1.0 - 2.0 * thrust)); 4];
        for (axis, travel) in travels[1..].iter_mut().enumerate() {
            let share = rate
                .filter(|(turned, _)| *turned == axis)
                .map_or(0.0, |(_, share)| share);
            *travel = StickTravel::new(share * self.rate_slope[axis].signum());
        }
        Sticks::flying(travels.map(|travel| self.map.code(travel)))
    }

    /// Sends sticks for a time, s, and stores the mean of the motors over its second half.
    fn hold(&mut self, sticks: &Sticks, time: f64, interrupt: &Interrupt) {
        let steps = (time / self.period).ceil() as u32;
        let (mut sum, mut count) = (Vector4::zeros(), 0.0);
        for step in 0..steps {
            if interrupt.signal().is_some() {
                return;
            }
            self.motors = None;
            self.exchange(sticks);
            if let Some(motors) = self.motors.filter(|_| 2 * step >= steps) {
                (sum, count) = (sum + motors, count + 1.0);
            }
            std::thread::sleep(Duration::from_secs_f64(self.period));
        }
        self.motors = (count > 0.0).then(|| sum / count);
    }

    /// Sends a frame and the requests, and reads what has come.
    fn exchange(&mut self, sticks: &Sticks) {
        let (now_ns, mut frame) = (monotonic_ns(), Frame::default());
        self.encoder.encode(sticks, false, now_ns, &mut frame);
        self.was_armed |= !sticks.disarmed;
        self.port.send(frame.bytes(), now_ns);
        let wanted = if self.mixer.is_some() { MOTOR } else { MIXER_CONFIG };
        self.port.request(&msp::request(wanted), frame.bytes().len());
        let mut bytes = [0; 512];
        let read = self.port.receive(&mut bytes, now_ns);
        for &byte in &bytes[..read] {
            let Step::Complete(message) = self.receiver.push(byte) else {
                continue;
            };
            match (message.direction, message.command, message.payload) {
                (Direction::Response, MOTOR, payload) if payload.len() >= 8 => {
                    let (pulses, _) = message.channels();
                    self.motors = Some([0, 1, 2, 3].map(|motor| f64::from(pulses[motor])).into());
                }
                (Direction::Response, MIXER_CONFIG, &[mixer, is_reversed, ..]) => {
                    self.mixer = Some([mixer, is_reversed]);
                }
                _ => {}
            }
        }
    }
}

/// Returns what is wrong with the answer to each stick, if so.
fn verdicts(answers: &Matrix3<f64>) -> [Option<String>; 3] {
    [0, 1, 2].map(|axis| {
        let answer = answers.column(axis);
        let main = answer.iamax();
        if answer[main].abs() < ANSWERS {
            Some("the motors do not answer".to_owned())
        } else if main != axis {
            Some(format!(
                "the motors turn the vehicle about the axis of the {}: exchanged channels, `rc_output.transmitter.order`",
                STICKS[1 + main]
            ))
        } else if answer[axis] < 0.0 {
            Some("the motors turn the vehicle the other way: `rc_output.transmitter.reversed`, or the sign of `rc_output.rate_slope`".to_owned())
        } else {
            None
        }
    })
}

fn table(answers: &Matrix3<f64>) -> String {
    let mut text = String::new();
    for (axis, verdict) in verdicts(answers).into_iter().enumerate() {
        let [x, y, z] = answers.column(axis).into();
        let verdict = verdict.map_or_else(|| "ok".to_owned(), |words| format!("WRONG: {words}"));
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{:10}  about x, y, z: {x:+5.0} {y:+5.0} {z:+5.0} µs  {verdict}",
            STICKS[1 + axis]
        );
    }
    text + "Look whether each motor turns the way of the flight controller's picture, and stands where it shows it.\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stick_that_turns_the_vehicle_otherwise_is_named() {
        let right = Matrix3::from_diagonal(&Vector3::new(80.0, 60.0, 30.0));
        let wrong = |answers: &Matrix3<f64>| verdicts(answers).map(Option::unwrap_or_default);
        assert_eq!(wrong(&right), ["", "", ""]);
        let reversed = right * Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
        let [roll, pitch, yaw] = wrong(&reversed);
        assert!(pitch.contains("the other way") && roll.is_empty() && yaw.is_empty());
        let exchanged = right * Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let [roll, pitch, yaw] = wrong(&exchanged);
        assert!(roll.contains("the pitch rate") && pitch.contains("the roll rate") && yaw.is_empty());
        assert!(
            wrong(&Matrix3::zeros())
                .iter()
                .all(|words| words.contains("do not answer"))
        );
    }

    #[test]
    fn a_motor_that_speeds_up_for_each_rate_is_one_of_two() {
        for (axis, signs) in SPEEDS_UP.iter().enumerate() {
            assert_eq!(signs.iter().sum::<f64>(), 0.0, "{axis}");
            for other in &SPEEDS_UP[..axis] {
                assert_eq!(Vector4::from(*signs).dot(&Vector4::from(*other)), 0.0);
            }
        }
    }
}
