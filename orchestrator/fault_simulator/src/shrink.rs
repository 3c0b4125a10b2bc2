//! The shortest history that violates the same property.

use crate::history::{FOR_EVER, Fault, History, MS};
use crate::properties::Property;

/// Shrinks a history that violates `property`, as `violated` says of a history: first its faults (delta debugging), then
/// their times.
pub fn shrink(
    mut history: History,
    property: Property,
    mut violated: impl FnMut(&History) -> Option<Property>,
) -> History {
    let mut fails = |faults: Vec<Fault>, history: &History| {
        let shorter = History {
            faults,
            ..history.clone()
        };
        (violated(&shorter) == Some(property)).then_some(shorter)
    };
    let mut chunk = history.faults.len().div_ceil(2);
    while chunk > 0 {
        let mut from = 0;
        while from < history.faults.len() {
            let mut faults = history.faults.clone();
            faults.drain(from..(from + chunk).min(faults.len()));
            match fails(faults, &history) {
                Some(shorter) => history = shorter,
                None => from += chunk,
            }
        }
        chunk = match chunk {
            1 => 0,
            chunk => chunk.div_ceil(2),
        };
    }
    for at in 0..history.faults.len() {
        let mut unit = 1_000 * MS;
        while unit >= MS {
            let Fault { at_ns, for_ns, .. } = history.faults[at];
            let simpler = [
                (at_ns / unit * unit, for_ns),
                (
                    at_ns,
                    if for_ns == FOR_EVER {
                        FOR_EVER
                    } else {
                        for_ns / unit * unit
                    },
                ),
            ];
            for (at_ns, for_ns) in simpler {
                let mut faults = history.faults.clone();
                (faults[at].at_ns, faults[at].for_ns) = (at_ns, for_ns);
                if faults != history.faults
                    && faults.is_sorted_by_key(|fault| fault.at_ns)
                    && let Some(simpler) = fails(faults, &history)
                {
                    history = simpler;
                }
            }
            unit /= 10;
        }
    }
    history
}
