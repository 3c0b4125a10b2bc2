//! The flights of a grid, and the results of a law in a condition.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use flight::campaign::Campaign;
use flight::in_process;
use flight::interrupt::Interrupt;
use flight::many;
use reproduce::flight::{FLIGHTS, NotMeasured, ScenarioSource, measure};
use reproduce::measure::Measured;
use scenario::Scenario;
use scenario_file::{ReadFile, ScenarioError, files_of};
use serde::{Deserialize, Serialize};
use statistics::quantile::median_of as median;

use crate::conditions::Condition;
use crate::error::GridError;
use crate::laws::ControlLaw;

/// Scenario that laws and conditions change. Its text is read once, so that all flights belong to one experiment.
#[derive(Debug)]
pub struct Base {
    /// File and text of the scenario; `None` for the shipped one.
    file: Option<(PathBuf, String)>,
    stated: Box<Scenario>,
    /// SHA-256 of the files that flights read, at first use.
    files: Mutex<BTreeMap<PathBuf, String>>,
}

/// Duration of a flight of the default scenario, s. Its steady state is the last 20 s, from 10 s after the coins on.
const DURATION: &str = "duration=60.0";

impl Base {
    /// Loads a scenario file, by default `scenarios/fig3_6.toml`.
    ///
    /// # Errors
    /// [`GridError`] if the scenario cannot be flown.
    pub fn load(path: Option<&Path>) -> Result<Self, GridError> {
        let file = match path {
            None => None,
            Some(path) => {
                // Reports an unreadable file better than the read below.
                scenario_file::load(path, &[], Some(1))?;
                let text = std::fs::read_to_string(path).map_err(GridError::Unreadable)?;
                Some((path.to_owned(), text))
            }
        };
        Ok(Self {
            stated: Box::new(scenario(file.as_ref(), &[], 1)?),
            file,
            files: Mutex::default(),
        })
    }

    /// Returns the unchanged scenario.
    #[must_use]
    pub fn stated(&self) -> &Scenario {
        &self.stated
    }

    /// Returns the name of the scenario.
    #[must_use]
    pub fn name(&self) -> String {
        self.file.as_ref().map_or_else(
            || format!("scenarios/{}.toml, {DURATION}", ScenarioSource::FIG3_6.name),
            |(path, _)| path.display().to_string(),
        )
    }

    /// Returns the scenario with settings and a seed.
    ///
    /// # Errors
    /// [`GridError`] if a setting does not fit, or a file that the scenario names has changed since it was first read.
    pub fn scenario(&self, settings: &[String], seed: u64) -> Result<Scenario, GridError> {
        let scenario = scenario(self.file.as_ref(), settings, seed)?;
        let mut known = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        for ReadFile { path, sha256, .. } in files_of(&scenario) {
            let name = path.display().to_string();
            if known.entry(path).or_insert_with(|| sha256.clone()) != sha256 {
                return Err(GridError::BadInput(format!(
                    "{name} has changed since the grid began, which would compare flights of two files: fly the grid again"
                )));
            }
        }
        Ok(scenario)
    }
}

fn scenario(
    file: Option<&(PathBuf, String)>,
    settings: &[String],
    seed: u64,
) -> Result<Scenario, ScenarioError> {
    if let Some((path, text)) = file {
        return scenario_file::load_from(path, text, settings, Some(seed));
    }
    let duration = std::iter::once(DURATION.to_owned());
    let settings: Vec<_> = duration.chain(settings.iter().cloned()).collect();
    let mut scenario = ScenarioSource::FIG3_6.load(&settings, seed)?;
    plugin::library_file::pin(&mut scenario)?;
    Ok(scenario)
}

