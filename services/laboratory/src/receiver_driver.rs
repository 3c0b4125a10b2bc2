//! Receivers and autopilots that measure, in place of the simulated plant.
//!
//! A thread for each source receives, decodes and stamps packets with their arrival, and reopens a source that is lost. A step
//! takes packets from a queue of fixed capacity: without a lock, a system call or an allocation. `vehicle/truth` is never due: the
//! truth is unknown.
//!
//! A restarted driver resumes with the clocks of its predecessor, if they are recent, and with its altitude.

use std::fmt::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use navigation_receivers::Packet;
use navigation_receivers::counts::Counts;
use navigation_receivers::stream::Stream;
use runtime::flight_clock::monotonic_ns;
use runtime::shared_page::SharedPage;
use scenario::{Receivers, Scenario};
use shared_types::receiver_figures::ReceiverFigures;
use shared_types::receiver_source::ReceiverSource;
use shared_types::service::{BuildError, ErasedService, InputView, OutputSlot, Outputs, nanoseconds};
use shared_types::wiring::PlantOutputs;
use shared_types::{Now, ServiceId};
use zerocopy::{FromBytes, IntoBytes};

use super::is_under_way;
use super::receiver_feed::{ReceiverFeed, ReceiverMemory};
use super::receiver_port::{self, Opened, Port, Read};
use super::status_text::StatusText;

/// Pause between attempts to reopen a source, and longest wait for its bytes.
const PAUSE: Duration = Duration::from_millis(100);
/// Attempts are as many pauses apart, and the first one after a loss.
const PAUSES: u32 = 5;
/// Bytes of one read; a UDP packet is at most as long.
const PIECE: usize = 65_536;
/// Packets between two steps; a driver that waits for the start of a flight drops newer ones.
const QUEUE: usize = 1024;
/// Size of a saved state, bytes.
pub(super) const STATE_SIZE: usize = size_of::<ReceiverMemory>();

/// Packets of a source, or its refusals.
struct Event {
    source: u8,
    /// ns of `CLOCK_MONOTONIC`.
    arrived_ns: u64,
    kind: EventKind,
}

enum EventKind {
    Packet(Packet),
    Counts(Counts),
}

/// State that a thread shares with the driver.
#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    is_open: AtomicBool,
    losses: AtomicU64,
    /// Packets for which the queue had no room.
    left_out: AtomicU64,
}

/// Thread that receives from a source.
struct ReceiverThread {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    counts: Counts,
}

impl ReceiverThread {
    fn start(
        index: u8,
        source: ReceiverSource,
        baud: u32,
        port: Option<Port>,
        events: SyncSender<Event>,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        shared.is_open.store(port.is_some(), Ordering::Relaxed);
        let for_thread = Arc::clone(&shared);
        let receiving = move || receive(index, &source, baud, port, &events, &for_thread);
        let thread = std::thread::Builder::new()
            .name("receiver".to_owned())
            .spawn(receiving)?;
        Ok(Self {
            shared,
            thread: Some(thread),
            counts: Counts::default(),
        })
    }
}

impl Drop for ReceiverThread {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that has panicked receives nothing, which is all that can be said of it.
            let _ = thread.join();
        }
    }
}

