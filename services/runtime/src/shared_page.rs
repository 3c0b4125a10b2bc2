//! Control block: one page of shared words by which the processes of a run coordinate their waiting.
//!
//! Except for the operator's requests and [gains](TuningRing) it carries no data of the experiment: losing or corrupting it
//! can only cost time or end the run. It is an anonymous file that the orchestrator creates and every service inherits.
#![expect(
    unsafe_code,
    reason = "a page shared by several processes can only be reached by mapping it"
)]

use std::os::fd::{BorrowedFd, OwnedFd};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use rustix::thread::futex;
use serde::{Deserialize, Serialize};
use shared_types::schedule::MAX_PORTS;
use shared_types::service::{ARM_COUNTS, Operator};
use shared_types::{ServiceId, Topic};

use crate::announcement;
use crate::shared_file::SharedFile;
use crate::status_cell::StatusCell;
use crate::tuning::TuningRing;

/// Contents of the page, initially 0.
#[repr(C)]
#[derive(Debug, Default)]
pub struct ControlBlock {
    /// In real time, requests of the operator: the bits of [`Request`]. The word stays first and its bits keep their
    /// meaning, so that `gerono kill` of another build finds it here ([`ask_in`]).
    requests: AtomicU32,
    /// Not 0 if the run and all waits are to end. Relaxed accesses suffice: it publishes no other data,
    /// and the orchestrator rings the doorbells after it.
    pub stopping: AtomicU32,
    /// Not 0 while yielding does not pay and every service blocks at once; see [`crate::wait_policy::BLOCK_ALWAYS`].
    pub block_only: AtomicU32,
    /// Wasted or too long yields since the last decision of the wait policy.
    pub misses: AtomicU32,
    /// Number of restarts. Services that read a new value connect to the new ports.
    pub restarts: AtomicU32,
    /// In real time, beginning of tick 0, ns of `CLOCK_MONOTONIC`; set before the first service flies.
    pub start_ns: AtomicU64,
    /// In real time, last sign of life of the orchestrator, ns of `CLOCK_MONOTONIC`.
    pub orchestrator_alive_ns: AtomicU64,
    /// Words of each service.
    pub cells: [Cell; ServiceId::ALL.len()],
    /// The recorder's receivers.
    pub recorder: [ReceiverId; Topic::ALL.len()],
    /// Status of a laboratory's motion-capture system.
    pub cameras_status: StatusCell,
    /// Status of receivers and autopilots that measure.
    pub receivers_status: StatusCell,
    /// Status of the radio link.
    pub link_status: StatusCell,
    /// In real time, gains that the operator has changed in flight.
    pub tuning: TuningRing,
}

/// Words of one service, on separate cache lines to avoid false sharing.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub struct Cell {
    /// 0, or 1 + the index of the service whose publication this service sleeps for.
    pub waiting_for: AtomicU32,
    /// Wake-ups of the service in real time; the service sleeps on this word.
    pub bell: AtomicU32,
    /// Value of [`ControlBlock::restarts`] up to which this service is connected to the new ports.
    pub restarts_seen: AtomicU32,
    /// Not 0 from the detection of the service's death until its replacement flies: in real time no service waits for it
    /// meanwhile.
    pub gone: AtomicU32,
    /// 1 + the tick of the service's last step, 0 before the first.
    pub steps_until: AtomicU64,
    /// Steps.
    pub steps: AtomicU64,
    /// Waits that ended without sleep.
    pub yields: AtomicU64,
    /// Waits that ended in sleep.
    pub blocks: AtomicU64,
    /// The service's receivers, for which publishers wait.
    pub receivers: [ReceiverId; MAX_PORTS],
}

const _: () = assert!(
    std::mem::offset_of!(ControlBlock, requests) == 0,
    "`ask_in` maps this word alone"
);

const _: () = assert!(
    size_of::<Cell>() == 192 && std::mem::offset_of!(ControlBlock, cells).is_multiple_of(align_of::<Cell>()),
    "no two services write the same cache line"
);

/// Id of a receiver of the run, or 0. One process writes it and others read it at any time.
///
/// The halves are stored one by one with relaxed order. A reader in between reads an id that no receiver has, and treats it
/// as a receiver outside of the run.
#[repr(C)]
#[derive(Debug, Default)]
pub struct ReceiverId([AtomicU64; 2]);

