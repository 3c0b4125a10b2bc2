//! `gerono-bench deaths`: effect of crashing services on a flight in real time and on the other services.

use std::path::Path;

use comfy_table::{Table, presets};
use hdrhistogram::Histogram;
use scenario::Scenario;
use serde::Serialize;
use serde_json::Value;
use shared_types::ServiceId;

use super::measure::{FlightCommand, Result, Scratch, fly_by_command};
use crate::arguments::BenchDeaths;
use command_line::failure::Failure;
use command_line::output::{print, write_json};
use command_line::progress;
use flight::schedule_of;
use metrics::summary::timing::{Quantiles, histogram};
use metrics::tracker::Tracker;
use run_log::{HostReader, LogReader, ServiceStep};
use supervisor::RunFailure;

/// The paper's laboratory in hover: without commands its vehicle holds its body rates.
const SCENARIO: &str = include_str!("../../../scenarios/fig7.toml");

/// Hover position of the scenario, m.
const HOVER: [f64; 3] = [0.0, 0.0, -1.2];

/// Time from the start to the first crash, s: the mass estimate has converged by then.
const SETTLING: f64 = 4.0;

/// Time between two crashes, s.
const APART: f64 = 0.3;

/// Time after a crash for which the other services are observed, ns: two restarts.
const NEAR_NS: u64 = 100_000_000;

/// Results of the measurement.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    deaths: usize,
    /// Restarted services.
    restarts: usize,
    /// Time from the detection of a crash to the first step of the new process, s.
    back_after: Option<Quantiles>,
    services: Vec<OthersPeriods>,
    /// Largest distance from the path from the first crash on, m, and over the same time of the undisturbed flight.
    largest_distance: f64,
    largest_distance_undisturbed: f64,
}

/// Periods between the starts of consecutive steps, s.
#[derive(Clone, Debug, Serialize)]
struct OthersPeriods {
    service: &'static str,
    /// Within 0.1 s after the crash of another service.
    near: Option<Quantiles>,
    /// At all other times.
    elsewhere: Option<Quantiles>,
    /// Ratio of the 99th percentiles.
    ratio_p99: Option<f64>,
}

/// `gerono-bench deaths`.
///
/// # Errors
/// [`Failure`].
pub(super) fn deaths(arguments: &BenchDeaths) -> std::result::Result<(), Failure> {
    let measured = measure(arguments).map_err(Failure::trouble)?;
    print(format!("{}\n", table(&measured.services)));
    let back = measured.back_after.map_or_else(String::new, |back| {
        format!(
            " (median {:.1} ms, maximum {:.1} ms after detection)",
            1e3 * back.p50,
            1e3 * back.max
        )
    });
    print(format!(
        "{} processes killed themselves (SIGKILL), each service in turn; {} were restarted{back}.\n\
         Largest distance from the path meanwhile {:.1} cm, in the undisturbed flight {:.1} cm.\n",
        measured.deaths,
        measured.restarts,
        100.0 * measured.largest_distance,
        100.0 * measured.largest_distance_undisturbed,
    ));
    match &arguments.json {
        Some(path) => write_json(path, &measured),
        None => Ok(()),
    }
}

fn measure(arguments: &BenchDeaths) -> Result<Measured> {
    let count = arguments.deaths;
    let mut flight: Scenario = toml::from_str(SCENARIO).map_err(RunFailure::setup)?;
    flight.vehicle.fan = None;
    flight.vehicle.initial.position = HOVER;
    flight.duration = SETTLING + APART * f64::from(count + 1);
    let folder = Scratch::create()?;
    let command = FlightCommand::write(&folder, &flight)?;
    let spinner = progress::waiting("two flights in real time");
    let fifo = arguments.fifo.then_some("--fifo");
    let undisturbed = fly(&command, fifo.into_iter())?;
    let turns = ServiceId::ALL.iter().cycle().zip(0..count);
    let crashes: Vec<_> = turns
        .flat_map(|(service, turn)| {
            let tick = flight.tick_of(SETTLING + APART * f64::from(turn));
            ["--crash".to_owned(), format!("{service}@{tick}:after-step")]
        })
        .collect();
    let disturbed = fly(&command, crashes.iter().map(String::as_str).chain(fifo))?;
    spinner.finish_and_clear();
    let restarts = disturbed.restarts(flight.schedule.tick)?;
    Ok(Measured {
        deaths: count as usize,
        restarts: restarts.len(),
        back_after: Quantiles::of(&restarts.iter().fold(histogram(), |mut all, restart| {
            all.saturating_record(restart.lost_ns);
            all
        })),
        services: others_periods(&disturbed.steps, &restarts),
        largest_distance: disturbed.largest_distance,
        largest_distance_undisturbed: undisturbed.largest_distance,
    })
}

/// A measured flight.
struct TimedFlight {
    summary: Value,
    steps: Vec<(ServiceId, ServiceStep)>,
    largest_distance: f64,
}

/// A crash that was followed by a restart.
struct Restart {
    service: ServiceId,
    died_ns: u64,
    lost_ns: u64,
}

fn fly<'a>(command: &FlightCommand, options: impl Iterator<Item = &'a str>) -> Result<TimedFlight> {
    let options: Vec<_> = ["--host", "realtime"].into_iter().chain(options).collect();
    let mut steps = Vec::new();
    let mut largest_distance = 0.0;
    let (_, summary) = fly_by_command(command, &options, |results| {
        let recorded = HostReader::open(&results.join("host.mcap")).map_err(RunFailure::setup)?;
        steps = recorded
            .steps()
            .collect::<std::result::Result<_, _>>()
            .map_err(RunFailure::setup)?;
        largest_distance = largest_distance_of(&results.join("run.mcap"))?;
        Ok(())
    })?;
    Ok(TimedFlight {
        summary,
        steps,
        largest_distance,
    })
}

