//! Log block of a Crazyflie's battery voltage, by the logging protocol of its firmware, version 2 (CRTP port 5).
//!
//! | packet | channel | payload |
//! | --- | --- | --- |
//! | item of the table of contents | 0 | 2; index as `u16`; back the same, then type, group and name, each ended by a zero; 2 alone beyond the last item |
//! | delete block | 1 | 2, block; back 2, block, error |
//! | create block | 1 | 6, block, type, index as `u16`; back 6, block, error |
//! | start block | 1 | 3, block, period in 10 ms; back 3, block, error |
//! | data | 2 | block, time in ms in three bytes, values |
//!
//! A variable is known by its index alone, which differs between versions of the firmware, and no packet asks by name. The
//! table is therefore read from its start up to `pm.vbat`, one item at a time. The client asks only while the motors are
//! off, and no longer than [`ASKS_FOR_NS`] in all: a flying vehicle gets nothing but setpoints. The log block stays on
//! the vehicle, so its data reach a restarted process too.

use crate::frame::Frame;
use crate::telemetry::Reply;

use super::header;

const PORT: u8 = 5;
const TOC: u8 = header(PORT, 0);
const SETTINGS: u8 = header(PORT, 1);
const DATA: u8 = header(PORT, 2);

const DELETE_BLOCK: u8 = 2;
const START_BLOCK: u8 = 3;
const CREATE_BLOCK: u8 = 6;
const READ_ITEM: u8 = 2;

/// Number of the block: the library of the Crazyflie counts from 1.
const BLOCK: u8 = 0xe7;
/// Period of the block, 10 ms.
const PERIOD: u8 = 20;
/// Type of a number of 32 bits.
const FLOAT: u8 = 7;
/// Group and name of the voltage, as in an item.
const NAME: &[u8] = b"pm\0vbat\0";
/// Errors of the firmware that leave the block as it is wanted: there is none to delete, or it exists.
const NO_ENTRY: u8 = 2;
const EXISTS: u8 = 17;

/// Time without an answer after which a request is repeated, ns.
const REPEAT_NS: u64 = 100_000_000;
/// Time after which the client gives up, ns: a table has some 600 items of a few milliseconds each.
pub const ASKS_FOR_NS: u64 = 60_000_000_000;

/// Next step of the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Reads the item of this index.
    Item(u16),
    /// Deletes the block, if an earlier process made it; with the index of the voltage.
    Delete(u16),
    /// Creates the block with this index.
    Create(u16),
    /// Starts the block.
    Start,
    /// The block is running, or cannot be had.
    Done,
}

/// Client of the log.
#[derive(Clone, Debug)]
pub(crate) struct LogClient {
    step: Step,
    /// Time at which an unanswered request is repeated, ns.
    repeat_at_ns: u64,
    /// Time for which it has asked, ns, and the time of the last call with the motors off, ns.
    asked_ns: u64,
    last_ns: Option<u64>,
}

impl Default for LogClient {
    fn default() -> Self {
        Self {
            step: Step::Item(0),
            repeat_at_ns: 0,
            asked_ns: 0,
            last_ns: None,
        }
    }
}

impl LogClient {
    /// Appends the request that is due, if any. Asks nothing while the motors may turn.
    pub(crate) fn request(&mut self, now_ns: u64, are_motors_off: bool, frame: &mut Frame) {
        if !are_motors_off || self.step == Step::Done {
            self.last_ns = None;
            return;
        }
        self.asked_ns += now_ns.saturating_sub(self.last_ns.replace(now_ns).unwrap_or(now_ns));
        if self.asked_ns > ASKS_FOR_NS {
            self.step = Step::Done;
            return;
        }
        if now_ns < self.repeat_at_ns {
            return;
        }
        self.repeat_at_ns = now_ns + REPEAT_NS;
        match self.step {
            Step::Item(index) => {
                let [low, high] = index.to_le_bytes();
                frame.push(&[TOC, READ_ITEM, low, high]);
            }
            Step::Delete(_) => frame.push(&[SETTINGS, DELETE_BLOCK, BLOCK]),
            Step::Create(index) => {
                let [low, high] = index.to_le_bytes();
                // Fetched as it is stored.
                frame.push(&[SETTINGS, CREATE_BLOCK, BLOCK, FLOAT << 4 | FLOAT, low, high]);
            }
            Step::Start => frame.push(&[SETTINGS, START_BLOCK, BLOCK, PERIOD]),
            Step::Done => {}
        }
    }

    /// Reads a packet of the vehicle.
    pub(crate) fn read(&mut self, packet: &[u8]) -> Reply {
        let Some((&first, payload)) = packet.split_first() else {
            return Reply::Incomplete;
        };
        let next = match (first | super::LINK_BITS, payload) {
            (DATA, &[BLOCK, _, _, _, a, b, c, d]) => {
                let voltage = f64::from(f32::from_le_bytes([a, b, c, d]));
                return Reply::Voltage(packet.len(), voltage);
            }
            (TOC, item) => self.after_item(item),
            (SETTINGS, &[command, BLOCK, error]) => self.after_setting(command, error),
            _ => None,
        };
        if let Some(next) = next {
            self.step = next;
            // The answer is here: the next request goes out with the next frame.
            self.repeat_at_ns = 0;
        }
        Reply::Other(packet.len())
    }

