//! Flights of a campaign: a scenario with changed settings, a laboratory and a seed.

use std::collections::BTreeMap;
use std::path::Path;

use scenario::Scenario;

use super::column::Column;
use super::measure::{Measured, Meter};
use flight::campaign::Campaign;
use flight::failure::FlightFailure;
use flight::interrupt::Interrupt;
use flight::journal::JournalError;
use flight::{Outcome, in_process};
use metrics::loss::Loss;
use scenario_file::ScenarioError;

/// File of the results in the folder of a campaign.
pub const FLIGHTS: &str = "flights.rows";

/// Minimum advance of γ in the judged part of a flight, as a share of vd times its duration: a path that waits would make every
/// error small.
pub const MIN_PROGRESS: f64 = 0.95;

/// A committed scenario, embedded in the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ScenarioSource {
    /// File name without the extension.
    pub name: &'static str,
    text: &'static str,
}

macro_rules! sources {
    ($($constant:ident = $name:literal),+ $(,)?) => {
        impl ScenarioSource {
            $(
                #[doc = concat!("`scenarios/", $name, ".toml`.")]
                pub const $constant: Self = Self {
                    name: $name,
                    text: include_str!(concat!("../../../scenarios/", $name, ".toml")),
                };
            )+
        }
    };
}

sources! {
    FIG1 = "fig1",
    FIG2_NEAR = "fig2_near",
    FIG2_MIDDLE = "fig2_middle",
    FIG2_FAR = "fig2_far",
    FIG3_6 = "fig3_6",
    FIG7 = "fig7",
    FIG8 = "fig8",
    FIG9 = "fig9",
    FIG10 = "fig10",
    FIG11 = "fig11",
    TRAJECTORY_TRACKING = "trajectory_tracking",
}

impl ScenarioSource {
    /// Loads the scenario with these settings and this seed.
    ///
    /// # Errors
    /// [`ScenarioError`] if a setting does not fit.
    pub fn load(&self, settings: &[String], seed: u64) -> Result<Scenario, ScenarioError> {
        let path = Path::new("scenarios").join(self.name).with_extension("toml");
        scenario_file::load_text(&path, self.text, settings, Some(seed))
    }
}

/// A flight without its laboratory and seed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlightSpecification {
    /// Name of the flight; equal names are equal flights.
    pub name: String,
    /// The scenario.
    pub source: ScenarioSource,
    /// Settings that change the scenario.
    pub settings: Vec<String>,
}

impl FlightSpecification {
    /// Specifies an unchanged scenario.
    #[must_use]
    pub fn plain(source: ScenarioSource) -> Self {
        Self::changed(source.name, source, &[])
    }

    /// Specifies a scenario with changed settings, under another name.
    #[must_use]
    pub fn changed(name: impl Into<String>, source: ScenarioSource, settings: &[&str]) -> Self {
        Self {
            name: name.into(),
            source,
            settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
        }
    }

    /// Loads the scenario of this flight in a laboratory.
    ///
    /// # Errors
    /// [`ScenarioError`] if a setting does not fit.
    pub fn load(&self, column: Column, seed: u64) -> Result<Scenario, ScenarioError> {
        let stated = self.source.load(&self.settings, seed)?;
        let mut settings = self.settings.clone();
        settings.extend(column.settings(&stated));
        self.source.load(&settings, seed)
    }
}

/// A flight of a campaign.
#[derive(Clone, Debug)]
pub struct Job {
    /// Name, unique for a laboratory and seed.
    pub name: String,
    /// The laboratory.
    pub column: Column,
    /// The scenario to fly, with its seed.
    pub scenario: Scenario,
}

/// Results of all flights, or the reason why a flight has none.
#[derive(Debug, Default)]
pub struct FlightResults(BTreeMap<(Column, u64, String), Result<Measured, String>>);

/// Reason why a campaign ends without results.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// The folder holds the results of other flights, or results cannot be stored.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// A flight could not begin.
    #[error(transparent)]
    Flight(#[from] FlightFailure),
}

/// Reason why a flight has no measured values.
#[derive(Debug, thiserror::Error)]
pub enum NotMeasured {
    /// The flight failed.
    #[error(transparent)]
    Failed(FlightFailure),
    /// The vehicle was lost.
    #[error("the vehicle was lost at {time} s: {0}", time = .0.time)]
    Lost(Loss),
    /// The path waited for the vehicle: the path variable advanced only by this share of the nominal distance, in per cent.
    #[error("the path variable advanced only {0:.0} % of its nominal distance")]
    Waited(f64),
}

impl FlightResults {
    /// Flies all jobs on `threads` threads. Returns `None` if the campaign was interrupted. Results are stored in `folder`, from
    /// which an interrupted campaign resumes. Calls `flown` with the number of results, first and after each flight.
    ///
    /// Every flight is a function of its scenario alone, independent of the number of threads and the order.
    ///
    /// # Errors
    /// [`CampaignError`].
    pub fn fly(
        jobs: &[Job],
        threads: usize,
        folder: &Path,
        interrupt: &Interrupt,
        flown: impl FnMut(usize),
    ) -> Result<Option<Self>, CampaignError> {
        let scenarios = jobs.iter().map(|job| &job.scenario);
        let campaign = Campaign::new("reproduce", scenarios)?;
        let fly = |index: usize| {
            let measured = measure(&jobs[index].scenario, interrupt)?;
            let result = measured.map(|result| result.map_err(|reason| reason.to_string()));
            Some(result.map_err(CampaignError::from))
        };
        let results = campaign.fly(&folder.join(FLIGHTS), threads, fly, flown)?;
        let is_whole = results.len() == jobs.len();
        let entries = jobs
            .iter()
            .zip(results)
            .map(|(job, result)| ((job.column, job.scenario.seed, job.name.clone()), result));
        Ok(is_whole.then(|| Self(entries.collect())))
    }

