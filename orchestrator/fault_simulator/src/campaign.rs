//! Many histories on all cores.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::history::{FaultKind, History};
use crate::properties::{Property, Violation};
use crate::{course_of, flights::Flights, is_flown};

/// Seeds that are taken at once: few enough to stop soon, and enough for the counter not to matter.
const BATCH: u64 = 64;

/// Every such history is flown twice, to see that its actions are the same.
const REPEATED: u64 = 64;

/// Results of a campaign.
#[derive(Clone, Debug, Default)]
pub struct Results {
    pub histories: u64,
    /// Histories with a vehicle in the air.
    pub flown: u64,
    /// Faults that had an effect.
    pub faults: u64,
    pub turns: u64,
    pub restarts: u64,
    pub simulated_ns: u64,
    /// Number of effective faults by kind.
    pub by_kind: BTreeMap<FaultKind, u64>,
    /// Number of histories with a fault of a kind that violate a property.
    pub violations: BTreeMap<(FaultKind, Property), u64>,
    /// The first violation of each property, by seed.
    pub first: BTreeMap<Property, (History, Violation)>,
}

impl Results {
    fn add(&mut self, history: &History, flights: &mut Flights) {
        let course = course_of(history, flights, false);
        self.histories += 1;
        self.flown += u64::from(is_flown(history));
        self.turns += course.turns;
        self.restarts += u64::from(course.restarts);
        self.simulated_ns += course.lasted_ns;
        for (fault, &has_effect) in history.faults.iter().zip(&course.effective) {
            if has_effect {
                self.faults += 1;
                *self.by_kind.entry(fault.kind).or_default() += 1;
            }
        }
        let mut violation = course.violation;
        if history.seed.is_multiple_of(REPEATED) {
            let again = course_of(history, flights, false);
            if again.actions != course.actions {
                violation = Some(Violation {
                    property: Property::IsDeterministic,
                    at_ns: 0,
                    what: "its actions differ".to_owned(),
                });
            }
        }
        let Some(violation) = violation else { return };
        let mut kinds: Vec<_> = history.faults.iter().map(|fault| fault.kind).collect();
        kinds.sort();
        kinds.dedup();
        for kind in kinds {
            *self.violations.entry((kind, violation.property)).or_default() += 1;
        }
        let first = self.first.get(&violation.property);
        if first.is_none_or(|(other, _)| history.faults.len() < other.faults.len()) {
            self.first
                .insert(violation.property, (history.clone(), violation));
        }
    }

    fn merge(&mut self, other: Self) {
        self.histories += other.histories;
        self.flown += other.flown;
        self.faults += other.faults;
        self.turns += other.turns;
        self.restarts += other.restarts;
        self.simulated_ns += other.simulated_ns;
        for (kind, count) in other.by_kind {
            *self.by_kind.entry(kind).or_default() += count;
        }
        for (key, count) in other.violations {
            *self.violations.entry(key).or_default() += count;
        }
        for (property, found) in other.first {
            let own = self.first.get(&property);
            if own.is_none_or(|(own, _)| found.0.faults.len() < own.faults.len()) {
                self.first.insert(property, found);
            }
        }
    }
}

/// Flies the histories of the seeds from `first` on, on `threads` threads, until `is_enough` or the seeds are used up.
/// `progress` is told the number of histories and faults so far, about once a batch, by any of the threads.
pub fn fly(
    seeds: std::ops::Range<u64>,
    threads: usize,
    is_enough: &AtomicBool,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Results {
    let next = AtomicU64::new(seeds.start);
    let (histories, faults) = (AtomicU64::new(0), AtomicU64::new(0));
    let all = Mutex::new(Results::default());
    let work = || {
        let (mut own, mut flights) = (Results::default(), Flights::default());
        // Relaxed: counters only; the results are handed over under the lock.
        while !is_enough.load(Ordering::Relaxed) {
            let from = next.fetch_add(BATCH, Ordering::Relaxed);
            if from >= seeds.end {
                break;
            }
            let before = (own.histories, own.faults);
            for seed in from..(from + BATCH).min(seeds.end) {
                own.add(&History::of_seed(seed), &mut flights);
            }
            let (flown, done) = (own.histories - before.0, own.faults - before.1);
            progress(
                histories.fetch_add(flown, Ordering::Relaxed) + flown,
                faults.fetch_add(done, Ordering::Relaxed) + done,
            );
        }
        if let Ok(mut all) = all.lock() {
            all.merge(own);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
    all.into_inner().unwrap_or_default()
}
