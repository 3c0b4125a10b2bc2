//! `gerono mocap`: diagnoses or emulates a motion-capture system.

use std::net::SocketAddrV4;

use command_line::exit::Exit;
use laboratory_tools::mocap_probe;
use laboratory_tools::mocap_send::{self, Poses, frame_port};
use motion_capture::protocol::Plan;
use scenario::{CaptureSystem, MotionCapture};

use super::{Failure, log_path};
use crate::cli::{Mocap, MocapCommand, MocapProbe, MocapSend};

/// `gerono mocap`.
///
/// # Errors
/// [`Failure`] if a socket or file cannot be opened, or no pose was accepted.
pub fn mocap(arguments: &Mocap) -> Result<Exit, Failure> {
    match &arguments.command {
        MocapCommand::Probe(arguments) => probe(arguments),
        MocapCommand::Send(arguments) => send(arguments),
    }
}

fn probe(arguments: &MocapProbe) -> Result<Exit, Failure> {
    let system = arguments.source;
    let stated = stated(system, arguments);
    mocap_probe::probe(
        system,
        &stated,
        arguments.object.is_some(),
        arguments.seconds,
        arguments.calibrate.as_deref(),
    )
}

fn stated(system: CaptureSystem, arguments: &MocapProbe) -> MotionCapture {
    MotionCapture {
        port: arguments.port.map(u32::from),
        interface: arguments.interface.to_string(),
        ..MotionCapture::new(
            system,
            arguments.server,
            arguments.object.as_deref().unwrap_or_default(),
        )
    }
}

fn send(arguments: &MocapSend) -> Result<Exit, Failure> {
    let log = arguments.log.as_ref().map(|log| log_path(log));
    let system = arguments.system;
    let plan = Plan {
        system,
        at: SocketAddrV4::new(arguments.at, arguments.port.unwrap_or(system.properties().port)),
        to: arguments
            .to
            .unwrap_or(SocketAddrV4::new(arguments.at, frame_port(system))),
        version: arguments.natnet,
    };
    let poses = Poses {
        object: &arguments.object,
        log: log.as_deref(),
        rate: arguments.rate,
        noise: arguments.noise,
        seconds: arguments.seconds,
        rests: arguments.rest,
    };
    mocap_send::send(&plan, &poses)
}