/// Returns the largest distance from the path from the first crash on, m.
fn largest_distance_of(log: &Path) -> Result<f64> {
    let mut reader = LogReader::open(log).map_err(RunFailure::setup)?;
    let scenario = &reader.manifest().scenario;
    let mut tracker = Tracker::new(&schedule_of(scenario)?, scenario.flight.is_some());
    let mut largest: f64 = 0.0;
    let followed = tracker.follow(&mut reader, |moment| {
        let has_settled = moment.vehicle.time_ns >= nanoseconds(SETTLING);
        largest = largest.max(moment.distance.filter(|_| has_settled).unwrap_or(0.0));
    });
    followed.map_err(RunFailure::setup)?;
    Ok(largest)
}

impl TimedFlight {
    /// Returns the restarts; `tick` in s.
    fn restarts(&self, tick: f64) -> Result<Vec<Restart>> {
        let stated = self.summary["restarts"].as_array();
        let stated = stated.ok_or_else(|| RunFailure::setup("the flight's summary has no restarts"))?;
        let restart = |stated: &Value| {
            Some(Restart {
                service: ServiceId::from_name(stated["service"].as_str()?)?,
                died_ns: nanoseconds(stated["tick"].as_f64()? * tick),
                lost_ns: nanoseconds(stated["lost_seconds"].as_f64()?),
            })
        };
        Ok(stated.iter().filter_map(restart).collect())
    }
}

fn nanoseconds(time: f64) -> u64 {
    shared_types::service::nanoseconds(time)
}

/// Returns for each service the periods near the crashes of others, and all others. Periods near its own crashes do not count.
fn others_periods(steps: &[(ServiceId, ServiceStep)], restarts: &[Restart]) -> Vec<OthersPeriods> {
    let periods_of = |service: ServiceId| {
        let [mut near, mut elsewhere] = [histogram(), histogram()];
        let own = steps.iter().filter(|(id, _)| *id == service);
        let begins: Vec<_> = own.map(|(_, step)| step.began_ns).collect();
        for pair in begins.windows(2) {
            // A crash within the period, or shortly enough before to affect it.
            let is_near =
                |restart: &&Restart| (pair[0].saturating_sub(NEAR_NS)..pair[1]).contains(&restart.died_ns);
            let mut deaths = restarts.iter().filter(is_near).peekable();
            let counts_as: Option<&mut Histogram<u64>> = match deaths.peek() {
                None => Some(&mut elsewhere),
                Some(_) => deaths.all(|death| death.service != service).then_some(&mut near),
            };
            if let Some(periods) = counts_as {
                periods.saturating_record(pair[1].saturating_sub(pair[0]));
            }
        }
        let [near, elsewhere] = [Quantiles::of(&near), Quantiles::of(&elsewhere)];
        OthersPeriods {
            service: service.name(),
            ratio_p99: near
                .zip(elsewhere)
                .map(|(near, elsewhere)| near.p99 / elsewhere.p99),
            near,
            elsewhere,
        }
    };
    ServiceId::ALL.into_iter().map(periods_of).collect()
}

fn table(services: &[OthersPeriods]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
        "period between steps",
        "within 0.1 s of another's crash, ms\np50 / p99 / max",
        "otherwise, ms\np50 / p99 / max",
        "ratio\np99",
    ]);
    for periods in services {
        table.add_row([
            periods.service.to_owned(),
            milliseconds(periods.near.as_ref()),
            milliseconds(periods.elsewhere.as_ref()),
            periods
                .ratio_p99
                .map_or_else(String::new, |ratio| format!("{ratio:.3}")),
        ]);
    }
    table
}

fn milliseconds(quantiles: Option<&Quantiles>) -> String {
    let shown = |quantiles: &Quantiles| {
        let times = [quantiles.p50, quantiles.p99, quantiles.max];
        times.map(|time| format!("{:.3}", 1e3 * time)).join(" / ")
    };
    quantiles.map_or_else(String::new, shown)
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    fn steps(service: ServiceId, begins_ms: &[u64]) -> Vec<(ServiceId, ServiceStep)> {
        let step = |&begin_ms: &u64| ServiceStep {
            began_ns: begin_ms * 1_000_000,
            ..ServiceStep::new_zeroed()
        };
        begins_ms.iter().map(|begin| (service, step(begin))).collect()
    }

    fn death(service: ServiceId, at_ms: u64) -> Restart {
        Restart {
            service,
            died_ns: at_ms * 1_000_000,
            lost_ns: 0,
        }
    }

    #[test]
    fn a_period_is_near_a_death_of_another_and_one_s_own_deaths_count_nowhere() {
        let steps = steps(ServiceId::Plant, &[0, 10, 30, 500, 510, 1000, 1010]);
        let deaths = [death(ServiceId::Controller, 20), death(ServiceId::Plant, 505)];
        let periods = others_periods(&steps, &deaths);
        let plant = periods.iter().find(|periods| periods.service == "plant").unwrap();
        // 10 → 30 and 30 → 500 follow the controller's death; 500 → 510 and 510 → 1000 the plant's own.
        assert_eq!(plant.near.unwrap().count, 2);
        assert_eq!(plant.elsewhere.unwrap().count, 2);
        assert!((plant.elsewhere.unwrap().max - 0.01).abs() < 2e-4);
        assert!(
            periods
                .iter()
                .all(|periods| periods.service == "plant" || periods.near.is_none())
        );
    }
}
