//! Ports of one sample type.
#![expect(
    unsafe_code,
    reason = "iceoryx2 asks for promises about memory layout that only `unsafe` can give"
)]

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample as Received;
use iceoryx2::sample_mut::SampleMut as Loaned;
use shared_types::{Sample, Topic};

use super::connections::Connections;
use super::topic::one_port;
use super::{PortError, Receiver, Sender};

/// Sample type in iceoryx2: named as in the log instead of by its path in Rust.
#[repr(transparent)]
pub(super) struct Wire<T>(pub(super) T);

impl<T: Sample> std::fmt::Debug for Wire<T> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(T::MSG_NAME)
    }
}

// SAFETY: a `Sample` is `repr(C)`, without padding, pointers or invalid bit patterns (zerocopy's derives prove
// it), and the name stands for exactly this layout: the layout hash is compared besides.
unsafe impl<T: Sample> ZeroCopySend for Wire<T> {
    unsafe fn type_name() -> &'static str {
        T::MSG_NAME
    }
}

/// Publisher of a topic, and the sample that is being written.
pub(super) struct TypedSender<T: Sample> {
    // Declared before the publisher and so dropped before it: a loaned sample returns to its publisher.
    loaned: Option<Loaned<ipc::Service, Wire<T>, ()>>,
    publisher: Publisher<ipc::Service, Wire<T>, ()>,
    topic: Topic,
    connections: Connections,
}

impl<T: Sample> TypedSender<T> {
    pub(super) fn new(
        publisher: Publisher<ipc::Service, Wire<T>, ()>,
        topic: Topic,
        connections: Connections,
    ) -> Self {
        Self {
            loaned: None,
            publisher,
            topic,
            connections,
        }
    }
}

impl<T: Sample> Sender for TypedSender<T> {
    #[inline]
    fn loan(&mut self) -> Result<&mut [u8], PortError> {
        // A match: `map_err` would copy iceoryx2's whole loan, which is much larger than the pointer to the sample.
        let sample = match self.publisher.loan_uninit() {
            // SAFETY: mapped shared memory always holds some bytes, and a `Sample` is valid for any (`FromBytes`).
            Ok(sample) => unsafe { sample.assume_init() },
            Err(error) => {
                return Err(PortError::Transport {
                    topic: self.topic,
                    source: error.into(),
                });
            }
        };
        Ok(self.loaned.insert(sample).payload_mut().0.as_mut_bytes())
    }

    fn discard_loan(&mut self) {
        self.loaned = None;
    }

    #[inline]
    fn send(&mut self) -> Result<(), PortError> {
        use iceoryx2::port::SendError;
        let Some(sample) = self.loaned.take() else {
            return Ok(());
        };
        sample.send().map(drop).map_err(|error| match error {
            SendError::UnableToDeliver => PortError::Stopping,
            error => PortError::Transport {
                topic: self.topic,
                source: error.into(),
            },
        })?;
        self.connections.check()
    }

    fn connect(&mut self) -> Result<(), PortError> {
        one_port(|| self.publisher.update_connections()).map_err(|error| PortError::Transport {
            topic: self.topic,
            source: error.into(),
        })?;
        self.connections.check_now()
    }
}

/// Subscriber of a topic, and the sample that is being read.
pub(super) struct TypedReceiver<T: Sample> {
    held: Option<Received<ipc::Service, Wire<T>, ()>>,
    subscriber: Subscriber<ipc::Service, Wire<T>, ()>,
    topic: Topic,
    connections: Connections,
}

impl<T: Sample> TypedReceiver<T> {
    pub(super) fn new(
        subscriber: Subscriber<ipc::Service, Wire<T>, ()>,
        topic: Topic,
        connections: Connections,
    ) -> Self {
        Self {
            held: None,
            subscriber,
            topic,
            connections,
        }
    }
}

impl<T: Sample> Receiver for TypedReceiver<T> {
    #[inline]
    fn receive(&mut self) -> Result<bool, PortError> {
        match self.subscriber.receive() {
            Ok(None) => self.connections.check().map(|()| false),
            Ok(sample) => {
                self.held = sample;
                Ok(true)
            }
            Err(error) => Err(PortError::Transport {
                topic: self.topic,
                source: error.into(),
            }),
        }
    }

    #[inline]
    fn held(&self) -> Option<&[u8]> {
        self.held.as_ref().map(|sample| sample.payload().0.as_bytes())
    }

    fn id(&self) -> u128 {
        self.subscriber.id().value()
    }

    fn connect(&mut self) -> Result<(), PortError> {
        one_port(|| self.subscriber.update_connections()).map_err(|error| PortError::Transport {
            topic: self.topic,
            source: error.into(),
        })?;
        self.connections.check_now()
    }
}