/// Returns the flights of all laws in all conditions with all seeds: laws first, seeds last.
///
/// # Errors
/// [`GridError`] if a setting does not fit the base.
pub fn jobs(
    base: &Base,
    laws: &[ControlLaw],
    conditions: &[Condition],
    seeds: &[u64],
) -> Result<Vec<Scenario>, GridError> {
    let mut jobs = Vec::new();
    for law in laws {
        for condition in conditions {
            let settings = [condition.settings.as_slice(), law.settings.as_slice()].concat();
            for &seed in seeds {
                let scenario = base
                    .scenario(&settings, seed)
                    .map_err(|source| GridError::Condition {
                        law: law.name.clone(),
                        condition: condition.name,
                        source: Box::new(source),
                    });
                jobs.push(scenario?);
            }
        }
    }
    Ok(jobs)
}

/// Results of a law in a condition over the seeds, in SI units.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Cell {
    /// Name of the law.
    pub law: String,
    /// Name of the condition.
    pub condition: String,
    /// RMS distance from the path in steady state, as in summaries, m: median over the seeds.
    pub rms: Option<f64>,
    /// RMS distance of the worst seed, m.
    pub worst_rms: Option<f64>,
    /// Largest distance in the transient of the last phase, m: median.
    pub peak: Option<f64>,
    /// RMS body rate in steady state, rad/s: median.
    pub body_rate: Option<f64>,
    /// RMS distance of each seed, m; `None` for a lost flight.
    pub by_seed: Vec<Option<f64>>,
    /// Lost flights with their reasons.
    pub lost: Vec<LostFlight>,
}

/// A lost flight; the same command repeats it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LostFlight {
    pub seed: u64,
    /// Reason of the loss.
    pub reason: String,
}

/// Result of a flight, in SI units.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct FlightResult {
    seed: u64,
    /// RMS distance from the path in steady state.
    rms: Option<f64>,
    /// Largest distance in the transient before the steady state.
    peak: Option<f64>,
    /// RMS body rate in steady state.
    body_rate: Option<f64>,
    /// Reason why the vehicle was lost.
    lost: Option<String>,
}

/// Flies all [`jobs`] on all cores. Returns the cells, laws first; `None` if the grid was interrupted. Results are stored in
/// `folder`, from which an interrupted grid resumes. Calls `flown` with the number of results, first and after each flight.
///
/// # Errors
/// [`GridError`] if a flight cannot begin, for example for an unreadable plug-in. This does not count as a lost flight.
pub fn fly(
    jobs: &[Scenario],
    laws: &[ControlLaw],
    conditions: &[Condition],
    folder: &Path,
    interrupt: &Interrupt,
    flown: impl FnMut(usize),
) -> Result<Option<Vec<Cell>>, GridError> {
    // Prepares one flight of each law and condition before the first flight, so that errors of setup come early.
    let seeds = jobs.len() / (laws.len() * conditions.len());
    for job in jobs.iter().step_by(seeds) {
        in_process::host(job)?;
    }
    let campaign = Campaign::new("grid", jobs)?;
    let fly = |index: usize| FlightResult::fly(&jobs[index], interrupt);
    let results = campaign.fly(&folder.join(FLIGHTS), many::cores(), fly, flown)?;
    let pairs = laws
        .iter()
        .flat_map(|law| conditions.iter().map(move |condition| (law, condition)));
    let cells = pairs.zip(results.chunks(seeds));
    let is_whole = results.len() == jobs.len();
    Ok(is_whole.then(|| {
        cells
            .map(|((law, condition), results)| Cell::new(law, condition, results))
            .collect()
    }))
}

impl FlightResult {
    /// Returns the result of a flight; `None` if it was interrupted.
    fn fly(scenario: &Scenario, interrupt: &Interrupt) -> Option<Result<Self, GridError>> {
        let seed = scenario.seed;
        let result = |flown| match flown {
            Ok(Measured {
                steady, transient, ..
            }) => Self {
                seed,
                rms: steady.map(|steady| steady.rmse),
                peak: transient.map(|transient| transient.max),
                body_rate: steady.map(|steady| steady.body_rate_rms),
                lost: None,
            },
            Err(reason) => Self {
                seed,
                rms: None,
                peak: None,
                body_rate: None,
                lost: Some(NotMeasured::to_string(&reason)),
            },
        };
        let flown = measure(scenario, interrupt)?;
        Some(flown.map(result).map_err(GridError::from))
    }
}

