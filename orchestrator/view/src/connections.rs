//! Places for connections: a client has none of its own before its request has come and is permitted.

use std::collections::VecDeque;
use std::io;
use std::net::{Shutdown, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::server::MOST_WATCHERS;

/// Permitted connections at once: those of the watchers, and others that ask for the page.
const MOST_CONNECTIONS: usize = 2 * MOST_WATCHERS;

/// Connections at once whose request has not come, or was refused.
pub(crate) const MOST_ARRIVALS: usize = 16;

/// The connections of a server.
#[derive(Debug, Default)]
pub(crate) struct Connections {
    /// Those whose request has not come, or was refused, by number; the oldest first.
    arrivals: VecDeque<(u64, TcpStream)>,
    /// Number of the permitted ones.
    permitted: usize,
    /// Number of the next one.
    next: u64,
}

/// A place among the connections, for as long as this lives.
pub(crate) struct Connection {
    connections: Arc<Mutex<Connections>>,
    number: u64,
    is_permitted: bool,
}

fn locked(connections: &Mutex<Connections>) -> MutexGuard<'_, Connections> {
    connections.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Connection {
    /// Takes a place among the arrivals; the oldest of them makes room.
    pub(crate) fn arrive(connections: &Arc<Mutex<Connections>>, stream: &TcpStream) -> io::Result<Self> {
        let handle = stream.try_clone()?;
        let mut places = locked(connections);
        if places.arrivals.len() == MOST_ARRIVALS
            && let Some((_, oldest)) = places.arrivals.pop_front()
        {
            // Its thread finds the connection closed, and ends.
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

    /// Takes a place among the permitted connections in exchange. Returns whether there was one.
    pub(crate) fn permit(&mut self) -> bool {
        let mut places = locked(&self.connections);
        self.is_permitted = places.permitted < MOST_CONNECTIONS;
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
        let mut places: Vec<_> = (0..=MOST_CONNECTIONS)
            .map(|_| {
                let mut place = Connection::arrive(&connections, &one).unwrap();
                (place.permit(), place)
            })
            .collect();
        let permitted: Vec<_> = places.iter().map(|(is_permitted, _)| *is_permitted).collect();
        assert_eq!(permitted, [vec![true; MOST_CONNECTIONS], vec![false]].concat());
        places.remove(0);
        let (_, last) = places.last_mut().unwrap();
        assert!(last.permit(), "one has gone");
        drop((places, other));
        let left = locked(&connections);
        assert_eq!((left.permitted, left.arrivals.len()), (0, 0));
    }
}
