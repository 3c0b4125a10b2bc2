//! Bins of a varied value.

use statistics::quantile::{quantile, sorted};

use crate::report::digits;

/// Maximum number of distinct values that form separate bins.
const MAX_LEVELS: usize = 12;

/// Bins of a varied value: its distinct values if they are few, else ranges with equal numbers of samples.
#[derive(Clone, Debug)]
pub(crate) struct Parts(Vec<[f64; 2]>);

impl Parts {
    /// Makes the bins of all values; `ranges` bins if there are many distinct values.
    pub(crate) fn new(values: &[f64], ranges: usize) -> Self {
        let all = sorted(values.iter().copied());
        let mut levels = all.clone();
        levels.dedup();
        if levels.len() <= MAX_LEVELS {
            return Self(levels.into_iter().map(|level| [level, level]).collect());
        }
        #[expect(clippy::cast_precision_loss, reason = "a few parts")]
        let at = |part: usize| quantile(&all, part as f64 / ranges as f64).unwrap_or(f64::NAN);
        Self((0..ranges).map(|part| [at(part), at(part + 1)]).collect())
    }

    /// Returns the bins as ranges; the upper end belongs to the next bin if there is one.
    pub(crate) fn ranges(&self) -> &[[f64; 2]] {
        &self.0
    }

    /// Returns the index of the bin that contains a value.
    pub(crate) fn index(&self, value: f64) -> usize {
        let later = self.0.iter().skip(1);
        later.take_while(|[from, _]| value >= *from).count()
    }

    /// Returns the labels of the bins.
    pub(crate) fn labels(&self) -> impl ExactSizeIterator<Item = String> {
        self.0.iter().copied().map(label)
    }
}

/// Returns the label of a bin.
pub(crate) fn label([from, to]: [f64; 2]) -> String {
    if from == to {
        digits(from)
    } else {
        format!("{} to {}", digits(from), digits(to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_are_parts_of_their_own_and_many_are_ranges() {
        let levels = Parts::new(&[6.0, 0.0, 3.0, 3.0, f64::NAN], 4);
        assert_eq!(levels.labels().collect::<Vec<_>>(), ["0", "3", "6"]);
        assert_eq!([0.0, 3.0, 6.0].map(|value| levels.index(value)), [0, 1, 2]);
        let many: Vec<f64> = (0..=40).map(f64::from).collect();
        let ranges = Parts::new(&many, 4);
        assert_eq!(ranges.labels().next().unwrap(), "0 to 10");
        assert_eq!(
            [0.0, 9.0, 10.0, 40.0].map(|value| ranges.index(value)),
            [0, 0, 1, 3]
        );
    }
}
