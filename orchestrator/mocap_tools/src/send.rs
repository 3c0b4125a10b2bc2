//! `gerono mocap send`.

use std::net::SocketAddrV4;
use std::path::Path;
use std::time::Duration;

use motion_capture::conventions::{Calibration, WorldPose};
use motion_capture::sender::server::{Plan, Server};
use nalgebra::{Matrix3, Vector3};
use runtime::flight_clock::monotonic_ns;
use scenario::{CaptureSystem, TiltedEight};
use shared_types::noise::{Noise, Stream};
use shared_types::rotation::{exp, from_row_major, paper_rx};
use shared_types::samples::VehicleTruth;

use crate::arguments::MocapSend;
use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::log_path;
use flight::interrupt::Interrupt;
use run_log::LogReader;

/// Longest time between checks for new listeners, ns.
const SERVE_NS: u64 = 5_000_000;

/// Standard deviation of the attitude's noise for each metre of the position's, rad/m.
const TURN_PER_METRE: f64 = 5.0;

pub(super) fn send(arguments: &MocapSend) -> Result<Exit, Failure> {
    let system = CaptureSystem::from(arguments.system);
    let flight = match &arguments.log {
        Some(log) => Flight::recorded(&log_path(log))?,
        None => Flight::Eight,
    };
    let plan = Plan {
        system,
        at: SocketAddrV4::new(arguments.at, arguments.port.unwrap_or(system.port())),
        to: arguments
            .to
            .unwrap_or(SocketAddrV4::new(arguments.at, frame_port(system))),
        version: arguments.natnet,
    };
    let server = Server::open(&plan).map_err(|error| {
        let fix = "give another --at or --port";
        Failure::trouble(format!("cannot serve at {}: {error}; {fix}", plan.at))
    })?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    fly(arguments, &flight, system, server, &interrupt)
}

/// Port to which frames go.
fn frame_port(system: CaptureSystem) -> u16 {
    match system {
        CaptureSystem::Natnet => motion_capture::natnet::DATA_PORT,
        CaptureSystem::ViconUdp | CaptureSystem::Vrpn => system.port(),
    }
}

fn fly(
    arguments: &MocapSend,
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
    let period_ns = (1e9 / arguments.rate) as u64;
    let seconds = arguments.seconds.unwrap_or(f64::INFINITY).min(flight.duration());
    let began_ns = monotonic_ns();
    for number in 0_u32.. {
        let at_ns = u64::from(number) * period_ns;
        let at = Duration::from_nanos(at_ns).as_secs_f64();
        if at >= seconds {
            break;
        }
        while monotonic_ns() < began_ns + at_ns {
            server.serve(&[&arguments.object]);
            let left_ns = (began_ns + at_ns).saturating_sub(monotonic_ns());
            std::thread::sleep(Duration::from_nanos(left_ns.min(SERVE_NS)));
        }
        if let Some(signal) = interrupt.take() {
            return Ok(Exit::Signal(signal));
        }
        let mut pose = flight.pose(if arguments.rest { 0.0 } else { at });
        let mut draws = noise.at(u64::from(number));
        pose.position_world += draws.normal3() * arguments.noise;
        pose.world_from_body *= exp(&(draws.normal3() * (TURN_PER_METRE * arguments.noise)));
        let body = (arguments.object.as_str(), Some(calibration.capture_pose(&pose)));
        let sent_ns = monotonic_ns();
        server.send(number, (began_ns + at_ns).min(sent_ns), sent_ns, &[body]);
    }
    Ok(Exit::Success)
}

/// Place where the body is.
enum Flight {
    /// On the paper's tilted eight, upright, with the nose along its way.
    Eight,
    /// Place where the vehicle of a log truly was.
    Recorded(Vec<(f64, WorldPose)>),
}

impl Flight {
    fn recorded(log: &Path) -> Result<Self, Failure> {
        let reader = LogReader::open(log).map_err(Failure::bad_input)?;
        let mut poses = Vec::new();
        for sample in reader.samples::<VehicleTruth>() {
            let truth = sample.map_err(Failure::bad_input)?;
            let pose = WorldPose {
                position_world: Vector3::from(truth.position_world),
                world_from_body: from_row_major(&truth.world_from_body),
            };
            poses.push((Duration::from_nanos(truth.header.stamp_ns).as_secs_f64(), pose));
        }
        if poses.is_empty() {
            let reason = format!("{} holds no sample of vehicle/truth", log.display());
            return Err(Failure::bad_input(reason));
        }
        Ok(Self::Recorded(poses))
    }

    fn duration(&self) -> f64 {
        match self {
            Self::Eight => f64::INFINITY,
            Self::Recorded(poses) => poses.last().map_or(0.0, |(at, _)| *at),
        }
    }

    /// Pose at a time, s.
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
    let way = Vector3::new(cosine * cosine - sine * sine, cosine, 0.0);
    let yaw = libm::atan2(way.y, way.x);
    let world_from_body: Matrix3<f64> = exp(&Vector3::new(0.0, 0.0, yaw));
    WorldPose {
        position_world: position,
        world_from_body,
    }
}
