//! Planned faults of an edge: samples that are late or lost, and samples with altered contents.
//!
//! A fault affects the samples that would arrive while it lasts. A delay or loss changes the due sample, and is part of
//! the schedule's queries. Hosts alter the contents when they deliver a sample ([`Corruption`]). The published sample
//! itself does not change.

use std::ops::Range;
use std::sync::Arc;

use zerocopy::IntoBytes;

use crate::noise::{Noise, Stream};
use crate::sample::Header;

/// Planned fault of an edge.
#[derive(Clone, Debug, PartialEq)]
pub struct EdgeFault {
    /// First tick at which arriving samples are affected.
    pub from: u64,
    /// First tick after the fault; [`u64::MAX`] if it never ends.
    pub until: u64,
    /// Kind of the fault.
    pub kind: EdgeFaultKind,
}

/// Effect on the samples that arrive.
#[derive(Clone, Debug, PartialEq)]
pub enum EdgeFaultKind {
    /// Samples arrive this many ticks later.
    Late(u64),
    /// Some samples never arrive.
    Lost(Loss),
    /// Contents of samples are altered.
    Altered(Corruption),
}

/// Loss of samples, decided for each as a function of seed, edge and tick.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// Fraction of lost samples.
    pub fraction: f64,
    /// Random numbers of the decision.
    pub draws: Draws,
}

/// Altered contents of samples; their headers stay.
#[derive(Clone, Debug, PartialEq)]
pub enum Corruption {
    /// The content of the last sample before the fault.
    Repeated,
    /// These numbers (byte range) are scaled: x becomes `scale`·x + `bias`.
    Scaled {
        /// Byte range of the numbers.
        numbers: Range<usize>,
        /// Factor.
        scale: f64,
        /// Value added after scaling.
        bias: f64,
    },
    /// Random numbers of at most this magnitude replace these numbers (byte ranges).
    Random {
        /// Byte ranges of the numbers.
        numbers: Arc<[Range<usize>]>,
        /// Largest magnitude.
        range: f64,
        /// Source of the random numbers.
        draws: Draws,
    },
    /// Random bits.
    Noise(Draws),
}

/// Random numbers of an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draws {
    /// Seed of the flight.
    pub seed: u64,
    /// Index of the edge.
    pub edge: u64,
}

/// Ticks of the generator's stream between the random numbers of two samples: more than the largest sample needs.
const SPREAD: u64 = 16;

impl EdgeFault {
    /// Returns whether samples that arrive at `tick` are affected.
    #[must_use]
    #[inline]
    pub fn is_on(&self, tick: u64) -> bool {
        (self.from..self.until).contains(&tick)
    }

    /// Returns the delay of samples, ticks.
    #[must_use]
    pub(super) fn ticks_late(&self) -> u64 {
        match self.kind {
            EdgeFaultKind::Late(by) => by,
            EdgeFaultKind::Lost(_) | EdgeFaultKind::Altered(_) => 0,
        }
    }
}

impl Loss {
    /// Returns whether the sample that was published at `tick` is lost.
    #[must_use]
    pub fn loses(&self, tick: u64) -> bool {
        self.is_total() || self.draws.of(Stream::EdgeLoss).at(tick).uniform() < self.fraction
    }

    /// Returns whether all samples are lost.
    #[must_use]
    pub fn is_total(&self) -> bool {
        self.fraction >= 1.0
    }
}

impl Draws {
    fn of(self, stream: Stream) -> Noise {
        Noise::one_of(self.seed, stream, self.edge)
    }
}

