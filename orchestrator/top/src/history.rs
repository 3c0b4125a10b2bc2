//! The last minute of a live run: snapshots contain only the present state.

use std::collections::VecDeque;

use run_client::Snapshot;

/// Length of the history, s.
pub const SPAN: f64 = 60.0;

/// Quantity with a trend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trend {
    PositionError,
    /// m̂, kg.
    MassEstimate,
    /// ‖b̂‖, m/s².
    DisturbanceEstimate,
}

impl Trend {
    pub const ALL: [Self; 3] = [Self::PositionError, Self::MassEstimate, Self::DisturbanceEstimate];

    fn of(self, snapshot: &Snapshot) -> Option<f64> {
        match self {
            Self::PositionError => snapshot.position_error,
            Self::MassEstimate => snapshot.mass_estimate,
            Self::DisturbanceEstimate => snapshot.disturbance_estimate,
        }
    }
}

/// Trends of the last minute.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    points: VecDeque<Point>,
}

#[derive(Clone, Debug, PartialEq)]
struct Point {
    time: f64,
    values: [Option<f64>; Trend::ALL.len()],
}

impl History {
    /// Appends the values of a snapshot and removes those older than [`SPAN`].
    pub fn keep(&mut self, snapshot: &Snapshot) {
        let time = snapshot.time;
        self.points
            .retain(|point| (0.0..SPAN).contains(&(time - point.time)));
        let values = Trend::ALL.map(|trend| trend.of(snapshot));
        self.points.push_back(Point { time, values });
    }

    #[must_use]
    pub fn newest(&self, trend: Trend) -> Option<f64> {
        self.points.back()?.values[trend as usize]
    }

    /// Divides the last minute into `columns` equal parts, the newest last, and returns the maximum of each; `None`
    /// without a value.
    #[must_use]
    pub fn columns(&self, trend: Trend, columns: usize) -> Vec<Option<f64>> {
        let mut largest = vec![None; columns];
        let Some(newest) = self.points.back().map(|point| point.time) else {
            return largest;
        };
        for point in &self.points {
            let Some(value) = point.values[trend as usize] else {
                continue;
            };
            let back = ((newest - point.time) / SPAN * columns as f64) as usize;
            if let Some(column) = columns.checked_sub(1 + back) {
                largest[column] = Some(largest[column].map_or(value, |other: f64| other.max(value)));
            }
        }
        largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time: f64, error: Option<f64>) -> Snapshot {
        Snapshot {
            time,
            position_error: error,
            ..Snapshot::default()
        }
    }

    #[test]
    fn a_minute_is_kept_and_no_more() {
        let mut history = History::default();
        for step in 0..1000 {
            history.keep(&at(f64::from(step) * 0.25, Some(f64::from(step))));
        }
        assert_eq!(history.points.len(), 240);
        assert_eq!(history.newest(Trend::PositionError), Some(999.0));
        assert_eq!(history.newest(Trend::MassEstimate), None);
    }

    #[test]
    fn a_column_is_the_largest_of_its_time_and_empty_without_one() {
        let mut history = History::default();
        for (time, error) in [(0.0, 9.0), (31.0, 1.0), (32.0, 3.0), (33.0, 2.0), (59.0, 5.0)] {
            history.keep(&at(time, Some(error)));
        }
        history.keep(&at(59.5, None));
        let columns = history.columns(Trend::PositionError, 6);
        assert_eq!(columns, [Some(9.0), None, None, Some(3.0), None, Some(5.0)]);
        assert_eq!(history.columns(Trend::PositionError, 0), []);
        assert_eq!(history.newest(Trend::PositionError), None);
    }

    #[test]
    fn a_clock_that_goes_back_begins_anew() {
        let mut history = History::default();
        history.keep(&at(50.0, Some(1.0)));
        history.keep(&at(1.0, Some(2.0)));
        assert_eq!(history.columns(Trend::PositionError, 2), [None, Some(2.0)]);
    }
}
