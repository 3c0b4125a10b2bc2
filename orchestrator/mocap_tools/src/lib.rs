//! `gerono mocap`: listens to a motion-capture system, or seems to be one.

pub mod arguments;
mod probe;
mod send;

use crate::arguments::{Mocap, MocapCommand};
use command_line::exit::Exit;
use command_line::failure::Failure;

/// `gerono mocap`.
///
/// # Errors
/// [`Failure`] if a socket or file cannot be had, or nothing came that can be believed.
pub fn mocap(arguments: &Mocap) -> Result<Exit, Failure> {
    match &arguments.command {
        MocapCommand::Probe(arguments) => probe::probe(arguments),
        MocapCommand::Send(arguments) => send::send(arguments),
    }
}
