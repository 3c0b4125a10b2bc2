//! The signed-rank test: F. Wilcoxon (1945); M. Hollander and D. A. Wolfe, Nonparametric Statistical Methods, 3.1.

use crate::normal;

/// Maximum number of differences for which the distribution under the null hypothesis is computed exactly.
pub const EXACT_MAX: usize = 50;

/// Ranked magnitudes of the differences other than 0.
struct Ranked {
    differences: usize,
    /// Twice the ranks, which are integers also for ties with their mean rank.
    doubled: Vec<usize>,
    /// Sum of the ranks of positive differences.
    positive: f64,
    /// Sum of t³ − t over the groups of t equal magnitudes; 0 without ties.
    ties: f64,
}

/// Returns the two-sided p-value of differences under symmetry about 0.
///
/// Differences of 0 are ignored, and equal magnitudes have their mean rank. Up to [`EXACT_MAX`] differences the value is
/// exact, also with ties; beyond, the rank sum W is approximated as normal, with corrections for continuity and ties:
///
/// ```text
/// z = (|W − n(n + 1)/4| − ½)/√(n(n + 1)(2n + 1)/24 − Σ(t³ − t)/48)
/// ```
#[must_use]
pub fn p_value(differences: &[f64]) -> f64 {
    let ranked = Ranked::of(differences);
    if ranked.differences == 0 {
        1.0
    } else if ranked.differences <= EXACT_MAX {
        ranked.exact()
    } else {
        ranked.approximate()
    }
}

impl Ranked {
    fn of(differences: &[f64]) -> Self {
        let not_zero = differences
            .iter()
            .copied()
            .filter(|&difference| difference != 0.0);
        let mut by_size: Vec<_> = not_zero.collect();
        by_size.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        let mut ranked = Self {
            differences: by_size.len(),
            doubled: Vec::with_capacity(by_size.len()),
            positive: 0.0,
            ties: 0.0,
        };
        let mut before = 0;
        for group in by_size.chunk_by(|a, b| a.abs() == b.abs()) {
            let (size, positive) = (group.len() as f64, group.iter().filter(|&&d| d > 0.0).count());
            // Mean of the ranks before + 1 … before + size.
            ranked.positive += positive as f64 * (before as f64 + 0.5 * (size + 1.0));
            let doubled = 2 * before + group.len() + 1;
            ranked.doubled.extend(group.iter().map(|_| doubled));
            ranked.ties += size * size * size - size;
            before += group.len();
        }
        ranked
    }

    /// Returns the sum of all ranks.
    fn total(&self) -> f64 {
        let n = self.differences as f64;
        0.5 * n * (n + 1.0)
    }

    /// Returns twice the probability of at most the smaller rank sum, with all 2^n choices of signs equally probable.
    fn exact(&self) -> f64 {
        let smaller = (2.0 * self.positive.min(self.total() - self.positive)) as usize;
        // Number of choices of signs whose positive ranks, doubled, have each sum, rank after rank.
        let mut choices = vec![0_u64; smaller + 1];
        choices[0] = 1;
        for &rank in &self.doubled {
            for sum in (rank..=smaller).rev() {
                choices[sum] += choices[sum - rank];
            }
        }
        let favourable: u64 = choices.iter().sum();
        let all = 1_u64 << self.differences;
        (2.0 * favourable as f64 / all as f64).min(1.0)
    }

    fn approximate(&self) -> f64 {
        let n = self.differences as f64;
        let variance = n * (n + 1.0) * (2.0 * n + 1.0) / 24.0 - self.ties / 48.0;
        let distance = (self.positive - 0.5 * self.total()).abs() - 0.5;
        (2.0 * normal::cumulative(-distance.max(0.0) / variance.sqrt())).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// 1 … n with every third one negative.
    fn thirds(n: i32) -> Vec<f64> {
        (1..=n)
            .map(|i| f64::from(if i % 3 == 0 { -i } else { i }))
            .collect()
    }

    fn assert_close(p: f64, expected: f64) {
        assert!((p / expected - 1.0).abs() < 1e-12, "{p}, not {expected}");
    }

    #[test]
    fn of_few_differences_the_value_is_exact() {
        // scipy.stats.wilcoxon(differences, method="exact").pvalue
        assert_close(p_value(&thirds(50)), 0.02616696817119646);
        assert_close(p_value(&[1.0, 2.0, 3.0]), 0.25);
        // With ties: of all choices of signs, one by one.
        assert_close(p_value(&[0.5; 5]), 0.0625);
        assert_close(p_value(&[0.5; 6]), 0.03125);
        assert_close(p_value(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0]), 0.0703125);
        let tied = [1.0, 1.0, -2.0, 3.0, -3.0, 3.0, 0.0, 5.0, 6.0, 6.0, -1.0, 7.0];
        assert_close(p_value(&tied), 0.0703125);
    }

    #[test]
    fn many_differences_are_taken_for_normal() {
        // scipy.stats.wilcoxon(differences, zero_method="wilcox", correction=True, method="approx").pvalue
        assert_close(p_value(&thirds(60)), 0.03622649417878663);
        let tied = [1.0, 1.0, -2.0, 3.0, -3.0, 3.0, 0.0, 5.0, 6.0, 6.0, -1.0, 7.0];
        assert_close(Ranked::of(&tied).approximate(), 0.06712568952060435);
    }

    #[test]
    fn without_a_difference_nothing_is_said() {
        assert_eq!([p_value(&[]), p_value(&[0.0, -0.0])], [1.0, 1.0]);
    }

    proptest! {
        #[test]
        fn the_exact_value_counts_the_choices_of_signs(signs in 0..1024_u32) {
            let sum = |signs: u32| (1..=10).filter(|rank| signs >> (rank - 1) & 1 > 0).sum::<u32>();
            let differences: Vec<_> = (1..=10)
                .map(|rank| f64::from(rank) * if signs >> (rank - 1) & 1 > 0 { 1.0 } else { -1.0 })
                .collect();
            let smaller = sum(signs).min(55 - sum(signs));
            let favourable = (0..1024).filter(|&other| sum(other) <= smaller).count();
            let expected = (favourable as f64 / 512.0).min(1.0);
            prop_assert_eq!(p_value(&differences), expected);
        }

        #[test]
        fn exact_and_approximate_values_are_near_at_the_limit(signs in 0..1_u64 << 50) {
            let differences: Vec<_> = (1..=50_i32)
                .map(|rank| f64::from(if signs >> (rank - 1) & 1 > 0 { rank } else { -rank }))
                .collect();
            let ranked = Ranked::of(&differences);
            prop_assert!((ranked.exact() - ranked.approximate()).abs() < 0.01);
        }
    }
}
