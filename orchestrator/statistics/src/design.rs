//! Sample points of a sweep in the unit cube [0, 1)^d.
//!
//! The point of a sample is a pure function of the seed, the method, its number of samples, the dimensions and the index:
//! any sample can be computed alone, in any order, on any machine.

use std::fmt;

use crate::random::{Generator, Purpose};

/// Maximum number of samples of a Sobol sequence: the limit of `sobol_burley`.
pub const SOBOL_SAMPLES_MAX: u64 = 1 << 16;

/// Maximum number of dimensions of a Sobol sequence.
pub const SOBOL_DIMENSIONS_MAX: usize = sobol_burley::NUM_DIMENSIONS as usize;

/// Maximum number of samples of a Latin hypercube, whose permutation of strata is stored for every dimension.
pub const LATIN_SAMPLES_MAX: u64 = 1 << 20;

/// Sampling method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Independent, uniformly distributed points.
    Random,
    /// Scrambled Sobol sequence: its first 2^k points fill the cube evenly.
    Sobol,
    /// Latin hypercube: one point in each of N strata of every dimension.
    Latin,
    /// All combinations of levels.
    Grid,
}

/// Error of the parameters of a design.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DesignError {
    /// A Sobol sequence of more than [`SOBOL_SAMPLES_MAX`] samples.
    SobolSamples(u64),
    /// A Sobol sequence of more than [`SOBOL_DIMENSIONS_MAX`] dimensions.
    SobolDimensions(usize),
    /// A Latin hypercube of more than [`LATIN_SAMPLES_MAX`] samples.
    LatinSamples(u64),
    /// A grid without levels in this dimension.
    NoLevels(usize),
    /// A grid of 2^64 samples or more.
    GridTooLarge,
}

impl fmt::Display for DesignError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SobolSamples(samples) => write!(
                formatter,
                "a Sobol sequence has at most {SOBOL_SAMPLES_MAX} samples, not {samples}"
            ),
            Self::SobolDimensions(dimensions) => write!(
                formatter,
                "a Sobol sequence has at most {SOBOL_DIMENSIONS_MAX} dimensions, not {dimensions}"
            ),
            Self::LatinSamples(samples) => write!(
                formatter,
                "a Latin hypercube has at most {LATIN_SAMPLES_MAX} samples, not {samples}"
            ),
            Self::NoLevels(dimension) => write!(formatter, "dimension {dimension} of the grid has no levels"),
            Self::GridTooLarge => formatter.write_str("the grid has 2^64 samples or more"),
        }
    }
}

impl std::error::Error for DesignError {}

/// Points of a sweep's samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Design {
    dimensions: usize,
    points: Points,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Points {
    Random {
        seed: u64,
    },
    Sobol {
        scramble: u32,
        samples: u64,
    },
    Latin {
        seed: u64,
        samples: u64,
        /// Stratum of each sample, for each dimension.
        strata: Vec<Vec<u32>>,
    },
    Grid {
        levels: Vec<u32>,
        samples: u64,
    },
}

impl Design {
    /// Makes an unlimited design of independent points.
    ///
    /// A coordinate of a point does not depend on the number of dimensions.
    #[must_use]
    pub fn random(seed: u64, dimensions: usize) -> Self {
        Self {
            dimensions,
            points: Points::Random { seed },
        }
    }

    /// Makes a design of the first points of a Sobol sequence, scrambled by the seed.
    ///
    /// B. Burley: Practical hash-based Owen scrambling, Journal of Computer Graphics Techniques 9 (2020), no. 4.
    ///
    /// # Errors
    /// If there are more samples or dimensions than the sequence has.
    pub fn sobol(seed: u64, samples: u64, dimensions: usize) -> Result<Self, DesignError> {
        if samples > SOBOL_SAMPLES_MAX {
            return Err(DesignError::SobolSamples(samples));
        }
        if dimensions > SOBOL_DIMENSIONS_MAX {
            return Err(DesignError::SobolDimensions(dimensions));
        }
        let scramble = Generator::new(seed, Purpose::Scramble, 0).bits32();
        Ok(Self {
            dimensions,
            points: Points::Sobol { scramble, samples },
        })
    }