    fn after_item(&self, item: &[u8]) -> Option<Step> {
        let Step::Item(index) = self.step else {
            return None;
        };
        match *item {
            // Beyond the last item.
            [READ_ITEM] => Some(Step::Done),
            [READ_ITEM, low, high, kind, ref name @ ..] if u16::from_le_bytes([low, high]) == index => {
                let is_voltage = name == NAME && kind & 0x0f == FLOAT;
                Some(match index.checked_add(1) {
                    _ if is_voltage => Step::Delete(index),
                    Some(next) => Step::Item(next),
                    None => Step::Done,
                })
            }
            _ => None,
        }
    }

    fn after_setting(&self, command: u8, error: u8) -> Option<Step> {
        match (self.step, command, error) {
            (Step::Delete(index), DELETE_BLOCK, 0 | NO_ENTRY) => Some(Step::Create(index)),
            (Step::Create(_), CREATE_BLOCK, 0 | EXISTS) => Some(Step::Start),
            (Step::Start, START_BLOCK, 0) => Some(Step::Done),
            (Step::Delete(_), DELETE_BLOCK, _)
            | (Step::Create(_), CREATE_BLOCK, _)
            | (Step::Start, START_BLOCK, _) => Some(Step::Done),
            _ => None,
        }
    }
}

/// The vehicle's side of the log, for simulators: one variable, and one block of it.
#[derive(Clone, Debug, Default)]
pub struct LogServer {
    /// Number of the block, and `true` while it runs.
    block: Option<(u8, bool)>,
    period_ns: u64,
    due_ns: u64,
}

/// Index of the voltage in the table of the simulated vehicle, behind another variable.
const SIMULATED_INDEX: u16 = 1;
/// Items of that table: type, group and name.
const SIMULATED_ITEMS: [&[u8]; 2] = [b"\x07stabilizer\0roll\0", b"\x07pm\0vbat\0"];
const GET_INFO: u8 = 3;
const RESET: u8 = 5;

impl LogServer {
    /// Answers a packet to the log; `None` for any other packet.
    pub fn answer(&mut self, packet: &[u8], frame: &mut Frame) -> Option<()> {
        let (&first, payload) = packet.split_first()?;
        match (first | super::LINK_BITS, payload) {
            (TOC, &[GET_INFO]) => {
                // Items, a checksum of them, and the most blocks and variables.
                frame.push(&[TOC, GET_INFO, 2, 0, 0x07, 0x6d, 0x76, 0x62, 16, 128]);
            }
            (TOC, &[READ_ITEM, low, high]) => {
                let item = SIMULATED_ITEMS.get(usize::from(u16::from_le_bytes([low, high])));
                frame.push(&[TOC, READ_ITEM]);
                if let Some(item) = item {
                    frame.push(&[low, high]);
                    frame.push(item);
                }
            }
            (SETTINGS, &[RESET]) => {
                self.block = None;
                frame.push(&[SETTINGS, RESET, 0, 0]);
            }
            (SETTINGS, &[DELETE_BLOCK, block]) => {
                let is_there = self.block.take_if(|(number, _)| *number == block).is_some();
                let error = if is_there { 0 } else { NO_ENTRY };
                frame.push(&[SETTINGS, DELETE_BLOCK, block, error]);
            }
            (SETTINGS, &[CREATE_BLOCK, block, _, low, high]) => {
                let error = match self.block {
                    Some((number, _)) if number == block => EXISTS,
                    _ if u16::from_le_bytes([low, high]) != SIMULATED_INDEX => NO_ENTRY,
                    _ => {
                        self.block = Some((block, false));
                        0
                    }
                };
                frame.push(&[SETTINGS, CREATE_BLOCK, block, error]);
            }
            (SETTINGS, &[START_BLOCK, block, period]) => {
                let started = self.block.as_mut().filter(|(number, _)| *number == block);
                let error = if started.is_some() { 0 } else { NO_ENTRY };
                if let Some((_, runs)) = started {
                    *runs = true;
                    self.period_ns = u64::from(period.max(1)) * 10_000_000;
                }
                frame.push(&[SETTINGS, START_BLOCK, block, error]);
            }
            _ => return None,
        }
        Some(())
    }

    /// Appends the data of the block, if they are due.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the packet has a number of 32 bits"
    )]
    pub fn report(&mut self, voltage: f64, now_ns: u64, frame: &mut Frame) {
        let Some((block, true)) = self.block else { return };
        if now_ns < self.due_ns {
            return;
        }
        self.due_ns = now_ns + self.period_ns;
        let [a, b, c, ..] = (now_ns / 1_000_000).to_le_bytes();
        frame.push(&[DATA, block, a, b, c]);
        frame.push(&(voltage as f32).to_le_bytes());
    }
}
