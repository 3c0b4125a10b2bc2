//! `gerono check`: the resolved schedule and wiring of a scenario.

use comfy_table::{Table, presets};
use report::info::replacement;
use scenario::Scenario;
use scenario_file::gain_rules::{self, digits};
use shared_types::service::seconds;
use shared_types::{Schedule, ServiceId, Topic};

use super::{Failure, load, print, refused, schedule_of};
use crate::cli::Check;

/// `gerono check`.
///
/// # Errors
/// [`Failure`] if the scenario cannot be flown.
pub fn check(arguments: &Check) -> Result<(), Failure> {
    let scenario = load(&arguments.scenario)?;
    let schedule = schedule_of(&scenario)?;
    registry::build_all(&scenario).map_err(Failure::bad_input)?;
    // What measures a real vehicle requires real time.
    if let Some(problem) = scenario
        .unattended_arming()
        .filter(|_| scenario.measures_a_vehicle())
    {
        return Err(refused(&arguments.scenario, &problem));
    }
    if arguments.mermaid {
        print(crate::manual::wiring::mermaid());
    } else {
        print(describe(&scenario, &schedule));
        let warnings = warnings(&scenario).into_iter();
        print(
            warnings
                .map(|warning| format!("warning: {warning}\n"))
                .collect::<String>(),
        );
    }
    Ok(())
}

/// Returns the schedule and wiring of a scenario as text.
#[must_use]
pub fn describe(scenario: &Scenario, schedule: &Schedule) -> String {
    let order: Vec<_> = schedule
        .order()
        .iter()
        .map(|&service| scenario.process_name(service))
        .collect();
    format!(
        "{}\nbase tick {} s, {} ticks, {} s{}\n{}order within a tick: {}\n{}\n{}\n\n{}\n\n{}\n{}",
        if scenario.description.is_empty() {
            "the scenario can be flown"
        } else {
            &scenario.description
        },
        seconds(schedule.tick_ns()),
        schedule.last_tick() + 1,
        seconds(schedule.time_ns(schedule.last_tick())),
        scenario.theorem_bound().map_or_else(String::new, |bound| format!(
            "; the theorem bounds the distance from the path by {bound:.4} m"
        )),
        gains(scenario),
        order.join(" → "),
        programs(scenario),
        services(scenario, schedule),
        topics(schedule),
        edges(schedule),
        unread(schedule),
    )
}

fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header(header);
    table
}

/// Returns optional gains with their origin, and the rules between gains and vehicle.
fn gains(scenario: &Scenario) -> String {
    let findings = gain_rules::findings(scenario);
    if findings.is_empty() {
        return String::new();
    }
    let origin = |stated: Option<f64>| if stated.is_some() { "stated" } else { "follows" };
    let controller = &scenario.controller;
    let mut table = table(&["gains and vehicle (docs/tuning.md)", "is", "limit"]);
    for finding in &findings {
        let sign = if finding.rule.is_upper_limit() {
            "≤"
        } else {
            "≥"
        };
        table.add_row([
            quantity(scenario, finding),
            digits(finding.value),
            format!("{sign} {}{}", digits(finding.limit), finding.rule.unit()),
        ]);
    }
    format!(
        "β = {:?} ({}), Λw = {:?} ({})
{table}
",
        scenario.beta(),
        origin(controller.beta),
        scenario.lambda_inertia(),
        origin(controller.lambda_inertia),
    )
}

/// Returns the name of a rule's quantity, with the time from which it has the value if it changes in flight.
fn quantity(scenario: &Scenario, finding: &gain_rules::Finding) -> String {
    let name = finding.rule.quantity();
    let segments: Vec<_> = finding.key.segments().iter().map(String::as_str).collect();
    let changes = &scenario.vehicle.change;
    match segments[..] {
        ["vehicle", "change", index, ..] => {
            let change = index.parse().ok().and_then(|index: usize| changes.get(index));
            change.map_or_else(
                || name.to_owned(),
                |change| format!("{name}, from {:?} s", change.at),
            )
        }
        ["rc_output", ..] => format!("{name}, of the radio link"),
        _ => name.to_owned(),
    }
}

/// Returns warnings about a scenario that can be flown.
pub(super) fn warnings(scenario: &Scenario) -> Vec<String> {
    let warnings = scenario_file::warnings::all(scenario, &view::path::points(scenario));
    let untested = decisions::arming::without_hand_test(scenario);
    let untested = untested.map(|reason| format!("`gerono arm` will be refused: {reason}"));
    warnings.iter().map(ToString::to_string).chain(untested).collect()
}

/// Lists the programs and plug-ins that replace services, a line each.
fn programs(scenario: &Scenario) -> String {
    let line = |service| {
        Some(format!(
            "in place of {service}: {}\n",
            replacement(scenario, service)?
        ))
    };
    ServiceId::ALL.into_iter().filter_map(line).collect()
}

fn services(scenario: &Scenario, schedule: &Schedule) -> Table {
    let mut table = table(&["service", "period, s", "first step, s"]);
    for service in ServiceId::ALL {
        let rate = schedule.service_rate(service);
        let time = |ticks| seconds(schedule.time_ns(ticks)).to_string();
        table.add_row([
            scenario.process_name(service).to_owned(),
            time(rate.period),
            time(rate.phase),
        ]);
    }
    table
}

fn topics(schedule: &Schedule) -> Table {
    let mut table = table(&["topic", "publisher", "period, s", "samples", "bytes each"]);
    for topic in Topic::ALL.into_iter().filter(|&topic| schedule.has_topic(topic)) {
        let publisher = topic
            .publisher()
            .map_or("orchestrator", ServiceId::name)
            .to_owned();
        let (period, samples) = match topic.publisher() {
            Some(_) => (
                seconds(schedule.time_ns(schedule.topic_rate(topic).period)).to_string(),
                schedule.sample_count(topic).to_string(),
            ),
            None => ("as scheduled".to_owned(), "as scheduled".to_owned()),
        };
        table.add_row([
            topic.to_string(),
            publisher,
            period,
            samples,
            topic.kind().size.to_string(),
        ]);
    }
    table
}

fn edges(schedule: &Schedule) -> Table {
    let mut table = table(&["edge", "latency, s", "buffer, samples"]);
    for topic in Topic::ALL {
        for (service, input) in schedule.readers(topic) {
            table.add_row([
                format!("{topic} -> {service}"),
                seconds(schedule.time_ns(schedule.acts_after(service, input))).to_string(),
                schedule.buffer_size(topic).to_string(),
            ]);
        }
    }
    table
}

/// Lists the edges of the wiring table that are not connected because no step reads them.
fn unread(schedule: &Schedule) -> String {
    let edges = Topic::ALL.into_iter().flat_map(|topic| {
        let unread = topic
            .consumers()
            .filter(move |&(service, input)| schedule.has_topic(topic) && !schedule.reads(service, input));
        unread.map(move |(service, _)| format!("{topic} -> {service}"))
    });
    let edges: Vec<_> = edges.collect();
    if edges.is_empty() {
        String::new()
    } else {
        format!(
            "not connected in this flight, which does not use them: {}\n",
            edges.join(", ")
        )
    }
}