impl ReceiverId {
    /// Publishes the id of a receiver.
    pub fn store(&self, id: u128) {
        self.0[0].store(id as u64, Ordering::Relaxed);
        self.0[1].store((id >> 64) as u64, Ordering::Relaxed);
    }

    #[inline]
    fn load(&self) -> u128 {
        let [low, high] = [&self.0[0], &self.0[1]].map(|half| u128::from(half.load(Ordering::Relaxed)));
        low | high << 64
    }
}

/// Request of the operator to a flight in real time. It outlives every service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Request {
    /// The motors may turn.
    Arm,
    /// The motors stop, in the air too, until the next arming.
    Disarm,
    /// The vehicle lands and is disarmed.
    Land,
    /// The motors stop at once, for the rest of the run.
    Kill,
}

const ARMED: u32 = 1;
const DISARMED: u32 = 2;
const LAND: u32 = 4;
const KILLED: u32 = 8;
/// Lowest bit of the number of requests to arm, which fills the word from here on.
const ARM_COUNT: u32 = 1 << 8;

/// Owner of a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// A service's.
    Service(ServiceId),
    /// The recorder's.
    Recorder,
}

impl ControlBlock {
    /// Returns the owner of a receiver, if the receiver belongs to the run.
    #[must_use]
    pub fn owner(&self, id: u128) -> Option<Owner> {
        let has = |receivers: &[ReceiverId]| receivers.iter().any(|receiver| receiver.load() == id);
        let mut services = ServiceId::ALL.into_iter();
        let service = services.find(|service| has(&self.cells[service.index()].receivers));
        match service {
            Some(service) => Some(Owner::Service(service)),
            None => has(&self.recorder).then_some(Owner::Recorder),
        }
    }

    /// Adds a request. Of [`Request::Arm`] and [`Request::Disarm`] the newest one holds; the others are permanent.
    pub fn ask(&self, request: Request) {
        add(&self.requests, request);
    }

    /// Returns the requests of the operator, planned and made in flight.
    #[must_use]
    #[inline]
    pub fn operator(&self, planned: Operator) -> Operator {
        let bits = self.requests.load(Ordering::Acquire);
        let has = |bit| bits & bit != 0;
        Operator {
            armed: (planned.armed || has(ARMED)) && !has(DISARMED),
            arm_count: arm_count(planned, bits),
            land: planned.land || has(LAND),
            killed: planned.killed || has(KILLED),
        }
    }

    /// Removes the receivers of a service, so that no publisher waits for them.
    pub fn forget_receivers(&self, service: ServiceId) {
        for receiver in &self.cells[service.index()].receivers {
            receiver.store(0);
        }
    }
}

/// Returns the number of requests to arm, planned and made in flight.
#[inline]
fn arm_count(planned: Operator, bits: u32) -> u8 {
    let count = (bits / ARM_COUNT + u32::from(planned.arm_count)) % u32::from(ARM_COUNTS);
    u8::try_from(count).unwrap_or_default()
}

/// Adds a request to the earlier ones.
///
/// One atomic read-modify-write: with a separate load and store, a kill by another process between the two would be lost.
fn add(requests: &AtomicU32, request: Request) {
    let change = |bits: u32| match request {
        Request::Arm => (bits & !DISARMED | ARMED).wrapping_add(ARM_COUNT),
        Request::Disarm => bits & !ARMED | DISARMED,
        Request::Land => bits | LAND,
        Request::Kill => bits | KILLED,
    };
    let update = |bits| Some(change(bits));
    // Cannot fail: `update` always returns a value.
    let _ = requests.fetch_update(Ordering::AcqRel, Ordering::Acquire, update);
}

/// Adds a request to the page of another process's run, of whatever build.
///
/// # Errors
/// If the file cannot be mapped.
pub fn ask_in(page: BorrowedFd<'_>, request: Request) -> std::io::Result<()> {
    let size = u64::try_from(rustix::fs::fstat(page)?.st_size).unwrap_or_default();
    if size < size_of::<AtomicU32>() as u64 {
        return Err(std::io::Error::other("the page is empty"));
    }
    let mapping = memmap2::MmapOptions::new()
        .len(size_of::<AtomicU32>())
        .map_raw(&page)?;
    // SAFETY: the mapping is page-aligned, holds the word, and outlives the borrow; an atomic is valid for every bit pattern
    // and safe to be written by other processes meanwhile.
    add(unsafe { &*mapping.as_mut_ptr().cast::<AtomicU32>() }, request);
    Ok(())
}

