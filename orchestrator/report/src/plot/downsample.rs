//! Downsampling that keeps peaks: the smallest and the largest value of every column of pixels.

/// The points with the smallest and the largest value of a set.
#[derive(Clone, Copy, Debug)]
pub struct Extreme {
    least: (f64, f64),
    greatest: (f64, f64),
}

impl Extreme {
    /// Starts with a single point.
    pub fn new(point: (f64, f64)) -> Self {
        Self {
            least: point,
            greatest: point,
        }
    }

    /// Adds a point.
    pub fn add(&mut self, point: (f64, f64)) {
        if point.1 < self.least.1 {
            self.least = point;
        }
        if point.1 > self.greatest.1 {
            self.greatest = point;
        }
    }

    /// Returns both points in the order of time.
    pub fn in_order(self) -> [(f64, f64); 2] {
        if self.least.0 <= self.greatest.0 {
            [self.least, self.greatest]
        } else {
            [self.greatest, self.least]
        }
    }
}

/// Downsamples points, added in the order of time, column by column.
pub struct Extremes {
    column_width: f64,
    /// Index and extremes of the current column.
    column: Option<(usize, Extreme)>,
    points: Vec<(f64, f64)>,
}

impl Extremes {
    /// Divides the time `duration` into `columns` columns.
    pub fn new(duration: f64, columns: usize) -> Self {
        Self {
            column_width: duration / columns as f64,
            column: None,
            points: Vec::with_capacity(2 * columns + 2),
        }
    }

    /// Adds a point.
    pub fn add(&mut self, time: f64, value: f64) {
        let index = (time / self.column_width) as usize;
        let point = (time, value);
        match &mut self.column {
            Some((column, extreme)) if *column == index => extreme.add(point),
            _ => {
                self.close_column();
                self.column = Some((index, Extreme::new(point)));
            }
        }
    }

    /// Returns the points to draw, in the order of time.
    pub fn finish(mut self) -> Vec<(f64, f64)> {
        self.close_column();
        self.points
    }

    fn close_column(&mut self) {
        let Some((_, extreme)) = self.column.take() else {
            return;
        };
        let [first, second] = extreme.in_order();
        self.points.push(first);
        if second != first {
            self.points.push(second);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_column_keeps_its_extremes_in_the_order_of_time(
            values in proptest::collection::vec(-1e3..1e3f64, 1..400),
            columns in 1..20usize,
        ) {
            let duration = values.len() as f64;
            let mut extremes = Extremes::new(duration, columns);
            let points: Vec<_> = values.iter().enumerate().map(|(index, &value)| (index as f64, value)).collect();
            for &(time, value) in &points {
                extremes.add(time, value);
            }
            let kept = extremes.finish();
            prop_assert!(kept.len() <= 2 * columns);
            prop_assert!(kept.is_sorted_by(|left, right| left.0 < right.0));
            prop_assert!(kept.iter().all(|point| points.contains(point)));
            let column = |&(time, _): &(f64, f64)| (time / (duration / columns as f64)) as usize;
            for members in points.chunk_by(|left, right| column(left) == column(right)) {
                let here: Vec<f64> = kept.iter().filter(|point| column(point) == column(&members[0])).map(|point| point.1).collect();
                let values = || members.iter().map(|point| point.1);
                let least = values().fold(f64::INFINITY, f64::min);
                let greatest = values().fold(f64::NEG_INFINITY, f64::max);
                prop_assert!(here.contains(&least) && here.contains(&greatest));
            }
        }
    }
}