    /// Makes a Latin hypercube: x_d(i) = (π_d(i) + u)/N with a random permutation π_d for each dimension d.
    ///
    /// M. D. McKay, R. J. Beckman and W. J. Conover: A comparison of three methods for selecting values of input variables
    /// in the analysis of output from a computer code, Technometrics 21 (1979), 239–245.
    ///
    /// # Errors
    /// If there are more than [`LATIN_SAMPLES_MAX`] samples.
    pub fn latin(seed: u64, samples: u64, dimensions: usize) -> Result<Self, DesignError> {
        if samples > LATIN_SAMPLES_MAX {
            return Err(DesignError::LatinSamples(samples));
        }
        let strata = (0..dimensions as u64).map(|dimension| permutation(seed, samples as u32, dimension));
        let points = Points::Latin {
            seed,
            samples,
            strata: strata.collect(),
        };
        Ok(Self { dimensions, points })
    }

    /// Makes a design of all combinations of `levels` in each dimension; the last dimension changes fastest.
    ///
    /// # Errors
    /// If a dimension has no levels, or if there are 2^64 combinations or more.
    pub fn grid(levels: Vec<u32>) -> Result<Self, DesignError> {
        if let Some(dimension) = levels.iter().position(|&levels| levels == 0) {
            return Err(DesignError::NoLevels(dimension));
        }
        let product = |product: u64, &levels: &u32| product.checked_mul(u64::from(levels));
        let samples = levels.iter().try_fold(1, product);
        Ok(Self {
            dimensions: levels.len(),
            points: Points::Grid {
                samples: samples.ok_or(DesignError::GridTooLarge)?,
                levels,
            },
        })
    }

    /// Returns the sampling method.
    #[must_use]
    pub const fn method(&self) -> Method {
        match self.points {
            Points::Random { .. } => Method::Random,
            Points::Sobol { .. } => Method::Sobol,
            Points::Latin { .. } => Method::Latin,
            Points::Grid { .. } => Method::Grid,
        }
    }

    #[must_use]
    pub const fn dimensions(&self) -> usize {
        self.dimensions
    }

    /// Returns the number of samples; `None` for independent points, which are unlimited.
    #[must_use]
    pub const fn samples(&self) -> Option<u64> {
        match self.points {
            Points::Random { .. } => None,
            Points::Sobol { samples, .. } | Points::Latin { samples, .. } | Points::Grid { samples, .. } => {
                Some(samples)
            }
        }
    }

    /// Returns the point of a sample, each coordinate in [0, 1).
    ///
    /// On a grid, level k of n has the coordinate (k + ½)/n.
    ///
    /// # Panics
    /// If the design has no such sample.
    #[must_use]
    pub fn point(&self, index: u64) -> Vec<f64> {
        self.assert_has(index);
        match &self.points {
            Points::Random { seed } => {
                let mut generator = Generator::new(*seed, Purpose::Point, index);
                (0..self.dimensions).map(|_| generator.uniform()).collect()
            }
            Points::Sobol { scramble, .. } => (0..self.dimensions as u32)
                .map(|dimension| sobol(index as u32, dimension, *scramble))
                .collect(),
            Points::Latin {
                seed,
                samples,
                strata,
            } => {
                let mut places = Generator::new(*seed, Purpose::Offset, index);
                let strata = strata.iter().map(|strata| strata[index as usize]);
                strata
                    .map(|stratum| in_stratum(stratum, *samples, places.bits32()))
                    .collect()
            }
            Points::Grid { levels, .. } => std::iter::zip(digits(index, levels), levels)
                .map(|(level, &levels)| (f64::from(level) + 0.5) / f64::from(levels))
                .collect(),
        }
    }

    /// Returns the index of the level in each dimension of a sample of a grid; `None` for other methods.
    ///
    /// # Panics
    /// If the design has no such sample.
    #[must_use]
    pub fn levels(&self, index: u64) -> Option<Vec<u32>> {
        self.assert_has(index);
        match &self.points {
            Points::Grid { levels, .. } => Some(digits(index, levels)),
            _ => None,
        }
    }

    fn assert_has(&self, index: u64) {
        if let Some(samples) = self.samples() {
            assert!(index < samples, "no sample {index} in a design of {samples}");
        }
    }
}

/// Returns the seed of a sample's flight, of 53 bits so that a double represents it exactly.
///
/// It is independent of the sample's point.
#[must_use]
pub fn sample_seed(seed: u64, index: u64) -> u64 {
    Generator::new(seed, Purpose::SampleSeed, index).bits53()
}

