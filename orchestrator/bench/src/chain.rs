//! A bare chain: five processes on one core that pass on an iceoryx2 event, four hops from the first to the last. The floor of
//! flight in real time.
//!
//! The first process sleeps to absolute deadlines and sends; the last one measures, and no other reads the clock. The sending
//! time is passed on beside the event, in a word of the shared page: if two events merge, the newer one is measured, as in a
//! flight the newest sample counts.

use std::error::Error;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use hdrhistogram::Histogram;
use runtime::deployment::{self, FIFO_PRIORITY};
use runtime::descriptors::{hand_on, inherited};
use runtime::flight_clock::{FlightClock, monotonic_ns, nap_until};
use runtime::ports::{BareEvent, RunNode};
use runtime::shared_page::{ControlBlock, SharedPage};
use scenario::ServiceDeployment;
use shared_types::ServiceId;

use super::ring::Members;
use crate::member::{self, ChainMember};
use command_line::failure::Failure;
use command_line::output::print;
use metrics::summary::timing::{self, Quantiles};
use run_client::run_root::RunRoot;

const MEMBERS: usize = ServiceId::ALL.len();
const PAGE_FD: i32 = 3;

/// Period of the rounds, ns: that of the flight for comparison.
const PERIOD_NS: u64 = 1_000_000;

/// Time from the arrival of all processes to the first round.
const COUNTDOWN: Duration = Duration::from_millis(5);

/// Maximum wait for an event before the next check.
const LONGEST_WAIT: Duration = Duration::from_millis(100);

/// The value passed on in place of a time at the end.
const THE_END: u64 = u64::MAX;

/// Measures the latency from the first to the last process of a bare chain on `core`.
///
/// # Errors
/// If the system does not permit it.
pub(super) fn four_hops(core: usize, fifo: bool, rounds: u64) -> std::io::Result<Quantiles> {
    let root = RunRoot::create()?;
    let page = SharedPage::create()?;
    let block = page.control_block();
    let mut members = Members(Vec::new());
    for index in 0..MEMBERS {
        let member = spawn(index, core, fifo, rounds, &root.configuration(), &page)?;
        members.0.push(member);
        // Each creates the event that the next one opens.
        while block.misses.load(Ordering::Acquire) < u32::try_from(members.0.len()).expect("few members") {
            members.check()?;
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    let clock = FlightClock::starting_in(COUNTDOWN, PERIOD_NS);
    block.start_ns.store(clock.start_ns, Ordering::Release);
    let output = members.0.last_mut().and_then(|last| last.stdout.take());
    members.wait()?;
    let mut text = String::new();
    output
        .expect("the output of the last process is piped")
        .read_to_string(&mut text)?;
    Ok(serde_json::from_str(&text)?)
}

fn spawn(
    index: usize,
    core: usize,
    fifo: bool,
    rounds: u64,
    configuration: &Path,
    page: &SharedPage,
) -> std::io::Result<Child> {
    let mut command = member::command();
    command
        .arg("chain-member")
        .args([index.to_string(), rounds.to_string(), core.to_string()])
        .arg(configuration)
        .args(fifo.then_some("--fifo"))
        .stdin(Stdio::null())
        .stdout(Stdio::piped());
    // Like the services.
    deployment::disable_restartable_sequences(&mut command);
    hand_on(&mut command, PAGE_FD, [page.file()])?;
    command.spawn()
}

/// Runs a process of the chain: sends, passes on or measures, by its index.
///
/// # Errors
/// [`Failure`].
pub(super) fn chain_member(arguments: &ChainMember) -> Result<(), Failure> {
    run_member(arguments).map_err(Failure::trouble)
}

fn run_member(arguments: &ChainMember) -> Result<(), Box<dyn Error + Send + Sync>> {
    deployment::die_with_parent()?;
    let settings = ServiceDeployment {
        core: Some(arguments.core),
        priority: arguments.fifo.then_some(FIFO_PRIORITY),
        timer_slack: Some(1e-9),
        ..ServiceDeployment::default()
    };
    if let Some(refusal) = deployment::apply(&settings).first() {
        return Err(refusal.to_string().into());
    }
    let page = SharedPage::open(inherited(PAGE_FD)?)?;
    let node = RunNode::join(&arguments.configuration, "chain-member")?;
    let block = page.control_block();
    let me = arguments.index;
    match (me, me + 1) {
        (0, _) => send(&BareEvent::create(&node, &hop(0))?, block, arguments.rounds)?,
        (_, MEMBERS) => {
            let times = measure(&BareEvent::open(&node, &hop(me - 1))?, block)?;
            let quantiles = Quantiles::of(&times).ok_or("no event has reached the end of the chain")?;
            print(serde_json::to_string(&quantiles)?);
        }
        _ => pass_on(
            &BareEvent::open(&node, &hop(me - 1))?,
            &BareEvent::create(&node, &hop(me))?,
            block,
            me,
        )?,
    }
    Ok(())
}

/// Returns the name of the event from the member of an index to the next one.
fn hop(index: usize) -> String {
    format!("hop/{index}")
}

/// Returns the sending time of the newest round that has reached a member, or [`THE_END`].
fn newest(block: &ControlBlock, index: usize) -> &AtomicU64 {
    &block.cells[index].steps_until
}

/// Runs the first member: sends an event every period.
fn send(to: &BareEvent, block: &ControlBlock, rounds: u64) -> Result<(), Box<dyn Error + Send + Sync>> {
    let notifier = to.notifier()?;
    block.misses.fetch_add(1, Ordering::AcqRel);
    while block.start_ns.load(Ordering::Acquire) == 0 {
        sleep_until(monotonic_ns() + PERIOD_NS);
    }
    let clock = FlightClock {
        start_ns: block.start_ns.load(Ordering::Acquire),
        tick_ns: PERIOD_NS,
    };
    for round in 0..=rounds {
        sleep_until(clock.begins_at(round));
        let is_over = round == rounds;
        let sent = if is_over { THE_END } else { monotonic_ns() };
        newest(block, 0).store(sent, Ordering::Release);
        notifier.notify()?;
    }
    Ok(())
}

fn sleep_until(at_ns: u64) {
    while monotonic_ns() < at_ns {
        nap_until(at_ns);
    }
}

/// Runs a member in the middle: passes events on.
fn pass_on(
    from: &BareEvent,
    to: &BareEvent,
    block: &ControlBlock,
    me: usize,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let listener = from.listener()?;
    let notifier = to.notifier()?;
    block.misses.fetch_add(1, Ordering::AcqRel);
    let mut last = 0;
    while last != THE_END {
        listener.wait(LONGEST_WAIT)?;
        let sent = newest(block, me - 1).load(Ordering::Acquire);
        if sent != last {
            last = sent;
            newest(block, me).store(sent, Ordering::Release);
            notifier.notify()?;
        }
    }
    Ok(())
}

/// Runs the last member: measures the latency from the first.
fn measure(from: &BareEvent, block: &ControlBlock) -> Result<Histogram<u64>, Box<dyn Error + Send + Sync>> {
    let listener = from.listener()?;
    let mut times = timing::histogram();
    block.misses.fetch_add(1, Ordering::AcqRel);
    let mut last = 0;
    loop {
        listener.wait(LONGEST_WAIT)?;
        let sent = newest(block, MEMBERS - 2).load(Ordering::Acquire);
        if sent == THE_END {
            return Ok(times);
        }
        if sent != last {
            times.saturating_record(monotonic_ns().saturating_sub(sent));
            last = sent;
        }
    }
}
