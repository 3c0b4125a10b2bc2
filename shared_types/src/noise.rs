//! Random numbers as functions of (seed, stream, tick): there is no state to save, and a restart does not shift them.
//!
//! The generator is ChaCha8, whose stream is stable across versions and can be entered at any position; normal numbers
//! come from it by the Box–Muller transform over `libm`, so that they are equal on every machine.

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Use of random numbers. Numbers of different streams are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Stream {
    /// Errors of the captured pose.
    CameraNoise = 1,
    /// Exposure times of the cameras' frames.
    CameraJitter = 2,
    /// Frames of the cameras that do not find the body.
    CameraLoss = 3,
    /// Frames of the radio that are not received.
    RadioLoss = 4,
    /// Turbulence of the air.
    Turbulence = 5,
    /// Fluctuation of the fan's jet.
    Fan = 6,
    /// Gusts of the wind.
    Gusts = 7,
    /// Gusts of the Dryden model.
    Dryden = 8,
    /// White noise and bias walk of the inertial measurement unit.
    Imu = 9,
    /// Errors and latency of the fixes of a satellite receiver.
    Gnss = 10,
    /// Errors of the barometer.
    Barometer = 11,
    /// Noise of the magnetometer.
    Magnetometer = 12,
    /// What sensors have from being switched on; the number of the sensor is the tick.
    SensorTurnOn = 13,
    /// Errors of the baselines of two antennas.
    GnssBaseline = 14,
    /// Lost samples of an edge; the index of the edge is added.
    EdgeLoss = 0x100,
    /// Random contents of the samples of an edge; the index of the edge is added.
    EdgeGarbage = 0x200,
}

/// Words of the generator reserved for a tick: 32 numbers.
const WORDS_A_TICK: u128 = 64;

/// Random numbers of a stream.
#[derive(Clone, Debug)]
pub struct Noise(ChaCha8Rng);

/// Random numbers of a stream at a tick, in sequence.
#[derive(Debug)]
pub struct Draws<'a>(&'a mut ChaCha8Rng);

impl Noise {
    /// Makes the random numbers of a flight's `stream`.
    #[must_use]
    pub fn new(seed: u64, stream: Stream) -> Self {
        Self::one_of(seed, stream, 0)
    }

    /// Creates the random numbers of the `place`-th of several streams of a kind.
    #[must_use]
    pub fn one_of(seed: u64, stream: Stream, place: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream as u64 + place);
        Self(generator)
    }

    /// Returns the numbers of a tick, from the first.
    #[must_use]
    #[inline]
    pub fn at(&mut self, tick: u64) -> Draws<'_> {
        self.0.set_word_pos(u128::from(tick) * WORDS_A_TICK);
        Draws(&mut self.0)
    }
}

impl Draws<'_> {
    /// Returns a number evenly distributed over [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
        let fraction = (self.0.next_u64() >> 11) as f64;
        fraction * (1.0 / (1u64 << 53) as f64)
    }

    /// Returns any 64 bits.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Returns two independent standard normal numbers.
    #[inline]
    pub fn normal_pair(&mut self) -> [f64; 2] {
        // 1 − u lies in (0, 1]: the logarithm is finite.
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        let (sine, cosine) = libm::sincos(std::f64::consts::TAU * self.uniform());
        [radius * cosine, radius * sine]
    }

    /// Returns three independent standard normal numbers.
    #[inline]
    pub fn normal3(&mut self) -> Vector3<f64> {
        let ([x, y], [z, _]) = (self.normal_pair(), self.normal_pair());
        Vector3::new(x, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_depends_on_nothing_but_seed_stream_and_tick() {
        let mut noise = Noise::new(7, Stream::Turbulence);
        let first = noise.at(1000).normal3();
        let _other = noise.at(3).uniform();
        assert_eq!(noise.at(1000).normal3(), first);
        assert_eq!(Noise::new(7, Stream::Turbulence).at(1000).normal3(), first);
        assert_ne!(noise.at(1001).normal3(), first);
        assert_ne!(Noise::new(8, Stream::Turbulence).at(1000).normal3(), first);
        assert_ne!(Noise::new(7, Stream::Fan).at(1000).normal3(), first);
    }

    #[test]
    fn the_stream_is_stable() {
        let mut noise = Noise::new(1, Stream::CameraNoise);
        let bits = noise.at(5).normal_pair().map(f64::to_bits);
        assert_eq!(bits, STABLE);
    }

    /// Pinned: a change of these bits changes every flight with noise.
    const STABLE: [u64; 2] = [4602971183686575511, 13818669809117493572];

    #[test]
    fn normal_numbers_are_normal() {
        const COUNT: u32 = 100_000;
        let mut noise = Noise::new(3, Stream::CameraNoise);
        let (mut moments, mut across, mut beyond_two) = ([0.0; 4], 0.0, 0.0);
        let mut previous = 0.0;
        for tick in 0..COUNT {
            let x = noise.at(u64::from(tick)).normal3();
            for (power, moment) in (1..).zip(&mut moments) {
                *moment += libm::pow(x.x, f64::from(power)) / f64::from(COUNT);
            }
            across += (x.x * x.y + x.x * previous) / f64::from(COUNT);
            beyond_two += f64::from(u8::from(x.x.abs() > 2.0)) / f64::from(COUNT);
            previous = x.x;
        }
        let [mean, variance, third, fourth] = moments;
        assert!(mean.abs() < 0.015 && (variance - 1.0).abs() < 0.02, "{moments:?}");
        assert!(third.abs() < 0.05 && (fourth - 3.0).abs() < 0.15, "{moments:?}");
        assert!(across.abs() < 0.02, "neighbours are independent: {across}");
        assert!((beyond_two - 0.0455).abs() < 0.003, "{beyond_two}");
    }

    #[test]
    fn uniform_numbers_fill_the_interval() {
        let mut noise = Noise::new(3, Stream::RadioLoss);
        let mut counts = [0u32; 10];
        for tick in 0..100_000 {
            let place = noise.at(tick).uniform() * 10.0;
            counts[(0..10).rposition(|tenth| f64::from(tenth) <= place).unwrap()] += 1;
        }
        assert!(
            counts.iter().all(|count| (9_600..10_400).contains(count)),
            "{counts:?}"
        );
    }
}
