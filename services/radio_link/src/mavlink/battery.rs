//! Battery voltage of an autopilot: `SYS_STATUS` and `BATTERY_STATUS`.
//!
//! Autopilots send both unasked, as often as their streams of messages are set. Messages of other IDs cannot be checked,
//! because each has its own `CRC_EXTRA`; the bytes of them are skipped one by one.

use super::{HEADER, START, accumulate};
use crate::telemetry::Reply;

/// IDs, largest lengths of the payload with extensions, and `CRC_EXTRA`.
const SYS_STATUS: (u32, usize, u8) = (1, 43, 124);
const BATTERY_STATUS: (u32, usize, u8) = (147, 54, 154);
const LONGEST: usize = BATTERY_STATUS.1;

/// Offsets of the fields.
const SYSTEM_VOLTAGE: usize = 14;
const CELLS: usize = 10;
const CELL_COUNT: usize = 10;
const BATTERY: usize = 32;
const FURTHER_CELLS: usize = 41;
const FURTHER_CELL_COUNT: usize = 4;

/// Field of a voltage that is not known, and of a cell that is not there.
const UNKNOWN: u16 = u16::MAX;
/// Flag of a signed message, and length of a signature.
const SIGNED: u8 = 1;
const SIGNATURE: usize = 13;
/// Volts of a field.
const MILLIVOLT: f64 = 1e-3;

/// Reads the message at the start of what the autopilot of a system sends. The voltage is that of its first battery.
#[must_use]
pub fn read_reply(bytes: &[u8], system: u8) -> Reply {
    let Some(&first) = bytes.first() else {
        return Reply::Incomplete;
    };
    if first != START {
        return Reply::Noise;
    }
    let Some(header) = bytes.get(..HEADER) else {
        return Reply::Incomplete;
    };
    let id = u32::from_le_bytes([header[7], header[8], header[9], 0]);
    let length = usize::from(header[1]);
    let known = [SYS_STATUS, BATTERY_STATUS].into_iter().find(|kind| kind.0 == id);
    let Some((_, _, crc_extra)) = known.filter(|kind| (1..=kind.1).contains(&length)) else {
        return Reply::Noise;
    };
    if header[2] & !SIGNED != 0 {
        return Reply::Noise;
    }
    let end = HEADER + length;
    let signature = if header[2] == SIGNED { SIGNATURE } else { 0 };
    let (Some(sum), true) = (bytes.get(end..end + 2), bytes.len() >= end + 2 + signature) else {
        return Reply::Incomplete;
    };
    let computed = accumulate(accumulate(0xffff, &bytes[1..end]), &[crc_extra]);
    if sum != computed.to_le_bytes() {
        return Reply::Noise;
    }
    let mut payload = [0; LONGEST];
    payload[..length].copy_from_slice(&bytes[HEADER..end]);
    let voltage = if header[5] != system {
        None
    } else if id == SYS_STATUS.0 {
        Some(field(&payload, SYSTEM_VOLTAGE))
            .filter(|steps| *steps != UNKNOWN)
            .map(f64::from)
    } else {
        sum_of_cells(&payload)
    };
    let end = end + 2 + signature;
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
    let is_known = payload[BATTERY] == 0 && field(payload, CELLS) != UNKNOWN;
    let there = cells.chain(further).filter(|steps| *steps != UNKNOWN);
    is_known.then(|| there.map(f64::from).sum())
}
