//! Battery voltage of an autopilot: `SYS_STATUS` and `BATTERY_STATUS`.
//!
//! Autopilots send both unasked, as often as their streams of messages are set. Messages of other IDs cannot be checked,
//! because each has its own `CRC_EXTRA`; the bytes of them are skipped one by one.

use mavlink_frame::{Definition, FrameError};

use crate::telemetry::Reply;

const SYS_STATUS: Definition = Definition {
    id: 1,
    base_length: 31,
    length: 43,
    crc_extra: 124,
};
const BATTERY_STATUS: Definition = Definition {
    id: 147,
    base_length: 36,
    length: 54,
    crc_extra: 154,
};
const MESSAGES: [Definition; 2] = [SYS_STATUS, BATTERY_STATUS];
const LONGEST: usize = BATTERY_STATUS.length;

/// Offsets of the fields.
const SYSTEM_VOLTAGE: usize = 14;
const CELLS: usize = 10;
const CELL_COUNT: usize = 10;
const BATTERY: usize = 32;
const FUNCTION: usize = 33;
const FURTHER_CELLS: usize = 41;
const FURTHER_CELL_COUNT: usize = 4;

/// Field of a voltage that is not known, and of a cell that is not there.
const UNKNOWN: u16 = u16::MAX;
/// Largest function of a battery that drives rotors: unknown, everything, propulsion.
const FUNCTION_PROPULSION: u8 = 2;
/// Volts of a field.
const MILLIVOLT: f64 = 1e-3;

/// Reads the message at the start of what an autopilot sends, given by its system and its component (0 for any). The voltage is
/// that of the first battery, unless that is stated to drive no rotors.
#[must_use]
pub fn read_reply(bytes: &[u8], [system, component]: [u8; 2]) -> Reply {
    let frame = match mavlink_frame::decode(bytes, &MESSAGES) {
        Ok(frame) => frame,
        Err(FrameError::Incomplete(_)) => return Reply::Incomplete,
        Err(_) => return Reply::Noise,
    };
    let mut payload = [0; LONGEST];
    payload[..frame.payload.len()].copy_from_slice(frame.payload);
    let is_other = component != 0 && frame.sender.component != component;
    let voltage = if frame.sender.system != system || is_other {
        None
    } else if *frame.definition == SYS_STATUS {
        Some(field(&payload, SYSTEM_VOLTAGE))
            .filter(|steps| *steps != UNKNOWN)
            .map(f64::from)
    } else {
        sum_of_cells(&payload)
    };
    let end = frame.length;
    voltage.map_or(Reply::Other(end), |steps| Reply::Voltage(end, MILLIVOLT * steps))
}

fn field(payload: &[u8; LONGEST], at: usize) -> u16 {
    u16::from_le_bytes([payload[at], payload[at + 1]])
}

/// Returns the voltage of the first battery, mV. A battery above 65.534 V, and one whose cells are not measured singly, stand
/// in as many cells as they need.
fn sum_of_cells(payload: &[u8; LONGEST]) -> Option<f64> {
    let cells = (0..CELL_COUNT).map(|cell| field(payload, CELLS + 2 * cell));
    // Further cells are 0 where there are none.
    let further = (0..FURTHER_CELL_COUNT).map(|cell| field(payload, FURTHER_CELLS + 2 * cell));
    let drives = payload[FUNCTION] <= FUNCTION_PROPULSION;
    let is_known = payload[BATTERY] == 0 && drives && field(payload, CELLS) != UNKNOWN;
    let there = cells.chain(further).filter(|steps| *steps != UNKNOWN);
    is_known.then(|| there.map(f64::from).sum())
}