/// Returns a coordinate of a point of the scrambled Sobol sequence: the centre of its cell of 2⁻²³, hence not 0.
fn sobol(index: u32, dimension: u32, scramble: u32) -> f64 {
    const HALF_A_CELL: f64 = 0.5 / (1_u64 << 23) as f64;
    f64::from(sobol_burley::sample(index, dimension, scramble)) + HALF_A_CELL
}

/// Returns (stratum + u)/samples with u the centre of a random one of 2²⁴ cells: with more cells the sum would not be exact
/// for [`LATIN_SAMPLES_MAX`] strata, and the rounded quotient could leave the stratum.
fn in_stratum(stratum: u32, samples: u64, bits: u32) -> f64 {
    let place = (f64::from(bits >> 8) + 0.5) / f64::from(1_u32 << 24);
    (f64::from(stratum) + place) / samples as f64
}

/// Returns a random permutation of 0 … n − 1, by the shuffle of Fisher and Yates.
fn permutation(seed: u64, n: u32, dimension: u64) -> Vec<u32> {
    let mut generator = Generator::new(seed, Purpose::Permutation, dimension);
    let mut permutation: Vec<u32> = (0..n).collect();
    for last in (1..permutation.len()).rev() {
        permutation.swap(last, generator.below(last + 1));
    }
    permutation
}