impl Cell {
    /// Wakes the service from its sleep in real time.
    #[inline]
    pub fn ring(&self) {
        announcement::count_ring(&self.bell);
        // The call cannot fail for a mapped word.
        let _ = futex::wake(&self.bell, futex::Flags::empty(), 1);
    }

    /// Increments a counter that only this process writes: a load and a store suffice, without a locked instruction.
    #[inline]
    pub fn count(counter: &AtomicU64) {
        counter.store(counter.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
    }
}

/// Mapping of the shared page.
#[derive(Debug)]
pub struct SharedPage(SharedFile);

impl SharedPage {
    /// Name of the file in the system: `/memfd:` and this.
    pub const NAME: &str = "gerono-page";

    /// Creates the page of a run.
    ///
    /// # Errors
    /// If the system has no memory or no file descriptor left.
    pub fn create() -> std::io::Result<Self> {
        SharedFile::create(Self::NAME, size_of::<ControlBlock>()).map(Self)
    }

    /// Maps an inherited page.
    ///
    /// # Errors
    /// If the file has another size.
    pub fn open(file: OwnedFd) -> std::io::Result<Self> {
        SharedFile::open(file, size_of::<ControlBlock>()).map(Self)
    }

    /// Returns the file that a service inherits.
    #[must_use]
    pub fn file(&self) -> BorrowedFd<'_> {
        self.0.file()
    }

    /// Returns the control block.
    #[must_use]
    #[inline]
    pub fn control_block(&self) -> &ControlBlock {
        // SAFETY: the mapping lives as long as `self`, is page-aligned, holds `size_of::<ControlBlock>()` bytes
        // (checked by `SharedFile`), and `ControlBlock` consists of atomics and padding, valid for every bit pattern and
        // safe to be written by other processes meanwhile.
        unsafe { &*self.0.as_mut_ptr().cast::<ControlBlock>() }
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsFd;

    use super::*;

    #[test]
    fn disarming_revokes_arming_and_a_kill_is_permanent() {
        let block = ControlBlock::default();
        assert_eq!(block.operator(Operator::default()), Operator::default());
        block.ask(Request::Arm);
        assert_eq!(block.operator(Operator::default()), Operator::FLYING);
        block.ask(Request::Kill);
        block.ask(Request::Disarm);
        block.ask(Request::Arm);
        assert!(block.operator(Operator::default()).killed && block.operator(Operator::FLYING).killed);
    }

    #[test]
    fn every_request_to_arm_has_a_number_of_its_own_and_leaves_the_other_requests() {
        let block = ControlBlock::default();
        let counts: Vec<_> = (0..u32::from(ARM_COUNTS))
            .map(|_| {
                block.ask(Request::Arm);
                block.operator(Operator::default()).arm_count
            })
            .collect();
        let expected: Vec<_> = (1..ARM_COUNTS).chain([0]).collect();
        assert_eq!(counts, expected);
        assert_eq!(
            block.operator(Operator::FLYING).arm_count,
            1,
            "after a planned one"
        );
        // The count overflows its bits, and no other request comes of it.
        block.requests.store(!(LAND | KILLED), Ordering::Relaxed);
        block.ask(Request::Arm);
        assert_eq!(
            block.operator(Operator::default()),
            Operator {
                arm_count: 0,
                ..Operator::FLYING
            }
        );
    }

    #[test]
    fn a_request_needs_only_the_file_of_the_page() {
        let page = SharedPage::create().unwrap();
        ask_in(page.file(), Request::Kill).unwrap();
        assert!(page.control_block().operator(Operator::FLYING).killed);
        let empty = rustix::fs::memfd_create("empty", rustix::fs::MemfdFlags::CLOEXEC).unwrap();
        assert!(ask_in(empty.as_fd(), Request::Kill).is_err());
    }

    #[test]
    fn a_request_to_disarm_overrides_the_plan() {
        let block = ControlBlock::default();
        block.ask(Request::Disarm);
        assert!(!block.operator(Operator::FLYING).armed);
        block.ask(Request::Land);
        block.ask(Request::Arm);
        let landing = Operator {
            land: true,
            ..Operator::FLYING
        };
        assert_eq!(block.operator(Operator::default()), landing);
    }
}
