//! Many flights on all cores: their results come in the order of the flights, whatever thread has flown which and when.
//!
//! A flight is a function of its scenario alone, so a campaign gives the same results on any number of threads. Flights
//! are stepped one after the other on a thread. Eight of them interleaved, service by service, take 0.9 to 1.1 of the
//! time: they miss 49 in place of 372 lines of the first instruction cache a tick, but 184 in place of 23 of the first
//! data cache, and the limit is neither: it is the 8,700 instructions of a tick.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::ops::Range;
use std::sync::{Condvar, Mutex};
use std::thread;

/// Most results that wait for an earlier one, for each thread.
const WAITING: u64 = 16;

struct State<R> {
    next: u64,
    /// First item whose result was not taken.
    taken: u64,
    done: BTreeMap<u64, R>,
    stops: bool,
}

/// Returns the number of cores that this process may use.
#[must_use]
pub fn cores() -> usize {
    thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

/// Returns the results of `work` on every item, in the order of the items.
///
/// # Panics
/// If `work` does.
pub fn map<T: Sync, R: Send>(items: &[T], threads: usize, work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let mut results = Vec::with_capacity(items.len());
    let of_index = |index| Some(work(&items[usize::try_from(index).expect("an index of a slice")]));
    let Ok(()) = for_each(0..items.len() as u64, threads, of_index, |result| {
        results.push(result);
        Ok::<_, Infallible>(())
    });
    results
}

/// Does `work` on every item of a range on some threads, and passes the results to `take` in the order of the items; few
/// results wait for an earlier one. Ends early if `work` returns nothing, or when `take` fails.
///
/// # Errors
/// That of `take`.
///
/// # Panics
/// If `work` does.
pub fn for_each<R: Send, E>(
    items: Range<u64>,
    threads: usize,
    work: impl Fn(u64) -> Option<R> + Sync,
    mut take: impl FnMut(R) -> Result<(), E>,
) -> Result<(), E> {
    let state = Mutex::new(State {
        next: items.start,
        taken: items.start,
        done: BTreeMap::new(),
        stops: false,
    });
    let changed = Condvar::new();
    let window = WAITING * threads.max(1) as u64;
    let lock = || state.lock().expect("no thread panics while it holds the lock");
    let worker = || {
        // A thread that panics must not leave the others waiting.
        let _stop = Stop(&state, &changed);
        loop {
            let item = {
                let mut state = lock();
                while !state.stops && state.next < items.end && state.next >= state.taken + window {
                    state = changed
                        .wait(state)
                        .expect("no thread panics while it holds the lock");
                }
                if state.stops || state.next >= items.end {
                    return;
                }
                state.next += 1;
                state.next - 1
            };
            let result = work(item);
            let mut state = lock();
            match result {
                Some(result) => drop(state.done.insert(item, result)),
                None => state.stops = true,
            }
            changed.notify_all();
        }
    };
    thread::scope(|scope| {
        let _stop = Stop(&state, &changed);
        let workers: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(worker)).collect();
        let mut outcome = Ok(());
        for item in items.clone() {
            let result = {
                let mut state = lock();
                loop {
                    if let Some(result) = state.done.remove(&item) {
                        state.taken = item + 1;
                        break Some(result);
                    }
                    if state.stops {
                        break None;
                    }
                    state = changed
                        .wait(state)
                        .expect("no thread panics while it holds the lock");
                }
            };
            changed.notify_all();
            let Some(result) = result else { break };
            outcome = take(result);
            if outcome.is_err() {
                break;
            }
        }
        lock().stops = true;
        changed.notify_all();
        for worker in workers {
            if let Err(panic) = worker.join() {
                std::panic::resume_unwind(panic);
            }
        }
        outcome
    })
}

/// Stops all when a thread unwinds.
struct Stop<'a, R>(&'a Mutex<State<R>>, &'a Condvar);

impl<R> Drop for Stop<'_, R> {
    fn drop(&mut self) {
        if thread::panicking() {
            if let Ok(mut state) = self.0.lock() {
                state.stops = true;
            }
            self.1.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn results_come_in_order_from_any_number_of_threads_and_few_wait() {
        for threads in [1, 2, 7] {
            let (begun, mut taken) = (AtomicU64::new(0), Vec::new());
            let work = |item: u64| {
                begun.fetch_add(1, Ordering::Relaxed);
                Some(item)
            };
            let outcome: Result<(), Infallible> = for_each(5..1000, threads, work, |item| {
                assert!(
                    begun.load(Ordering::Relaxed) <= item - 5 + 1 + WAITING * threads as u64 + threads as u64
                );
                taken.push(item);
                Ok(())
            });
            assert!(outcome.is_ok() && taken.iter().copied().eq(5..1000));
        }
    }

    #[test]
    fn a_slice_is_mapped_in_order_by_any_number_of_threads() {
        let items: Vec<u64> = (0..100).collect();
        for threads in [0, 1, 3, 200] {
            let squares = map(&items, threads, |item| {
                // The first items take longest.
                thread::sleep(std::time::Duration::from_micros(100 - item));
                item * item
            });
            assert!(squares.into_iter().eq(items.iter().map(|item| item * item)));
        }
        assert!(map(&[0_u8; 0], 4, |item| *item).is_empty());
    }

    #[test]
    fn it_ends_where_work_ends_or_a_result_is_not_taken() {
        let mut taken = Vec::new();
        let outcome: Result<(), Infallible> = for_each(
            0..100,
            3,
            |item| (item < 40).then_some(item),
            |item| {
                taken.push(item);
                Ok(())
            },
        );
        assert!(outcome.is_ok() && taken.len() <= 40 && taken.iter().copied().eq(0..taken.len() as u64));
        let refused = for_each(0..100, 3, Some, |item| if item < 10 { Ok(()) } else { Err(item) });
        assert_eq!(refused, Err(10));
    }
}
