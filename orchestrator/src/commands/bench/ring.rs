//! Bare rings: five processes on one core that hand on nothing but the turn. The floor of lock-step flight.

use std::os::fd::{AsFd, OwnedFd};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::Instant;

use runtime::deployment::{self, Scheduler};
use runtime::descriptors::{hand_on, inherited};
use runtime::shared_page::SharedPage;
use rustix::event::{EventfdFlags, eventfd};
use shared_types::ServiceId;

use crate::cli::{RingMember, RingWait};
use crate::commands::Failure;
use crate::exit::Exit;

const MEMBERS: usize = ServiceId::ALL.len();
const PAGE_FD: i32 = 3;
const FIRST_EVENT_FD: i32 = 4;

/// Thousands of rounds per second of a bare ring on `core`.
///
/// # Errors
/// If the system does not permit it.
pub(super) fn thousand_rounds_per_second(
    wait: RingWait,
    fifo: bool,
    core: usize,
    rounds: u64,
) -> std::io::Result<f64> {
    let page = SharedPage::create()?;
    let events = (0..MEMBERS)
        .map(|_| eventfd(0, EventfdFlags::CLOEXEC))
        .collect::<Result<Vec<_>, _>>()?;
    let mut members = Members(Vec::new());
    for place in 0..MEMBERS {
        members
            .0
            .push(spawn(place, wait, fifo, core, rounds, &page, &events)?);
    }
    // Everyone has arrived: the first may begin.
    let words = page.words();
    while words.misses.load(Ordering::Acquire) < u32::try_from(MEMBERS).expect("few members") {
        members.check()?;
        std::thread::yield_now();
    }
    let started = Instant::now();
    ring_bell(&events[0])?;
    members.wait()?;
    #[expect(clippy::cast_precision_loss, reason = "few rounds")]
    Ok(rounds as f64 / 1000.0 / started.elapsed().as_secs_f64())
}

/// Processes of a measurement; killed if that is given up, or when it no longer needs them.
pub(super) struct Members(pub(super) Vec<Child>);

impl Members {
    pub(super) fn check(&mut self) -> std::io::Result<()> {
        for child in &mut self.0 {
            if let Some(status) = child.try_wait()? {
                return Err(std::io::Error::other(format!("a member ended early: {status}")));
            }
        }
        Ok(())
    }

    pub(super) fn wait(&mut self) -> std::io::Result<()> {
        for child in &mut self.0 {
            let status = child.wait()?;
            if !status.success() {
                return Err(std::io::Error::other(format!("a member failed: {status}")));
            }
        }
        Ok(())
    }
}

impl Drop for Members {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // Both fail only for a process that is gone.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn spawn(
    place: usize,
    wait: RingWait,
    fifo: bool,
    core: usize,
    rounds: u64,
    page: &SharedPage,
    events: &[OwnedFd],
) -> std::io::Result<Child> {
    let mut command = Command::new("/proc/self/exe");
    command.args(["ring-member", &place.to_string(), &rounds.to_string()]);
    command.arg(match wait {
        RingWait::Yield => "yield",
        RingWait::Eventfd => "eventfd",
    });
    command
        .arg(core.to_string())
        .stdin(Stdio::null())
        .stdout(Stdio::null());
    if fifo {
        command.arg("--fifo");
    }
    let files = std::iter::once(page.file()).chain(events.iter().map(AsFd::as_fd));
    hand_on(&mut command, PAGE_FD, files)?;
    command.spawn()
}

/// `gerono ring-member`: waits for its neighbour, takes its turn, and so on.
///
/// # Errors
/// [`Failure`].
pub fn ring_member(arguments: &RingMember) -> Result<(), Failure> {
    go_around(arguments).map_err(|error| Failure::new(Exit::Trouble, error))
}

fn go_around(arguments: &RingMember) -> std::io::Result<()> {
    deployment::die_with_parent()?;
    deployment::pin_to(&[arguments.core])?;
    // As batch, who is woken waits for its turn, as under FIFO.
    let scheduler = if arguments.fifo {
        Scheduler::Fifo
    } else {
        Scheduler::Batch
    };
    deployment::use_scheduler(scheduler)?;
    let page = SharedPage::open(inherited(PAGE_FD)?)?;
    let events = (FIRST_EVENT_FD..)
        .take(MEMBERS)
        .map(inherited)
        .collect::<std::io::Result<Vec<_>>>()?;
    let (me, before, after) = (
        arguments.place,
        (arguments.place + MEMBERS - 1) % MEMBERS,
        (arguments.place + 1) % MEMBERS,
    );
    let words = page.words();
    words.misses.fetch_add(1, Ordering::AcqRel);
    let turns = |place: usize| words.cells[place].steps_until.load(Ordering::Acquire);
    let sleep = || rustix::io::retry_on_intr(|| rustix::io::read(&events[me], &mut [0u8; 8])).map(drop);
    if arguments.wait == RingWait::Yield {
        sleep()?;
        // Yields keep the order in which they begin: the first one makes all ready in the ring's, before it yields itself.
        // In another order it takes several yields to hand on the turn.
        let others = if me == 0 { &events[1..] } else { &[] };
        others.iter().try_for_each(ring_bell)?;
    }
    for round in 0..arguments.rounds {
        let needed = if me == 0 { round } else { round + 1 };
        match arguments.wait {
            RingWait::Yield => {
                while turns(before) < needed {
                    rustix::thread::sched_yield();
                }
            }
            RingWait::Eventfd => sleep()?,
        }
        words.cells[me].steps_until.store(round + 1, Ordering::Release);
        if arguments.wait == RingWait::Eventfd {
            ring_bell(&events[after])?;
        }
    }
    Ok(())
}

fn ring_bell(event: &OwnedFd) -> std::io::Result<()> {
    rustix::io::write(event, &1u64.to_ne_bytes())?;
    Ok(())
}
