//! Limits of connections: a client counts as permitted only after its request has arrived and passed the checks.

use std::collections::VecDeque;
use std::io;
use std::net::{Shutdown, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::server::MAX_WATCHERS;

/// Maximum number of permitted connections: the watchers, and others that load the page.
const MAX_CONNECTIONS: usize = 2 * MAX_WATCHERS;

/// Maximum number of connections whose request has not arrived or was refused.
pub(crate) const MAX_ARRIVALS: usize = 16;

/// Connections of a server.
#[derive(Debug, Default)]
pub(crate) struct Connections {
    /// Connections without a permitted request, by number; the oldest first.
    arrivals: VecDeque<(u64, TcpStream)>,
    /// Number of permitted connections.
    permitted: usize,
    /// Number of the next connection.
    next: u64,
}

/// Slot of a connection; dropping it frees the slot.
pub(crate) struct Connection {
    connections: Arc<Mutex<Connections>>,
    number: u64,
    is_permitted: bool,
}

fn locked(connections: &Mutex<Connections>) -> MutexGuard<'_, Connections> {
    connections.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Connection {
    /// Takes a slot among the arrivals; if all are taken, the oldest connection is closed.
    pub(crate) fn arrive(connections: &Arc<Mutex<Connections>>, stream: &TcpStream) -> io::Result<Self> {
        let handle = stream.try_clone()?;
        let mut places = locked(connections);
        if places.arrivals.len() == MAX_ARRIVALS
            && let Some((_, oldest)) = places.arrivals.pop_front()
        {
            // Its thread gets the end of the stream, and ends.
            let _ = oldest.shutdown(Shutdown::Both);
        }
        let number = places.next;
        places.next += 1;
        places.arrivals.push_back((number, handle));
        drop(places);
        Ok(Self {
            connections: Arc::clone(connections),
            number,
            is_permitted: false,
        })
    }

    /// Exchanges the slot for one of a permitted connection. Returns whether one was free.
    pub(crate) fn permit(&mut self) -> bool {
        let mut places = locked(&self.connections);
        self.is_permitted = places.permitted < MAX_CONNECTIONS;
        if self.is_permitted {
            places.permitted += 1;
            places.arrivals.retain(|(number, _)| *number != self.number);
        }
        self.is_permitted
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        let mut places = locked(&self.connections);
        if self.is_permitted {
            places.permitted -= 1;
        } else {
            places.arrivals.retain(|(number, _)| *number != self.number);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, TcpListener};

    use super::*;

    #[test]
    fn a_permitted_connection_too_many_is_told_so() {
        let (one, other) = {
            let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
            let one = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            (one, listener.accept().unwrap().0)
        };
        let connections = Arc::default();
        let mut places: Vec<_> = (0..=MAX_CONNECTIONS)
            .map(|_| {
                let mut place = Connection::arrive(&connections, &one).unwrap();
                (place.permit(), place)
            })
            .collect();
        let permitted: Vec<_> = places.iter().map(|(is_permitted, _)| *is_permitted).collect();
        assert_eq!(permitted, [vec![true; MAX_CONNECTIONS], vec![false]].concat());
        places.remove(0);
        let (_, last) = places.last_mut().unwrap();
        assert!(last.permit(), "one has gone");
        drop((places, other));
        let left = locked(&connections);
        assert_eq!((left.permitted, left.arrivals.len()), (0, 0));
    }
}
