//! iceoryx2 alone: the processes, topics, edges and sizes of a lock-step flight through the bare API. The floor of lock-step
//! flight.
//!
//! Five processes on one core take turns. In its turn each receives the sample of each of its inputs, publishes one on each
//! of its topics, and passes the turn on by a word of the shared page. A sixth process, like the recorder, subscribes to
//! every topic and reads once a millisecond. No step is computed, and no sample is examined or stored.

use std::os::fd::AsFd;
use std::process::{Child, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::deployment::{self, Scheduler};
use runtime::descriptors::{hand_on, inherited};
use runtime::doorbell::Doorbell;
use runtime::ports::{BarePorts, Delivery, RECORDER_BUFFER, Receiver, RunNode, TopicPorts};
use runtime::ring_order::RingOrder;
use runtime::shared_page::SharedPage;
use scenario::Scenario;
use shared_types::{Schedule, ServiceId};

use crate::member::{self, Ring, RingMember, RingWait};
use command_line::failure::Failure;
use command_line::output::print;
use run_client::run_root::RunRoot;

const MEMBERS: usize = ServiceId::ALL.len();
const PAGE_FD: i32 = 3;
const FIRST_DOORBELL_FD: i32 = 4;

/// Period at which the sixth process reads, as the recorder does.
const RECORDER_PERIOD: Duration = Duration::from_millis(1);

/// Measures the thousands of rounds per second of a ring on `core`, in a separate process, since a process can take part in
/// one run only.
///
/// # Errors
/// If the system does not permit it.
pub(super) fn thousand_rounds_per_second(
    wait: RingWait,
    fifo: bool,
    core: usize,
    rounds: u64,
) -> std::io::Result<f64> {
    let mut command = member::command();
    command.args(["ring", &rounds.to_string(), wait.name(), &core.to_string()]);
    if fifo {
        command.arg("--fifo");
    }
    let output = command.stdin(Stdio::null()).output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    text.trim().parse().map_err(|_| {
        let complaint = String::from_utf8_lossy(&output.stderr);
        std::io::Error::other(complaint.trim().to_owned())
    })
}

/// Measures one ring and prints its thousands of rounds per second.
///
/// # Errors
/// [`Failure`].
pub(super) fn ring(arguments: &Ring) -> Result<(), Failure> {
    let schedule = schedule();
    let root = RunRoot::create().map_err(Failure::trouble)?;
    let node = RunNode::join(&root.configuration(), "ring").map_err(Failure::trouble)?;
    let mut recorder = Recorder::subscribe(&node, &schedule).map_err(Failure::trouble)?;
    let page = SharedPage::create().map_err(Failure::trouble)?;
    let doorbells: Vec<_> = (0..MEMBERS)
        .map(|_| Doorbell::create())
        .collect::<std::io::Result<_>>()
        .map_err(Failure::trouble)?;
    let mut members = Members(Vec::new());
    for index in 0..MEMBERS {
        let member = spawn(index, arguments, &root, &page, &doorbells);
        members.0.push(member.map_err(Failure::trouble)?);
    }
    let rate = time(arguments.rounds, &mut members, &mut recorder, &page, &doorbells);
    print(format!("{}\n", rate.map_err(Failure::trouble)?));
    Ok(())
}

/// Runs the ring once all members have arrived and are connected. Returns the thousands of rounds per second.
fn time(
    rounds: u64,
    members: &mut Members,
    recorder: &mut Recorder,
    page: &SharedPage,
    doorbells: &[Doorbell],
) -> Result<f64, Box<dyn std::error::Error + Send + Sync>> {
    let arrived = || page.control_block().misses.load(Ordering::Acquire);
    while arrived() < u32::try_from(MEMBERS).expect("few members") {
        members.check()?;
        std::thread::yield_now();
    }
    recorder.connect()?;
    // Members connect once all ports exist, and the first one begins once all are connected.
    page.control_block().restarts.store(1, Ordering::Release);
    while arrived() < u32::try_from(2 * MEMBERS).expect("few members") {
        members.check()?;
        std::thread::yield_now();
    }
    let started = Instant::now();
    doorbells[0].ring();
    let last = &page.control_block().cells[MEMBERS - 1].steps_until;
    while last.load(Ordering::Acquire) < rounds {
        recorder.drain()?;
        members.check_failures()?;
        std::thread::sleep(RECORDER_PERIOD);
    }
    let seconds = started.elapsed().as_secs_f64();
    recorder.drain()?;
    members.wait()?;
    assert_eq!(
        recorder.received,
        rounds * recorder.receivers.len() as u64,
        "every sample of every topic was received"
    );
    #[expect(clippy::cast_precision_loss, reason = "few rounds")]
    Ok(rounds as f64 / 1000.0 / seconds)
}

/// Returns the schedule of Fig. 1.
fn schedule() -> Schedule {
    let scenario: Scenario = toml::from_str(super::SCENARIO).expect("a committed scenario");
    scenario.schedule().expect("a committed scenario")
}

/// A subscriber of every topic.
struct Recorder {
    receivers: Vec<Box<dyn Receiver>>,
    received: u64,
    _topics: Vec<Box<dyn TopicPorts>>,
}

impl Recorder {
    fn subscribe(node: &RunNode, schedule: &Schedule) -> Result<Self, runtime::ports::PortError> {
        let topics = schedule
            .published_topics()
            .map(|topic| node.create_topic(topic, schedule, Delivery::Lossless))
            .collect::<Result<Vec<_>, _>>()?;
        let receivers = topics.iter().map(|topic| topic.recorder(RECORDER_BUFFER));
        Ok(Self {
            receivers: receivers.collect::<Result<_, _>>()?,
            received: 0,
            _topics: topics,
        })
    }

    fn connect(&mut self) -> Result<(), runtime::ports::PortError> {
        self.receivers
            .iter_mut()
            .try_for_each(|receiver| receiver.connect())
    }

    fn drain(&mut self) -> Result<(), runtime::ports::PortError> {
        for receiver in &mut self.receivers {
            while receiver.receive()? {
                std::hint::black_box(receiver.held());
                self.received += 1;
            }
        }
        Ok(())
    }
}

/// Processes of a measurement, killed when dropped.
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

    /// Returns an error if a member has failed; members may have finished.
    fn check_failures(&mut self) -> std::io::Result<()> {
        for child in &mut self.0 {
            if let Some(status) = child.try_wait()?
                && !status.success()
            {
                return Err(std::io::Error::other(format!("a member failed: {status}")));
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
            // Both fail only for a process that has ended.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn spawn(
    index: usize,
    ring: &Ring,
    root: &RunRoot,
    page: &SharedPage,
    doorbells: &[Doorbell],
) -> std::io::Result<Child> {
    let mut command = member::command();
    let numbers = [index.to_string(), ring.rounds.to_string()];
    command
        .arg("ring-member")
        .args(numbers)
        .arg(ring.wait.name())
        .arg(ring.core.to_string())
        .arg(root.configuration())
        .stdin(Stdio::null())
        .stdout(Stdio::null());
    if ring.fifo {
        command.arg("--fifo");
    }
    // Like the services.
    deployment::disable_restartable_sequences(&mut command);
    let files = std::iter::once(page.file()).chain(doorbells.iter().map(AsFd::as_fd));
    hand_on(&mut command, PAGE_FD, files)?;
    command.spawn()
}

/// Runs a member of the ring: waits for the previous one, takes its turn, and repeats.
///
/// # Errors
/// [`Failure`].
pub(super) fn ring_member(arguments: &RingMember) -> Result<(), Failure> {
    run_member(arguments).map_err(Failure::trouble)
}

fn run_member(arguments: &RingMember) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    deployment::die_with_parent()?;
    deployment::pin_to(&[arguments.core])?;
    let scheduler = match arguments.wait {
        _ if arguments.fifo => Scheduler::Fifo,
        RingWait::Yield => Scheduler::Fair,
        RingWait::Eventfd => Scheduler::Batch,
    };
    match deployment::use_scheduler(scheduler) {
        // A sandbox may refuse it: then a woken process sometimes preempts the one that woke it.
        Err(_) if scheduler == Scheduler::Batch => {}
        result => result?,
    }
    let page = SharedPage::open(inherited(PAGE_FD)?)?;
    let doorbells = (FIRST_DOORBELL_FD..)
        .take(MEMBERS)
        .map(|file| inherited(file).map(Doorbell::inherited))
        .collect::<std::io::Result<Vec<_>>>()?;
    let (me, before, after) = (
        arguments.index,
        (arguments.index + MEMBERS - 1) % MEMBERS,
        (arguments.index + 1) % MEMBERS,
    );
    let node = RunNode::join(&arguments.configuration, ServiceId::ALL[me].name())?;
    let mut ports = BarePorts::open(&node, ServiceId::ALL[me], &schedule())?;
    let block = page.control_block();
    block.misses.fetch_add(1, Ordering::AcqRel);
    while block.restarts.load(Ordering::Acquire) == 0 {
        std::thread::yield_now();
    }
    ports.connect()?;
    block.misses.fetch_add(1, Ordering::AcqRel);
    let turns = |index: usize| block.cells[index].steps_until.load(Ordering::Acquire);
    if arguments.wait == RingWait::Yield {
        doorbells[me].sleep();
        // Under FIFO, yields preserve the order of the run queue: the first member wakes the others in the order of the ring
        // before it yields itself.
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
                order.count_wasted();
            },
            RingWait::Eventfd => doorbells[me].sleep(),
        }
        ports.receive(round > 0)?;
        ports.publish()?;
        block.cells[me].steps_until.store(round + 1, Ordering::Release);
        if arguments.wait == RingWait::Eventfd {
            doorbells[after].ring();
        }
    }
    Ok(())
}
