//! Bare rings: five processes on one core that hand on nothing but the turn. The floor of lock-step flight.

use std::os::fd::AsFd;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::Instant;

use runtime::deployment::{self, Scheduler};
use runtime::descriptors::{hand_on, inherited};
use runtime::doorbell::Doorbell;
use runtime::ring_order::RingOrder;
use runtime::shared_page::SharedPage;
use shared_types::ServiceId;

use crate::cli::{RingMember, RingWait};
use crate::commands::Failure;
use crate::exit::Exit;

const MEMBERS: usize = ServiceId::ALL.len();
const PAGE_FD: i32 = 3;
const FIRST_DOORBELL_FD: i32 = 4;

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
    let doorbells = (0..MEMBERS)
        .map(|_| Doorbell::create())
        .collect::<std::io::Result<Vec<_>>>()?;
    let mut members = Members(Vec::new());
    for place in 0..MEMBERS {
        members
            .0
            .push(spawn(place, wait, fifo, core, rounds, &page, &doorbells)?);
    }
    // Everyone has arrived: the first may begin.
    let words = page.words();
    while words.misses.load(Ordering::Acquire) < u32::try_from(MEMBERS).expect("few members") {
        members.check()?;
        std::thread::yield_now();
    }
    let started = Instant::now();
    doorbells[0].ring();
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
    doorbells: &[Doorbell],
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
    // Like the services.
    deployment::spare_switches(&mut command);
    let files = std::iter::once(page.file()).chain(doorbells.iter().map(AsFd::as_fd));
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
    let scheduler = match arguments.wait {
        _ if arguments.fifo => Scheduler::Fifo,
        RingWait::Yield => Scheduler::Fair,
        RingWait::Eventfd => Scheduler::Batch,
    };
    match deployment::use_scheduler(scheduler) {
        // A sandbox may refuse it: then who is woken now and then pushes off the core who woke it.
        Err(_) if scheduler == Scheduler::Batch => {}
        result => result?,
    }
    let page = SharedPage::open(inherited(PAGE_FD)?)?;
    let doorbells = (FIRST_DOORBELL_FD..)
        .take(MEMBERS)
        .map(|file| inherited(file).map(Doorbell::inherited))
        .collect::<std::io::Result<Vec<_>>>()?;
    let (me, before, after) = (
        arguments.place,
        (arguments.place + MEMBERS - 1) % MEMBERS,
        (arguments.place + 1) % MEMBERS,
    );
    let words = page.words();
    words.misses.fetch_add(1, Ordering::AcqRel);
    let turns = |place: usize| words.cells[place].steps_until.load(Ordering::Acquire);
    if arguments.wait == RingWait::Yield {
        doorbells[me].sleep();
        // Under FIFO yields keep the order in which they begin: the first one makes all ready in the ring's, before it
        // yields itself.
        let others = if me == 0 { &doorbells[1..] } else { &[] };
        others.iter().for_each(Doorbell::ring);
    }
    let mut order = RingOrder::new(ServiceId::ALL[me], scheduler);
    for round in 0..arguments.rounds {
        let needed = if me == 0 { round } else { round + 1 };
        match arguments.wait {
            RingWait::Yield => loop {
                if turns(before) >= needed {
                    break;
                }
                order.yield_core();
                if turns(before) >= needed {
                    break;
                }
                order.was_in_vain();
            },
            RingWait::Eventfd => doorbells[me].sleep(),
        }
        words.cells[me].steps_until.store(round + 1, Ordering::Release);
        if arguments.wait == RingWait::Eventfd {
            doorbells[after].ring();
        }
    }
    Ok(())
}