impl Cell {
    fn new(law: &ControlLaw, condition: &Condition, results: &[FlightResult]) -> Self {
        let all = |value: fn(&FlightResult) -> Option<f64>| results.iter().filter_map(value);
        let errors = all(|result| result.rms);
        let lost = |result: &FlightResult| {
            let reason = result.lost.clone()?;
            Some(LostFlight {
                seed: result.seed,
                reason,
            })
        };
        Self {
            law: law.name.clone(),
            condition: condition.name.to_owned(),
            rms: median(errors.clone()),
            worst_rms: errors.reduce(f64::max),
            peak: median(all(|result| result.peak)),
            body_rate: median(all(|result| result.body_rate)),
            by_seed: results.iter().map(|result| result.rms).collect(),
            lost: results.iter().filter_map(lost).collect(),
        }
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;
    use crate::conditions::CONDITIONS;

    #[test]
    fn every_law_flies_in_every_condition_and_a_lost_flight_is_a_result() {
        let base = Base::load(None).unwrap();
        let laws = ControlLaw::all();
        let conditions = CONDITIONS.map(|condition| condition.for_scenario(base.stated()).unwrap());
        let jobs = jobs(&base, &laws, &conditions, &[1]).unwrap();
        assert_eq!(jobs.len(), laws.len() * CONDITIONS.len());
        let lost = ControlLaw {
            name: "lost".to_owned(),
            settings: vec![r#"schedule.latency."rc/frame -> plant"=0.2"#.to_owned()],
        };
        let calm = &conditions[..1];
        let jobs = super::jobs(&base, std::slice::from_ref(&lost), calm, &[1]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let cells = fly(&jobs, &[lost], calm, folder.path(), &Interrupt::never(), |_| ()).unwrap();
        let cells = cells.unwrap();
        let [cell] = &cells[..] else { panic!("{cells:?}") };
        assert_eq!((cell.rms, cell.lost.len()), (None, 1));

        let missing: ControlLaw = "mine:plugins.controller=nothere.so".parse().unwrap();
        let refused = super::jobs(&base, &[missing], calm, &[1]).unwrap_err();
        let refused = format!("{refused:?}");
        assert!(refused.contains("nothere.so"), "{refused}");
    }

    #[test]
    fn all_flights_are_of_the_files_as_they_were_first() {
        let folder = tempfile::tempdir().unwrap();
        let [scenario, points] = ["own.toml", "points.csv"].map(|name| folder.path().join(name));
        let shipped = std::fs::read_to_string("../../scenarios/fig3_6.toml").unwrap();
        let curve = "[path.curve.waypoints]\nfile = \"points.csv\"\ninterval = 1.0\nclosed = true";
        let text = shipped.replace("[path.curve.tilted_eight]", curve);
        std::fs::write(&scenario, &text).unwrap();
        std::fs::write(&points, "x,y,z\n0,0,1\n1,0,1\n1,1,1\n0,1,1\n").unwrap();

        let base = Base::load(Some(&scenario)).unwrap();
        let first = base.scenario(&[], 1).unwrap();
        std::fs::write(&scenario, text.replace("mass = 0.19", "mass = 0.25")).unwrap();
        assert_eq!(base.scenario(&[], 1).unwrap(), first);
        std::fs::write(&points, "x,y,z\n0,0,1\n2,0,1\n2,2,1\n0,2,1\n").unwrap();
        let refused = base.scenario(&[], 1).unwrap_err().to_string();
        assert!(refused.contains("points.csv has changed"), "{refused}");

        let library = folder.path().join("libmine.so");
        std::fs::write(&library, "one").unwrap();
        let base = Base::load(None).unwrap();
        let settings = [format!("plugins.controller={}", library.display())];
        base.scenario(&settings, 1).unwrap();
        std::fs::write(&library, "two").unwrap();
        let refused = base.scenario(&settings, 1).unwrap_err().to_string();
        assert!(refused.contains("libmine.so has changed"), "{refused}");
    }
}
