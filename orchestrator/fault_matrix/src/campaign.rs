//! All flights of the matrix. Their results are kept as they come, and an interrupted matrix resumes from them.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use ::flight::campaign::Campaign;
use ::flight::interrupt::Interrupt;
use reproduce::flight::FLIGHTS;
use scenario::Scenario;

use super::flight::{FlightResult, Way, fly};
use super::plan::MatrixCell;
use super::undisturbed::{NotFlown, Undisturbed};

/// The cells of a scenario, and the flight that they are compared with.
#[derive(Debug)]
pub struct Matrix<'a> {
    scenario: &'a Scenario,
    cells: &'a [MatrixCell],
    /// Flown when the first cell needs it: no cell does if all results are kept.
    undisturbed: Mutex<Option<Undisturbed>>,
}

impl<'a> Matrix<'a> {
    /// Makes the matrix of a scenario that plans no fault.
    #[must_use]
    pub fn new(scenario: &'a Scenario, cells: &'a [MatrixCell]) -> Self {
        Self {
            scenario,
            cells,
            undisturbed: Mutex::default(),
        }
    }

    /// Flies all cells in this process on some threads, and returns their results; none if the matrix was interrupted.
    /// Results are kept in `folder`, from which an interrupted matrix resumes. Calls `flown` with the number of results, first
    /// and after each flight.
    ///
    /// # Errors
    /// [`NotFlown`] if a cell cannot be flown, or if the folder holds the results of other flights.
    pub fn fly(
        &self,
        with_digest: bool,
        threads: usize,
        folder: &Path,
        interrupt: &Interrupt,
        flown: impl FnMut(usize),
    ) -> Result<Option<Vec<FlightResult>>, NotFlown> {
        // The moment of an undisturbed cell is not in its scenario.
        let flights = self.cells.iter().map(|cell| {
            let watched = (cell.watched.from, cell.watched.until);
            (self.scenario, &cell.scenario, cell.moment, watched, with_digest)
        });
        let campaign = Campaign::new("faults", flights)?;
        let way = Way::InProcess { with_digest };
        let fly = |index: usize| match self.fly_cell(&self.cells[index], way, interrupt) {
            Err(NotFlown::Interrupted(_)) => None,
            flown => Some(flown),
        };
        let results = campaign.fly(&folder.join(FLIGHTS), threads, fly, flown)?;
        Ok((results.len() == self.cells.len()).then_some(results))
    }

    /// Flies a cell.
    ///
    /// # Errors
    /// [`NotFlown`] as of [`fly`].
    pub fn fly_cell(
        &self,
        cell: &MatrixCell,
        way: Way,
        interrupt: &Interrupt,
    ) -> Result<FlightResult, NotFlown> {
        fly(cell, way, &self.undisturbed(interrupt)?, interrupt)
    }

    fn undisturbed(&self, interrupt: &Interrupt) -> Result<Undisturbed, NotFlown> {
        // Locked while it is flown: the other threads need it too.
        let mut undisturbed = self.undisturbed.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(undisturbed) = &*undisturbed {
            return Ok(undisturbed.clone());
        }
        let ends = self.cells.iter().map(|cell| cell.scenario.duration);
        let flown = Undisturbed::fly(self.scenario, ends.fold(0.0, f64::max), interrupt)?;
        Ok(undisturbed.insert(flown).clone())
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use run_log::test_flight::scenario_of_own_controller as scenario;
    use scenario::EdgeName;
    use shared_types::ServiceId;

    use super::*;
    use crate::fault_kind::MatrixFault;
    use crate::plan::{self, Times};
    use ::flight::journal::JournalError;

    #[test]
    fn an_interrupted_matrix_resumes_with_the_same_bytes_and_a_complete_one_is_not_flown_again() {
        let mut scenario = scenario(0.002, 4.0);
        scenario.vehicle.initial.position = [0.0, 0.0, -1.0];
        let times = Times {
            // The controller also fails while the mass changes.
            moments: vec![1.0, 1.95],
            lasts: 0.5,
            after: 0.2,
        };
        let edges: Vec<_> = EdgeName::find("mocap/pose -> estimator").into_iter().collect();
        let cases = plan::cases(&[ServiceId::Controller], &edges, &MatrixFault::ALL);
        let cells = plan::cells(&scenario, &cases, &times).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let [whole, broken] = ["whole", "broken"].map(|name| folder.path().join(name));
        let fly = |cells: &[MatrixCell], out: &Path, last: usize| {
            fs::create_dir_all(out).unwrap();
            let interrupt = Interrupt::never();
            let flown = |results| {
                if results >= last {
                    interrupt.raise(2);
                }
            };
            Matrix::new(&scenario, cells).fly(false, 2, out, &interrupt, flown)
        };

        let all = fly(&cells, &whole, usize::MAX).unwrap().unwrap();
        assert!(all.iter().any(|result| result.cell.why.is_some()));
        assert!(all.iter().any(|result| {
            let report = result.cell.report.as_ref();
            report.is_some_and(|report| report.detection.is_some())
        }));
        assert_eq!(fly(&cells, &broken, 3).unwrap(), None);
        assert_eq!(fly(&cells, &broken, usize::MAX).unwrap().as_ref(), Some(&all));
        let [bytes, resumed] = [&whole, &broken].map(|out| fs::read(out.join(FLIGHTS)).unwrap());
        assert_eq!(bytes, resumed);
        // A flight would be refused by the interrupt.
        assert_eq!(fly(&cells, &whole, 0).unwrap().as_ref(), Some(&all));

        let refused = fly(&cells[1..], &whole, usize::MAX).unwrap_err();
        assert!(
            matches!(refused, NotFlown::Journal(JournalError::Foreign { .. })),
            "{refused}"
        );
    }
}