/// Receives from a source until the driver ends. Without a port it opens the source at once.
fn receive(
    index: u8,
    source: &ReceiverSource,
    baud: u32,
    mut port: Option<Port>,
    events: &SyncSender<Event>,
    shared: &Shared,
) {
    let mut bytes = vec![0; PIECE];
    let mut stream = Stream::default();
    let mut pauses = 0;
    while !shared.stop.load(Ordering::Relaxed) {
        let Some(opened) = &mut port else {
            if pauses > 0 {
                std::thread::sleep(PAUSE);
                pauses -= 1;
            } else {
                port = open_live(source, baud).ok();
                shared.is_open.store(port.is_some(), Ordering::Relaxed);
                pauses = PAUSES;
            }
            continue;
        };
        match opened.read(&mut bytes, PAUSE) {
            Ok(Read::Nothing) => {}
            Ok(Read::Bytes(count)) => {
                let arrived_ns = monotonic_ns();
                let send = |kind| {
                    let event = Event {
                        source: index,
                        arrived_ns,
                        kind,
                    };
                    if events.try_send(event).is_err() {
                        shared.left_out.fetch_add(1, Ordering::Relaxed);
                    }
                };
                let refused = stream.counts().total_refused();
                stream.push(&bytes[..count], &mut |packet| send(EventKind::Packet(*packet)));
                if stream.counts().total_refused() != refused {
                    send(EventKind::Counts(*stream.counts()));
                }
            }
            Ok(Read::End) | Err(_) => {
                port = None;
                shared.is_open.store(false, Ordering::Relaxed);
                shared.losses.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

/// Opens a source at which bytes arrive.
fn open_live(source: &ReceiverSource, baud: u32) -> Result<Port, BuildError> {
    match receiver_port::open(source, baud)? {
        Opened::Live(port) => Ok(port),
        Opened::File(_) => Err(format!(
            "{source} is a file; name a serial device or a socket in `receivers.sources`, and read recorded bytes with `gerono gnss \
             probe`"
        )
        .into()),
    }
}

/// Receivers of a flight.
pub(super) struct ReceiverDriver {
    threads: Vec<ReceiverThread>,
    events: Receiver<Event>,
    feed: ReceiverFeed,
    /// Packets that the queue had no room for at the last step.
    left_out: u64,
    reason: StatusText,
    page: Arc<SharedPage>,
}

impl ReceiverDriver {
    /// Opens the sources. In flight each thread opens its own, so that none waits for a server that does not answer.
    ///
    /// # Errors
    /// If a source cannot be opened before the flight, with the fix.
    pub(super) fn open(
        stated: &Receivers,
        scenario: &Scenario,
        page: Arc<SharedPage>,
    ) -> Result<Self, BuildError> {
        let (sender, events) = sync_channel(QUEUE);
        let in_flight = is_under_way(&page);
        let mut threads = Vec::new();
        for (index, source) in (0..).zip(stated.addresses()?) {
            let port = match in_flight {
                true => None,
                false => Some(open_live(&source, stated.baud)?),
            };
            let thread = ReceiverThread::start(index, source, stated.baud, port, sender.clone())?;
            threads.push(thread);
        }
        let latencies_ns = [stated.latency, stated.fix_latency].map(nanoseconds);
        let [.., z] = scenario.vehicle.initial.position;
        Ok(Self {
            threads,
            events,
            feed: ReceiverFeed::new(latencies_ns, -z, !in_flight)
                .with_baselines(scenario.baseline().is_some()),
            left_out: 0,
            reason: StatusText::default(),
            page,
        })
    }

    /// Takes the packets that have arrived.
    fn take(&mut self) {
        // No more than the queue holds: the threads fill it meanwhile.
        for _ in 0..QUEUE {
            let Ok(event) = self.events.try_recv() else { break };
            match event.kind {
                EventKind::Packet(packet) => self.feed.add(&packet, event.source, event.arrived_ns),
                EventKind::Counts(counts) => self.threads[usize::from(event.source)].counts = counts,
            }
        }
        let left_out = self.sum(|thread| thread.shared.left_out.load(Ordering::Relaxed));
        self.feed.add_left_out(left_out - self.left_out);
        self.left_out = left_out;
    }

    fn sum(&self, count: impl Fn(&ReceiverThread) -> u64) -> u64 {
        self.threads.iter().map(count).sum()
    }

    fn figures(&mut self, now_ns: u64, start_ns: u64) -> ReceiverFigures {
        let threads = &self.threads;
        self.reason.update(now_ns, |text| {
            let mut separator = "";
            for (message, reason, count) in threads.iter().flat_map(|thread| thread.counts.refusals()) {
                write!(text, "{separator}{count} times {} had {reason}", message.name())?;
                separator = "; ";
            }
            Ok(())
        });
        let open = threads
            .iter()
            .filter(|thread| thread.shared.is_open.load(Ordering::Relaxed));
        ReceiverFigures {
            open: u32::try_from(open.count()).unwrap_or(u32::MAX),
            losses: self.sum(|thread| thread.shared.losses.load(Ordering::Relaxed)),
            refused: self.sum(|thread| thread.counts.total_refused()),
            reason: self.reason.bytes,
            reason_length: u32::try_from(self.reason.length).unwrap_or(0),
            ..self.feed.figures(now_ns, start_ns)
        }
    }
}

impl ErasedService for ReceiverDriver {
    fn id(&self) -> ServiceId {
        ServiceId::Plant
    }

    fn step(&mut self, now: &Now, _inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        let start_ns = self.page.control_block().start_ns.load(Ordering::Relaxed);
        self.take();
        let mut outputs = PlantOutputs::from_slots(outputs);
        self.feed.publish(start_ns + now.time_ns, start_ns, &mut outputs);
        let figures = self.figures(monotonic_ns(), start_ns);
        self.page.control_block().receivers_status.write(&figures);
    }

    fn state_size(&self) -> usize {
        STATE_SIZE
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        keep(self.feed.save().as_bytes());
    }

    fn restore(&mut self, bytes: &[u8]) {
        let memory = ReceiverMemory::read_from_bytes(bytes).expect("a state of this service has this size");
        self.feed.restore(&memory, monotonic_ns());
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    /// Returns whether a thread without a port opens its source before a second attempt would be due.
    fn opens_at_once() -> bool {
        let (sender, _events) = sync_channel(1);
        let free = std::net::UdpSocket::bind(("127.0.0.1", 0)).unwrap();
        let source = ReceiverSource::Udp(free.local_addr().unwrap());
        drop(free);
        let began = Instant::now();
        let thread = ReceiverThread::start(0, source, 38_400, None, sender).unwrap();
        while !thread.shared.is_open.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        began.elapsed() < PAUSE * PAUSES
    }

    #[test]
    fn in_flight_a_source_is_opened_at_once() {
        // On a busy machine one attempt may be slow.
        assert!((0..5).any(|_| opens_at_once()));
    }
}