    /// Returns the results of a laboratory and a seed.
    #[must_use]
    pub fn flown(&self, column: Column, seed: u64) -> SeedResults<'_> {
        SeedResults {
            results: self,
            column,
            seed,
        }
    }
}

/// Results of one laboratory and one seed.
#[derive(Clone, Copy, Debug)]
pub struct SeedResults<'a> {
    results: &'a FlightResults,
    column: Column,
    seed: u64,
}

impl SeedResults<'_> {
    /// Returns the result of a flight by its name.
    ///
    /// # Errors
    /// The reason why the flight has no result, as a note for the table.
    pub fn result(&self, name: &str) -> Result<&Measured, String> {
        let key = (self.column, self.seed, name.to_owned());
        match self.results.0.get(&key) {
            Some(Ok(measured)) => Ok(measured),
            Some(Err(reason)) => Err(format!("seed {}, {name}: {reason}", self.seed)),
            None => Err(format!("seed {}, {name}: not flown", self.seed)),
        }
    }
}

/// Flies and measures a scenario. Returns `None` if the flight was interrupted.
///
/// # Errors
/// The failure of a flight that did not begin: it says nothing about a control law, so it is no result of a campaign.
pub fn measure(
    scenario: &Scenario,
    interrupt: &Interrupt,
) -> Option<Result<Result<Measured, NotMeasured>, FlightFailure>> {
    let schedule = match flight::schedule_of(scenario) {
        Ok(schedule) => schedule,
        Err(unflyable) => return Some(Err(unflyable.into())),
    };
    let mut meter = Meter::new(scenario, &schedule);
    let ending = in_process::fly(scenario, &mut meter, interrupt);
    match ending.map_or_else(Outcome::Failed, |ending| ending.outcome) {
        Outcome::Completed => Some(Ok(judged(meter))),
        Outcome::Interrupted { .. } => None,
        Outcome::Failed(failure) if failure.is_of_setup() => Some(Err(failure)),
        Outcome::Failed(failure) => Some(Ok(Err(NotMeasured::Failed(failure)))),
    }
}

fn judged(meter: Meter) -> Result<Measured, NotMeasured> {
    let measured = meter.finish().map_err(NotMeasured::Lost)?;
    if measured.progress >= MIN_PROGRESS {
        Ok(measured)
    } else {
        Err(NotMeasured::Waited(100.0 * measured.progress))
    }
}

#[cfg(test)]
mod tests {
    use scenario::Plugins;

    use super::*;

    fn jobs() -> Vec<Job> {
        let short = ["duration=3.0", "vehicle.change=[]", "path.initial_gamma_dot=1.0"];
        let specification = FlightSpecification::changed("short", ScenarioSource::FIG3_6, &short);
        [1, 2, 3]
            .map(|seed| Job {
                name: specification.name.clone(),
                column: Column::Baseline,
                scenario: specification.load(Column::Baseline, seed).unwrap(),
            })
            .into()
    }

    #[test]
    fn what_flights_come_to_does_not_depend_on_the_number_of_threads() {
        let jobs = jobs();
        let [one, three] = [1, 3].map(|threads| {
            let folder = tempfile::tempdir().unwrap();
            let results = FlightResults::fly(&jobs, threads, folder.path(), &Interrupt::never(), |_| ());
            results.unwrap().unwrap()
        });
        for job in &jobs {
            let of = |results: &FlightResults| {
                results
                    .flown(job.column, job.scenario.seed)
                    .result("short")
                    .cloned()
            };
            assert!(of(&one).is_ok());
            assert_eq!(of(&one), of(&three));
        }
    }

    #[test]
    fn a_flight_that_cannot_begin_is_no_result_and_is_tried_again_when_the_campaign_resumes() {
        let folder = tempfile::tempdir().unwrap();
        let mut jobs = jobs();
        jobs[1].scenario.plugins = Some(Plugins {
            controller: Some("nothere.so".into()),
            ..Plugins::default()
        });
        for _ in 0..2 {
            let failed = FlightResults::fly(&jobs, 1, folder.path(), &Interrupt::never(), |_| ());
            assert!(matches!(failed, Err(CampaignError::Flight(_))), "{failed:?}");
            let kept = std::fs::read_to_string(folder.path().join("flights.rows.partial")).unwrap();
            assert_eq!(kept.lines().count(), 2, "a header and the flight before: {kept}");
        }
    }

    #[test]
    fn a_flight_that_was_not_flown_says_so() {
        let results = FlightResults::default();
        let reason = results.flown(Column::Baseline, 7).result("fig9").unwrap_err();
        assert_eq!(reason, "seed 7, fig9: not flown");
    }

    #[test]
    fn a_path_that_waits_is_not_a_good_flight() {
        // The vehicle is 50 m away at first and needs most of the flight to come near.
        let specification = FlightSpecification::changed(
            "far",
            ScenarioSource::FIG2_FAR,
            &["duration=21.0", "vehicle.change=[]"],
        );
        let scenario = specification.load(Column::Baseline, 1).unwrap();
        let flown = measure(&scenario, &Interrupt::never()).unwrap().unwrap();
        let reason = flown.unwrap_err().to_string();
        assert!(reason.contains("% of its nominal distance"), "{reason}");
    }
}
