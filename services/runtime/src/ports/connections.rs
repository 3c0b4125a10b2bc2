//! Connections that iceoryx2 could not make.
//!
//! iceoryx2 (0.10) tries to connect two ports only when the list of the topic's ports changes. If that fails, for example
//! because no memory is left, it continues without the connection: its consumer would wait for samples that never
//! arrive. So the port fails, and another process tries again. It does not fail without a connection to a process that has
//! ended, whose successor has other ports, or to an observer.
//!
//! Where a process that restarts lacks memory or descriptors, a healthy one may see its new port and fail to connect to it as
//! well. So the newer port fails at once, and the older one only if the other process has not ended [`PATIENCE`] later.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::{DegradationAction, DegradationCause, DegradationInfo};
use iceoryx2::prelude::ipc;
use rustix::io::Errno;
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use shared_types::Topic;

use super::PortError;
use crate::activity;
use crate::shared_memory;

/// Time in which a process ends whose new ports cannot be connected.
const PATIENCE: Duration = Duration::from_millis(50);

/// Port of another process: its ID, its node, and `false` for that of an observer.
type Peer = (u128, UniqueNodeId, bool);

/// Returns whether the process of a node has not ended. The resources of a dead one may be freed at any moment.
fn is_alive(node: UniqueNodeId) -> bool {
    let number = node.pid::<ipc::Service>().ok();
    let pid = number.and_then(|number| Pid::from_raw(number.value()));
    match pid.map(|pid| pidfd_open(pid, PidfdFlags::empty())) {
        Some(Ok(process)) => !activity::ends_within(&process, Duration::ZERO),
        Some(Err(error)) => error != Errno::SRCH,
        None => true,
    }
}

struct FailedConnection {
    /// ID of the other port.
    peer: u128,
    /// Error of the system, with the resource that was exhausted then.
    reason: String,
    failed_at: Instant,
}

/// Failed connections of a port.
#[derive(Default)]
struct Failed {
    /// `true` if there may be one that the flight needs.
    is_any: AtomicBool,
    peers: Mutex<Vec<FailedConnection>>,
}

/// Connections of a port.
pub(super) struct Connections {
    topic: Topic,
    failed: Arc<Failed>,
    peers: Box<dyn Fn() -> Vec<Peer>>,
}

impl Connections {
    /// Watches the connections of a port of a topic to the existing `peers`.
    pub(super) fn new(topic: Topic, peers: impl Fn() -> Vec<Peer> + 'static) -> Self {
        Self {
            topic,
            failed: Arc::default(),
            peers: Box::new(peers),
        }
    }

    /// Returns the handler that records failed connections; `peer` returns the other port.
    pub(super) fn handler(
        &self,
        peer: fn(&DegradationInfo) -> u128,
    ) -> impl Fn(DegradationCause, &DegradationInfo) -> DegradationAction + Send + 'static {
        let failed = Arc::clone(&self.failed);
        move |cause, info| {
            // iceoryx2 does not pass the error on.
            let error = io::Error::last_os_error();
            if !matches!(cause, DegradationCause::FailedToEstablishConnection) {
                return DegradationAction::Warn;
            }
            let mut peers = failed.peers.lock().unwrap_or_else(PoisonError::into_inner);
            peers.push(FailedConnection {
                peer: peer(info),
                reason: shared_memory::explained(error).to_string(),
                failed_at: Instant::now(),
            });
            failed.is_any.store(true, Ordering::Relaxed);
            // A failure would lose the sample for all receivers.
            DegradationAction::Ignore
        }
    }

    /// Returns an error if a connection that the flight needs has failed some time ago.
    #[inline]
    pub(super) fn check(&self) -> Result<(), PortError> {
        // Relaxed: iceoryx2 calls the handler in the thread that uses the port.
        if self.failed.is_any.load(Ordering::Relaxed) {
            return self.check_each(PATIENCE);
        }
        Ok(())
    }

    /// Returns an error if a connection that the flight needs is missing, also one to a peer that was unknown when it failed.
    pub(super) fn check_now(&self) -> Result<(), PortError> {
        self.check_each(Duration::ZERO)
    }

    #[cold]
    fn check_each(&self, patience: Duration) -> Result<(), PortError> {
        let mut failed = self.failed.peers.lock().unwrap_or_else(PoisonError::into_inner);
        if failed.is_empty() {
            return Ok(());
        }
        let peers = (self.peers)();
        let mut needed = None;
        failed.retain(|failed| {
            let mut peers = peers.iter();
            let peer = peers.find(|peer| peer.0 == failed.peer && is_alive(peer.1));
            if peer.is_some_and(|&(_, _, is_of_the_run)| is_of_the_run) {
                needed.get_or_insert_with(|| (failed.failed_at, failed.reason.clone()));
            }
            peer.is_some()
        });
        self.failed.is_any.store(needed.is_some(), Ordering::Relaxed);
        match needed {
            Some((failed_at, reason)) if failed_at.elapsed() >= patience => Err(PortError::Unconnected {
                topic: self.topic,
                source: reason.into(),
            }),
            _ => Ok(()),
        }
    }
}
