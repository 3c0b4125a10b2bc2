//! `gerono mocap`: listens to a motion-capture system, or seems to be one.

mod probe;
mod send;

use super::Failure;
use crate::cli::{Mocap, MocapCommand};
use crate::exit::Exit;

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
