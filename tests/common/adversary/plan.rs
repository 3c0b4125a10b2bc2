//! The plan of an adversary: what is done to the frames, and when, by a seed.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Part of a pose that can freeze alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Position,
    Attitude,
    Both,
}

/// Kind of another body in the room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stranger {
    NotANumber,
    NoRotation,
    FarAway,
    Degrees,
    /// Two bodies of one name.
    Twins,
    LongName,
    /// Equal to another one in the bytes that Vicon sends.
    LongTwins,
    Latin1,
    /// A name like the vehicle's.
    Near,
    /// A good body that flies through the room.
    Passing,
}

const STRANGERS: [Stranger; 10] = [
    Stranger::NotANumber,
    Stranger::NoRotation,
    Stranger::FarAway,
    Stranger::Degrees,
    Stranger::Twins,
    Stranger::LongName,
    Stranger::LongTwins,
    Stranger::Latin1,
    Stranger::Near,
    Stranger::Passing,
];

/// What is done to the frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Spoil {
    /// The body is not seen for `gap_ns`, then turned about an axis of its own.
    Turned {
        gap_ns: u64,
        axis: [f64; 3],
        angle: f64,
    },
    Frozen(Part),
    Strange(Stranger),
    /// All packets come later by as much.
    Delayed(u64),
    /// Packets are held back and come at once, each time for as long.
    Burst(u64),
    /// Every second packet comes after the next ones.
    Reordered,
    /// The server's clock is set by as much.
    ClockStep(i64),
}

impl Spoil {
    /// Returns whether the vehicle's poses are as the cameras saw them, in time.
    fn is_beside_the_vehicle(&self) -> bool {
        matches!(self, Self::Strange(_))
    }
}

/// Kinds of spoils that a plan may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Turns,
    Freezes,
    Strangers,
    Network,
}

pub(crate) const KINDS: [(&str, Kind); 4] = [
    ("turns", Kind::Turns),
    ("freezes", Kind::Freezes),
    ("strangers", Kind::Strangers),
    ("network", Kind::Network),
];

/// A spoil at a time since the plan began, ns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Event {
    pub(crate) from_ns: u64,
    pub(crate) until_ns: u64,
    pub(crate) spoil: Spoil,
}

struct Dice(ChaCha8Rng);

impl Dice {
    fn below(&mut self, limit: u64) -> u64 {
        (u64::from(self.0.next_u32()) * limit) >> 32
    }

    fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * f64::from(self.0.next_u32()) / f64::from(u32::MAX)
    }

    /// A time between two times, s, in ns.
    fn time(&mut self, least: f64, most: f64) -> u64 {
        (1e9 * self.between(least, most)) as u64
    }

    fn spoil(&mut self, kind: Kind) -> (Spoil, u64) {
        match kind {
            Kind::Turns => {
                let axis = [0; 3].map(|_: i32| self.between(-1.0, 1.0));
                let angle = self.between(30.0, 180.0).to_radians();
                let gap_ns = if self.below(3) == 0 {
                    0
                } else {
                    self.time(0.0, 0.5)
                };
                (
                    Spoil::Turned { gap_ns, axis, angle },
                    gap_ns + self.time(0.05, 1.5),
                )
            }
            Kind::Freezes => {
                let part = [Part::Position, Part::Attitude, Part::Both][self.below(3) as usize];
                (Spoil::Frozen(part), self.time(0.3, 3.0))
            }
            Kind::Strangers => {
                let stranger = STRANGERS[self.below(STRANGERS.len() as u64) as usize];
                (Spoil::Strange(stranger), self.time(1.0, 5.0))
            }
            Kind::Network => match self.below(4) {
                0 => (Spoil::Delayed(self.time(0.001, 0.02)), self.time(0.5, 4.0)),
                1 => (Spoil::Burst(self.time(0.02, 0.1)), self.time(0.3, 1.0)),
                2 => (Spoil::Reordered, self.time(0.5, 2.0)),
                _ => {
                    let step = [1.0, 0.01, 86_400.0][self.below(3) as usize];
                    let sign = if self.below(2) == 0 { -1.0 } else { 1.0 };
                    (Spoil::ClockStep((1e9 * step * sign) as i64), 1)
                }
            },
        }
    }
}

/// Returns the plan of a seed: spoils of these kinds one after another until a time, each with a pause behind it in which
/// the flight finds back.
pub(crate) fn plan(seed: u64, kinds: &[Kind], until_ns: u64) -> Vec<Event> {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(seed));
    let mut events = Vec::new();
    let mut from_ns = dice.time(0.5, 1.5);
    while from_ns < until_ns {
        let kind = kinds[dice.below(kinds.len() as u64) as usize];
        let (spoil, lasts_ns) = dice.spoil(kind);
        let until_ns = from_ns + lasts_ns;
        events.push(Event {
            from_ns,
            until_ns,
            spoil,
        });
        let pause = if spoil.is_beside_the_vehicle() {
            [0.2, 1.0]
        } else {
            [2.5, 5.0]
        };
        from_ns = until_ns + dice.time(pause[0], pause[1]);
    }
    events
}