impl Corruption {
    /// Alters `sample`, which was published at `tick`; `repeated` is the last one before the fault.
    ///
    /// # Panics
    /// If the numbers are not within the sample.
    pub fn alter(&self, tick: u64, repeated: Option<&[u8]>, sample: &mut [u8]) {
        const HEADER: usize = size_of::<Header>();
        match self {
            Self::Repeated => {
                if let Some(repeated) = repeated {
                    sample[HEADER..].copy_from_slice(&repeated[HEADER..]);
                }
            }
            Self::Scaled { numbers, scale, bias } => {
                for number in numbers_mut(sample, numbers) {
                    let x = f64::from_le_bytes(*number);
                    *number = (scale * x + bias).to_le_bytes();
                }
            }
            Self::Random {
                numbers,
                range,
                draws,
            } => {
                let mut noise = draws.of(Stream::EdgeGarbage);
                let mut draws = noise.at(tick * SPREAD);
                for numbers in numbers.iter() {
                    for number in numbers_mut(sample, numbers) {
                        *number = (range * (2.0 * draws.uniform() - 1.0)).to_le_bytes();
                    }
                }
            }
            Self::Noise(draws) => {
                let mut noise = draws.of(Stream::EdgeGarbage);
                let mut draws = noise.at(tick * SPREAD);
                for bytes in sample[HEADER..].chunks_mut(size_of::<u64>()) {
                    let bits = draws.bits();
                    bytes.copy_from_slice(&bits.as_bytes()[..bytes.len()]);
                }
            }
        }
    }
}

/// Returns the floating-point numbers in these bytes of a sample.
fn numbers_mut<'a>(sample: &'a mut [u8], bytes: &Range<usize>) -> impl Iterator<Item = &'a mut [u8; 8]> {
    sample[bytes.clone()].as_chunks_mut().0.iter_mut()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Topic;
    use crate::samples::VehicleState;
    use zerocopy::FromZeros;

    const DRAWS: Draws = Draws { seed: 3, edge: 4 };

    fn altered(corruption: &Corruption, tick: u64) -> VehicleState {
        let mut sample = VehicleState::new_zeroed();
        (sample.header.tick, sample.position_world, sample.thrust) = (tick, [1.0, 2.0, 3.0], 2.0);
        let mut repeated = sample;
        (repeated.header.tick, repeated.thrust) = (tick - 1, 1.0);
        corruption.alter(tick, Some(repeated.as_bytes()), sample.as_mut_bytes());
        assert_eq!(sample.header.tick, tick, "the header stays");
        sample
    }

    #[test]
    fn samples_hold_what_the_fault_says() {
        assert_eq!(altered(&Corruption::Repeated, 7).thrust, 1.0);
        let numbers = Topic::VehicleState.find_numbers("position_world.1").unwrap();
        let scaled = Corruption::Scaled {
            numbers,
            scale: 3.0,
            bias: 0.5,
        };
        let wrong = altered(&scaled, 7);
        assert_eq!((wrong.position_world, wrong.thrust), ([1.0, 6.5, 3.0], 2.0));
    }

    #[test]
    fn garbage_is_a_function_of_the_sample_and_stays_in_its_range() {
        let members = Topic::VehicleState.members();
        let numbers: Vec<_> = members.iter().filter_map(|member| member.numbers(None)).collect();
        let random = Corruption::Random {
            numbers: numbers.into(),
            range: 0.1,
            draws: DRAWS,
        };
        let garbage = altered(&random, 7);
        assert_eq!(altered(&random, 7), garbage);
        assert_ne!(altered(&random, 8).position_world, garbage.position_world);
        let numbers = garbage.position_world.iter().chain(&garbage.world_from_body);
        assert!(numbers.clone().all(|number| number.abs() <= 0.1), "{garbage:?}");
        assert!(numbers.clone().any(|number| number.abs() > 0.05), "{garbage:?}");
        let noise = altered(&Corruption::Noise(DRAWS), 7);
        assert_ne!(noise.position_world, garbage.position_world);
    }

    #[test]
    fn the_stated_share_of_the_samples_is_lost() {
        let loss = |fraction| Loss {
            fraction,
            draws: DRAWS,
        };
        let lost = (0..10_000).filter(|&tick| loss(0.3).loses(tick)).count();
        assert!((2850..3150).contains(&lost), "{lost}");
        assert!((0..100).all(|tick| loss(1.0).loses(tick)));
    }
}