/// Returns the digits of an index in the mixed radix of the levels, the last one the fastest.
fn digits(index: u64, levels: &[u32]) -> Vec<u32> {
    let mut rest = index;
    let mut digits = vec![0; levels.len()];
    for (digit, &levels) in digits.iter_mut().zip(levels).rev() {
        *digit = (rest % u64::from(levels)) as u32;
        rest /= u64::from(levels);
    }
    digits
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn designs(seed: u64, samples: u64, dimensions: usize) -> [Design; 4] {
        [
            Design::random(seed, dimensions),
            Design::sobol(seed, samples, dimensions).unwrap(),
            Design::latin(seed, samples, dimensions).unwrap(),
            Design::grid(vec![3; dimensions]).unwrap(),
        ]
    }

    #[test]
    fn the_points_are_stable() {
        let points =
            designs(7, 100, 2).map(|design| design.point(5).iter().map(|x| x.to_bits()).collect::<Vec<_>>());
        assert_eq!(points, STABLE_POINTS);
        assert_eq!(sample_seed(7, 5), STABLE_SEED);
    }

    /// Pinned: a change of these bits changes every sweep.
    const STABLE_POINTS: [[u64; 2]; 4] = [
        [4604338386898351588, 4603664169873868951],
        [4600795612378562560, 4604367295907627008],
        [4600825333010011259, 4584727738831979151],
        [4602678819172646912, 4605681218924227243],
    ];
    const STABLE_SEED: u64 = 6981304971726939;

    #[test]
    fn the_limits_of_each_method_are_refused_by_name() {
        assert!(Design::sobol(1, SOBOL_SAMPLES_MAX, SOBOL_DIMENSIONS_MAX).is_ok());
        assert_eq!(
            Design::sobol(1, 65_537, 2),
            Err(DesignError::SobolSamples(65_537))
        );
        assert_eq!(Design::sobol(1, 10, 257), Err(DesignError::SobolDimensions(257)));
        let beyond = LATIN_SAMPLES_MAX + 1;
        assert_eq!(
            Design::latin(1, beyond, 2),
            Err(DesignError::LatinSamples(beyond))
        );
        assert_eq!(Design::grid(vec![3, 0, 2]), Err(DesignError::NoLevels(1)));
        assert_eq!(
            Design::grid(vec![u32::MAX, u32::MAX, 2]),
            Err(DesignError::GridTooLarge)
        );
        assert!(DesignError::SobolSamples(65_537).to_string().contains("65536"));
    }

    #[test]
    fn the_last_sample_of_the_largest_designs_has_a_point() {
        let sobol = Design::sobol(1, SOBOL_SAMPLES_MAX, SOBOL_DIMENSIONS_MAX).unwrap();
        assert_eq!(sobol.point(SOBOL_SAMPLES_MAX - 1).len(), 256);
        let latin = Design::latin(1, LATIN_SAMPLES_MAX, 1).unwrap();
        let [x] = latin.point(LATIN_SAMPLES_MAX - 1)[..] else {
            panic!("one dimension")
        };
        assert!((0.0..1.0).contains(&x));
    }

    #[test]
    fn the_first_dimension_of_a_grid_is_the_slowest() {
        let grid = Design::grid(vec![2, 3]).unwrap();
        assert_eq!(grid.samples(), Some(6));
        let levels = [[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [1, 2]];
        for (index, levels) in (0..).zip(levels) {
            assert_eq!(grid.levels(index).unwrap(), levels);
        }
        assert_eq!(grid.point(5), [0.75, 2.5 / 3.0]);
    }

    #[test]
    #[should_panic(expected = "no sample 6 in a design of 6")]
    fn a_grid_has_no_sample_beyond_its_product() {
        let _ = Design::grid(vec![2, 3]).unwrap().point(6);
    }

    #[test]
    fn random_points_fill_the_interval() {
        let design = Design::random(3, 2);
        let mut counts = [0_u32; 10];
        for index in 0..20_000 {
            counts[(design.point(index)[1] * 10.0) as usize] += 1;
        }
        assert!(
            counts.iter().all(|count| (1_800..2_200).contains(count)),
            "{counts:?}"
        );
    }

    proptest! {
        #[test]
        fn a_latin_design_has_one_point_in_each_stratum_of_every_dimension(
            seed: u64, samples in 1..300_u64, dimensions in 1..6_usize,
        ) {
            let design = Design::latin(seed, samples, dimensions).unwrap();
            let points: Vec<_> = (0..samples).map(|index| design.point(index)).collect();
            for dimension in 0..dimensions {
                let strata = points.iter().map(|point| (point[dimension] * samples as f64) as u64);
                let mut strata: Vec<_> = strata.collect();
                strata.sort_unstable();
                prop_assert_eq!(strata, (0..samples).collect::<Vec<_>>());
            }
        }

        #[test]
        fn the_first_points_of_a_sobol_sequence_lie_in_one_interval_each(seed: u64, exponent in 0..9_u32) {
            let samples = 1_u64 << exponent;
            let design = Design::sobol(seed, samples, 8).unwrap();
            for dimension in 0..8 {
                let cells = (0..samples).map(|index| (design.point(index)[dimension] * samples as f64) as u64);
                let mut cells: Vec<_> = cells.collect();
                cells.sort_unstable();
                prop_assert_eq!(cells, (0..samples).collect::<Vec<_>>());
            }
        }

        #[test]
        fn a_sample_does_not_depend_on_the_others(seed: u64, first in 0..81_u64, second in 0..81_u64) {
            for (used, fresh) in designs(seed, 81, 4).into_iter().zip(designs(seed, 81, 4)) {
                let _other = used.point(first);
                prop_assert_eq!(used.point(second), fresh.point(second));
                prop_assert_eq!(used.levels(second), fresh.levels(second));
                prop_assert_eq!(first == second, used.point(first) == used.point(second));
            }
        }

        #[test]
        fn further_dimensions_and_samples_leave_the_first_ones_as_they_are(
            seed: u64, index in 0..50_u64, further in 1..5_usize,
        ) {
            let pairs = [
                (Design::random(seed, 3), Design::random(seed, 3 + further)),
                (Design::sobol(seed, 50, 3).unwrap(), Design::sobol(seed, 5000, 3 + further).unwrap()),
                (Design::latin(seed, 50, 3).unwrap(), Design::latin(seed, 50, 3 + further).unwrap()),
            ];
            for (fewer, more) in pairs {
                prop_assert_eq!(&fewer.point(index)[..], &more.point(index)[..3]);
            }
        }

        #[test]
        fn points_lie_in_the_unit_cube_and_follow_the_seed(seed: u64, index in 0..81_u64) {
            for (design, other) in designs(seed, 81, 4).into_iter().zip(designs(seed ^ 1, 81, 4)) {
                let point = design.point(index);
                prop_assert_eq!(point.len(), design.dimensions());
                prop_assert!(point.iter().all(|x| (0.0..1.0).contains(x)), "{:?}", point);
                prop_assert_eq!(point == other.point(index), design.method() == Method::Grid);
            }
        }

        #[test]
        fn the_seed_of_a_sample_has_53_bits_and_follows_seed_and_index(seed: u64, index in 0..u64::MAX) {
            let of_sample = sample_seed(seed, index);
            prop_assert!(of_sample < 1 << 53);
            prop_assert_ne!(of_sample, sample_seed(seed, index + 1));
            prop_assert_ne!(of_sample, sample_seed(seed ^ 1, index));
        }
    }
}
