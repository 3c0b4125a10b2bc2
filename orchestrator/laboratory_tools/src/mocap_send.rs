//! Emulation of a motion-capture system.

use std::path::Path;
use std::time::Duration;

use motion_capture::conventions::{Calibration, WorldPose};
use motion_capture::protocol::{self, Plan, SentFrame};
use motion_capture::server::Server;
use nalgebra::{Matrix3, Vector3};
use runtime::flight_clock::monotonic_ns;
use scenario::{CaptureSystem, TiltedEight};
use shared_types::noise::{Noise, Stream};
use shared_types::rotation::{exp, from_row_major, paper_rx};
use shared_types::samples::VehicleTruth;

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use flight::interrupt::Interrupt;
use run_log::LogReader;

/// Maximum time between checks for new clients, ns.
const SERVE_NS: u64 = 5_000_000;

/// Ratio of the attitude noise to the position noise, rad/m.
const TURN_PER_METRE: f64 = 5.0;

/// The poses to send.
#[derive(Clone, Debug)]
pub struct Poses<'a> {
    /// Name of the body.
    pub object: &'a str,
    /// Log with the true poses to send; an eight if `None`.
    pub log: Option<&'a Path>,
    /// Frame rate, Hz.
    pub rate: f64,
    /// Standard deviation of the noise of each coordinate, m.
    pub noise: f64,
    /// Duration, s; if `None`, until an interrupt or the log's end.
    pub seconds: Option<f64>,
    /// `true` if the body stays at the start of the flight.
    pub rests: bool,
}

/// Sends poses from the addresses of a plan.
///
/// # Errors
/// [`Failure`] if a socket or file cannot be opened.
pub fn send(plan: &Plan, poses: &Poses<'_>) -> Result<Exit, Failure> {
    let flight = match poses.log {
        Some(log) => Flight::recorded(log)?,
        None => Flight::Eight,
    };
    let server = Server::open(plan).map_err(|error| {
        let fix = "give another --at or --port";
        Failure::trouble(format!("cannot serve at {}: {error}; {fix}", plan.at))
    })?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    fly(poses, &flight, plan.system, server, &interrupt)
}

/// Returns the port to which a system sends its frames.
#[must_use]
pub fn frame_port(system: CaptureSystem) -> u16 {
    protocol::for_system(system).frame_port(system.properties().port)
}

fn fly(
    poses: &Poses<'_>,
    flight: &Flight,
    system: CaptureSystem,
    mut server: Server,
    interrupt: &Interrupt,
) -> Result<Exit, Failure> {
    let calibration = Calibration::new(system, None, None);
    let mut noise = Noise::new(1, Stream::CameraNoise);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a period of 1 s at most"
    )]
    let period_ns = (1e9 / poses.rate) as u64;
    let seconds = poses.seconds.unwrap_or(f64::INFINITY).min(flight.duration());
    let began_ns = monotonic_ns();
    for number in 0_u32.. {
        let at_ns = u64::from(number) * period_ns;
        let at = Duration::from_nanos(at_ns).as_secs_f64();
        if at >= seconds {
            break;
        }
        while monotonic_ns() < began_ns + at_ns {
            server.serve(&[poses.object]);
            let left_ns = (began_ns + at_ns).saturating_sub(monotonic_ns());
            std::thread::sleep(Duration::from_nanos(left_ns.min(SERVE_NS)));
        }
        if let Some(signal) = interrupt.take() {
            return Ok(Exit::Signal(signal));
        }
        let mut pose = flight.pose(if poses.rests { 0.0 } else { at });
        let mut draws = noise.at(u64::from(number));
        pose.position_world += draws.normal3() * poses.noise;
        pose.world_from_body *= exp(&(draws.normal3() * (TURN_PER_METRE * poses.noise)));
        let body = (poses.object, Some(calibration.capture_pose(&pose)));
        let sent_ns = monotonic_ns();
        let exposed_ns = (began_ns + at_ns).min(sent_ns);
        let frame = SentFrame {
            number,
            exposed_ns,
            computed_ns: exposed_ns,
            sent_ns,
        };
        server.send(&frame, &[body]);
    }
    Ok(Exit::Success)
}

/// Trajectory of the body.
enum Flight {
    /// The paper's tilted eight, upright, with the nose along the path.
    Eight,
    /// True poses of the vehicle in a log.
    Recorded(Vec<(f64, WorldPose)>),
}

impl Flight {
    fn recorded(log: &Path) -> Result<Self, Failure> {
        let reader = LogReader::open(log).map_err(Failure::trouble)?;
        let mut poses = Vec::new();
        for sample in reader.samples::<VehicleTruth>() {
            let truth = sample.map_err(Failure::trouble)?;
            let pose = WorldPose {
                position_world: Vector3::from(truth.position_world),
                world_from_body: from_row_major(&truth.world_from_body),
            };
            poses.push((Duration::from_nanos(truth.header.stamp_ns).as_secs_f64(), pose));
        }
        if poses.is_empty() {
            let reason = format!("{} holds no sample of vehicle/truth", log.display());
            return Err(Failure::trouble(reason));
        }
        Ok(Self::Recorded(poses))
    }

    fn duration(&self) -> f64 {
        match self {
            Self::Eight => f64::INFINITY,
            Self::Recorded(poses) => poses.last().map_or(0.0, |(at, _)| *at),
        }
    }

    /// Returns the pose at a time, s.
    fn pose(&self, at: f64) -> WorldPose {
        match self {
            Self::Eight => eight(at),
            Self::Recorded(poses) => {
                let index = poses.partition_point(|(time, _)| *time <= at).saturating_sub(1);
                poses[index].1
            }
        }
    }
}

fn eight(at: f64) -> WorldPose {
    let shape = TiltedEight::default();
    let (sine, cosine) = libm::sincos(shape.frequency * at);
    let tilt = paper_rx(shape.tilt);
    let position = tilt * Vector3::new(shape.size * sine * cosine, shape.size * sine, -shape.height);
    let tangent = Vector3::new(cosine * cosine - sine * sine, cosine, 0.0);
    let yaw = libm::atan2(tangent.y, tangent.x);
    let world_from_body: Matrix3<f64> = exp(&Vector3::new(0.0, 0.0, yaw));
    WorldPose {
        position_world: position,
        world_from_body,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_log_is_trouble_and_no_wrong_command_line() {
        let failure = Flight::recorded(Path::new("nosuch.mcap")).err().unwrap();
        assert_eq!(failure.exit, Exit::Trouble);
    }
}
