//! Changes of gains in flight, from the orchestrator to the services of a flight in real time.
//!
//! Each change is a record in a ring in the control block: the tick from which it holds, and all gains from then on, not only
//! the changed one. So a service that was restarted or has missed some changes needs only the newest due record. Neither side
//! waits: the orchestrator writes regardless of readers, and a service polls once a step, which costs one load of an atomic
//! word. The ring survives the orchestrator and every service.

use shared_types::Gains;
use zerocopy::IntoBytes;

use crate::seqlock::{LookUp, Ring};

/// Maximum lag of a service, in changes.
const DEPTH: usize = 64;

const GAINS: usize = size_of::<Gains>() / size_of::<u64>();

/// The tick, and the gains.
const WORDS: usize = 1 + GAINS;

/// Word of a record that holds the tick.
const FROM_TICK: usize = 0;

/// Changes of gains, oldest first. Change n is the n-th of the flight, from 1 on.
#[derive(Debug, Default)]
#[repr(transparent)]
pub struct TuningRing(Ring<WORDS, DEPTH>);

impl TuningRing {
    /// Adds a change that holds from a tick on, not earlier than that of the previous change. Returns the number of the
    /// change.
    ///
    /// Only one process at a time may call this: the orchestrator.
    pub fn change(&self, from_tick: u64, gains: &Gains) -> u64 {
        let mut record = [0; WORDS];
        record[1..].as_mut_bytes().copy_from_slice(gains.as_bytes());
        self.0.begin(record);
        self.0.finish(FROM_TICK, from_tick);
        self.0.written()
    }

    /// Returns the last change: its number and the gains.
    #[must_use]
    pub fn last(&self) -> Option<(u64, Gains)> {
        let number = self.0.written();
        let (_, gains) = self.record(number.checked_sub(1)?).ok()?;
        Some((number, gains))
    }

    /// Returns the record at an index, or the index of the oldest record if it was overwritten.
    fn record(&self, index: u64) -> Result<(u64, Gains), Option<u64>> {
        match self.0.look_up(index) {
            LookUp::Record(record) => {
                let mut gains = Gains::default();
                gains.as_mut_bytes().copy_from_slice(record[1..].as_bytes());
                Ok((record[FROM_TICK], gains))
            }
            LookUp::Pending => Err(None),
            LookUp::Overwritten(oldest) => Err(Some(oldest)),
        }
    }
}

/// Reader of the changes in a service.
#[derive(Clone, Copy, Debug, Default)]
pub struct TuningReader {
    read: u64,
}

impl TuningReader {
    /// Returns the gains that hold at a tick, if they have changed since the last call.
    #[inline]
    pub fn due(&mut self, ring: &TuningRing, tick: u64) -> Option<Gains> {
        if ring.0.written() == self.read {
            return None;
        }
        self.advance(ring, tick)
    }

    #[cold]
    fn advance(&mut self, ring: &TuningRing, tick: u64) -> Option<Gains> {
        let mut newest = None;
        let mut index = self.read;
        loop {
            match ring.record(index) {
                Ok((from_tick, gains)) if from_tick <= tick => {
                    index += 1;
                    self.read = index;
                    newest = Some(gains);
                }
                Err(Some(oldest)) => index = oldest,
                Ok(_) | Err(None) => return newest,
            }
        }
    }

    /// Returns the number of the last change that was read; 0 before the first.
    #[must_use]
    #[inline]
    pub fn number(&self) -> u64 {
        self.read
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gains(k1: f64) -> Gains {
        Gains {
            k1,
            lambda_disturbance: [k1, -k1, 0.1],
            prediction_gain: 0.5 * k1,
            ..Gains::default()
        }
    }

    #[test]
    fn a_change_holds_from_its_tick_on_and_is_told_once() {
        let ring = TuningRing::default();
        let mut reader = TuningReader::default();
        assert_eq!(
            (reader.due(&ring, 0), reader.number(), ring.last()),
            (None, 0, None)
        );
        assert_eq!(ring.change(10, &gains(1.0)), 1);
        assert_eq!(ring.change(10, &gains(2.0)), 2);
        assert_eq!(ring.change(12, &gains(3.0)), 3);
        assert_eq!((reader.due(&ring, 9), reader.number()), (None, 0));
        assert_eq!((reader.due(&ring, 11), reader.number()), (Some(gains(2.0)), 2));
        assert_eq!((reader.due(&ring, 11), reader.number()), (None, 2));
        assert_eq!((reader.due(&ring, 12), reader.number()), (Some(gains(3.0)), 3));
        assert_eq!(ring.last(), Some((3, gains(3.0))));
    }

    #[test]
    fn one_that_was_away_takes_the_newest_change_that_is_due() {
        let ring = TuningRing::default();
        for number in 1..=200 {
            assert_eq!(ring.change(10 * number, &gains(number as f64)), number);
        }
        for (tick, number) in [(2000, 200), (9999, 200), (1995, 199), (1450, 145)] {
            let mut reader = TuningReader::default();
            assert_eq!(reader.due(&ring, tick), Some(gains(number as f64)));
            assert_eq!(reader.number(), number);
        }
    }
}
