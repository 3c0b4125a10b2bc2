//! A campaign: many flights, each with a result. The results are in the order of the flights; a campaign that was killed
//! resumes behind those that it has written.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use shared_types::sample::hex;

use crate::identity::program_hash;
use crate::journal::{Header, Journal, JournalError, JournalReader};

/// Everything that the results of a campaign depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Campaign {
    /// What is made of the flights, such as `grid`.
    kind: String,
    /// SHA-256 of the program, in hexadecimal.
    program: String,
    /// Number of flights.
    flights: u64,
    /// SHA-256 of what is flown, in hexadecimal.
    flown: String,
}

impl Campaign {
    /// Makes the campaign of a kind that flies these flights, each of which is said by a scenario, or by more than one value.
    ///
    /// # Errors
    /// [`JournalError::Program`] if the program cannot be read.
    ///
    /// # Panics
    /// If a flight cannot be written as JSON.
    pub fn new<F: Serialize>(kind: &str, flights: impl IntoIterator<Item = F>) -> Result<Self, JournalError> {
        let (mut hash, mut count) = (Sha256::new(), 0);
        for flight in flights {
            hash.update(serde_json::to_vec(&flight).expect("flights can be written"));
            count += 1;
        }
        Ok(Self {
            kind: kind.to_owned(),
            program: program_hash().map_err(JournalError::Program)?,
            flights: count,
            flown: hex(&hash.finalize()),
        })
    }

    /// Flies the flights whose results the journal at `path` lacks, on some threads, and returns the results of all; of an
    /// interrupted campaign those so far. `fly` returns the result of the flight of a number, or nothing if it was
    /// interrupted. Calls `flown` with the number of results at the beginning, and after each flight.
    ///
    /// # Errors
    /// That of a flight, or [`JournalError`] if the journal is of something else or cannot be written.
    pub fn fly<R, E>(
        &self,
        path: &Path,
        threads: usize,
        fly: impl Fn(usize) -> Option<Result<R, E>> + Sync,
        mut flown: impl FnMut(usize),
    ) -> Result<Vec<R>, E>
    where
        R: Serialize + DeserializeOwned + Send,
        E: From<JournalError> + Send,
    {
        let mut results = Vec::new();
        if path.exists() {
            self.read(path, &mut results)?;
            flown(results.len());
            return Ok(results);
        }
        let journal = Journal::open(path, self, |result| {
            results.push(result);
            true
        })?;
        flown(results.len());
        let fly = |index| {
            let flown = fly(usize::try_from(index).expect("an index of a list"))?;
            Some(flown.map(|result| (result, ())))
        };
        journal.fill(threads, fly, |_, result, ()| {
            results.push(result);
            flown(results.len());
        })?;
        Ok(results)
    }

    /// Reads the results of a complete journal.
    fn read<R: DeserializeOwned>(&self, path: &Path, results: &mut Vec<R>) -> Result<(), JournalError> {
        let mut reader = JournalReader::<Self, R>::open(path)?;
        self.check(path, &reader.header)?;
        while let Some(result) = reader.next_result()? {
            results.push(result);
        }
        Ok(())
    }
}

impl Header for Campaign {
    fn flights(&self) -> u64 {
        self.flights
    }

    fn difference(&self, other: &Self) -> Option<String> {
        let reason = if self.kind != other.kind {
            "it is of another command"
        } else if (self.flights, &self.flown) != (other.flights, &other.flown) {
            "it is of other flights"
        } else if self.program != other.program {
            "it was flown by another build of gerono, whose flights may differ in their bits"
        } else {
            return None;
        };
        Some(reason.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use run_log::test_flight::scenario_of_own_controller as scenario;

    use super::*;

    fn campaign(kind: &str, durations: &[f64]) -> Campaign {
        let scenarios: Vec<_> = durations
            .iter()
            .map(|&duration| scenario(0.001, duration))
            .collect();
        Campaign::new(kind, &scenarios).unwrap()
    }

    fn fly(campaign: &Campaign, path: &Path, last: usize) -> (Result<Vec<f64>, JournalError>, usize) {
        let begun = AtomicUsize::new(0);
        let fly = |index: usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            (index < last).then(|| Ok(1.0 / (1.0 + index as f64)))
        };
        let results = campaign.fly(path, 2, fly, |_| ());
        (results, begun.into_inner())
    }

    #[test]
    fn a_campaign_resumes_behind_what_was_flown_and_its_journal_has_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let [whole, broken] = ["whole", "broken"].map(|name| folder.path().join(name));
        let campaign = campaign("grid", &[1.0; 40]);
        let (all, _) = fly(&campaign, &whole, 40);
        let all = all.unwrap();
        let (some, _) = fly(&campaign, &broken, 25);
        let some = some.unwrap();
        assert_eq!(some, all[..some.len()]);
        let (again, begun) = fly(&campaign, &broken, 40);
        assert_eq!((again.unwrap(), begun), (all.clone(), 40 - some.len()));
        assert_eq!(std::fs::read(&whole).unwrap(), std::fs::read(&broken).unwrap());
        let (read, begun) = fly(&campaign, &whole, 40);
        assert_eq!((read.unwrap(), begun), (all, 0));
    }

    #[test]
    fn a_journal_of_other_flights_or_of_another_command_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flights");
        fly(&campaign("grid", &[1.0, 2.0]), &path, 2).0.unwrap();
        for other in [
            campaign("grid", &[1.0, 3.0]),
            campaign("grid", &[1.0]),
            campaign("ablation", &[1.0, 2.0]),
        ] {
            let refused = fly(&other, &path, 2).0.unwrap_err();
            assert!(matches!(refused, JournalError::Foreign { .. }), "{refused}");
        }
        fly(&campaign("grid", &[1.0, 2.0]), &path, 2).0.unwrap();
    }
}
