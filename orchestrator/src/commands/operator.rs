//! `gerono operator probe`: prints the signals of a kill switch.

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::print;
use rustix::event::Timespec;

use supervisor::kill_switch::device::Device;
use supervisor::kill_switch::signal::Signal;

use crate::cli::OperatorProbe;

/// Period at which Ctrl-C is checked: a signal that arrives just before the wait does not interrupt it.
const WAIT: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 200_000_000,
};

/// Prints the signals of a device, until Ctrl-C.
///
/// # Errors
/// [`Failure`] if the device cannot be read, with the fix, or was removed.
pub fn probe(arguments: &OperatorProbe) -> Result<Exit, Failure> {
    let mut device = Device::open(&arguments.device, arguments.baud).map_err(Failure::trouble)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let shown = arguments.device.display();
    print(format!("{shown}: press the button; Ctrl-C quits.\n"));
    loop {
        let read = device.read(|signal| {
            if !signal.is_separator() {
                print(line(&signal));
            }
        });
        read.map_err(Failure::trouble)?;
        if let Some(signal) = interrupt.signal() {
            return Ok(Exit::Signal(signal));
        }
        device.wait(None, Some(WAIT)).map_err(Failure::trouble)?;
    }
}

/// Formats a signal and, for a press, its `kill_key`.
fn line(signal: &Signal) -> String {
    match signal.press() {
        Some(key) => format!("{signal}; kill_key = {key}\n"),
        None => format!("{signal}\n"),
    }
}
