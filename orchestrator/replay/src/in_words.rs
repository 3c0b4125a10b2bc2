//! What a replay and a comparison have found, in words.

use comfy_table::{Table, presets};
use scenario::Key;
use scenario_file::key_of_setting;
use shared_types::ServiceId;

use crate::diff::TopicDiff;
use crate::{CheckpointDifference, Comparison, Difference, Options, Replayed};

/// Returns how two logs differ.
#[must_use]
pub fn differences(topics: &[TopicDiff]) -> String {
    let comparisons: Vec<_> = topics.iter().map(|topic| topic.comparison.clone()).collect();
    let mut text = format!("{}\n", table(&comparisons));
    let firsts = comparisons
        .iter()
        .filter_map(|comparison| comparison.first.as_ref());
    if let Some(first) = firsts.min_by_key(|difference| (difference.tick, difference.topic)) {
        text += &in_words(first, ["first", "second"]);
    }
    for topic in topics {
        for (which, count) in ["first", "second"].into_iter().zip(topic.unmatched) {
            if count > 0 {
                let topic = topic.comparison.topic;
                text += &format!("only the {which} log has {count} samples of `{topic}`\n");
            }
        }
    }
    let compared: u64 = comparisons.iter().map(|comparison| comparison.compared).sum();
    text + &format!("not identical: {compared} samples were compared\n")
}

/// Returns what a replay has found.
#[must_use]
pub fn report(replayed: &Replayed, options: &Options) -> String {
    let mut text = String::new();
    if options.from.is_some() {
        text += &format!("{}\n", starts_in_words(replayed, options));
    }
    if let Some(sentence) = &replayed.log_ends {
        text += &format!("{sentence}\n");
    }
    if replayed.lacks_samples {
        text += "Samples are missing in the recovered log.\n";
    }
    if !replayed.foreign_checkpoints.is_empty() {
        let services = names(&replayed.foreign_checkpoints);
        text +=
            &format!("Another build has written the checkpoints of {services}; they were not compared.\n");
    }
    if let Some(service) = replayed.not_replayable {
        text += &format!(
            "The steps of `{service}` are not repeated: in this flight they received packets of real sensors.\n"
        );
    }
    if !replayed.external_services.is_empty() {
        text += &format!(
            "The steps of {} cannot be computed again: they were made by external services.\n",
            names(&replayed.external_services)
        );
    }
    for (service, topic) in &replayed.without_inputs {
        text += &format!(
            "The steps of {service} cannot be repeated: the log has only a part of its input `{topic}` (`[record]`).\n"
        );
    }
    if replayed
        .comparisons
        .iter()
        .any(|comparison| comparison.different > 0)
    {
        text += &format!("{}\n", table(&replayed.comparisons));
    }
    if let Some(difference) = replayed.first_difference() {
        text += &in_words(difference, ["recorded", "replayed"]);
    }
    if let Some(CheckpointDifference { service, tick, time }) = replayed.first_checkpoint {
        text += &format!(
            "{} of {} checkpoints differ; the first is the state of `{service}` after its step at tick {tick} ({time} s).\n",
            replayed.checkpoints_different, replayed.checkpoints
        );
    }
    if replayed.steps_without_inputs > 0 {
        text += &format!(
            "{} steps could not be repeated: their inputs or the state of the service were not recorded.\n",
            replayed.steps_without_inputs
        );
    }
    if replayed.resumptions > 0 {
        text += &format!(
            "Resumed from a checkpoint {} times: earlier steps were not fully recorded.\n",
            replayed.resumptions
        );
    }
    if replayed.unrecorded() > 0 {
        text += &format!(
            "{} samples were not recorded and could not be compared.\n",
            replayed.unrecorded()
        );
    }
    if replayed.left_out() > 0 {
        text += &format!(
            "{} samples are excluded from the log by `[record]` and were not compared.\n",
            replayed.left_out()
        );
    }
    let (steps, compared, checkpoints) = (replayed.steps, replayed.compared(), replayed.checkpoints);
    let host = if options.in_processes.is_some() {
        ", in service processes"
    } else {
        ""
    };
    if replayed.is_identical() && replayed.log_ends.is_some() {
        text += &format!(
            "in the intact part of the log: all {compared} samples of {steps} steps and {checkpoints} checkpoints agree{host}\n"
        );
    } else if replayed.is_identical() {
        text += &format!("identical: {compared} samples of {steps} steps, {checkpoints} checkpoints{host}\n");
    } else {
        text += &format!(
            "not identical: {compared} samples of {steps} steps and {checkpoints} checkpoints were compared{host}\n"
        );
    }
    text
}

/// Names the keys of `--set` that were also set in flight: the replay repeats those changes.
#[must_use]
pub fn set_again(in_flight: &[(Key, f64)], sets: &[String]) -> String {
    let set: Vec<Key> = sets.iter().filter_map(|set| key_of_setting(set)).collect();
    let is_set = |key: &Key| {
        let mut set = set.iter().map(Key::segments);
        set.any(|set| set.starts_with(key.segments()) || key.segments().starts_with(set))
    };
    let again = in_flight.iter().filter(|(key, _)| is_set(key));
    let lines = again.map(|(key, time)| {
        format!("`{key}` was set in flight at {time} s: from there on the replay has the value of the flight, not that of --set\n")
    });
    lines.collect()
}

/// Describes the starts of the services.
fn starts_in_words(replayed: &Replayed, options: &Options) -> String {
    if replayed.starts.is_empty() {
        return "No earlier checkpoint was recorded: started at the beginning of the flight.".to_owned();
    }
    let services = match options.services.len() {
        0 => ServiceId::ALL.len(),
        count => count,
    };
    let repeated = services
        - usize::from(replayed.not_replayable.is_some())
        - replayed.external_services.len()
        - replayed.without_inputs.len();
    let rest = if replayed.starts.len() < repeated {
        "; the others at the beginning of the flight"
    } else {
        ""
    };
    let starts = replayed.starts.iter();
    let starts: Vec<_> = starts
        .map(|start| format!("{} at {} s", start.service, start.time))
        .collect();
    format!("Started from checkpoints: {}{rest}.", starts.join(", "))
}

fn names(services: &[ServiceId]) -> String {
    let names: Vec<_> = services.iter().map(ServiceId::to_string).collect();
    names.join(", ")
}

fn in_words(difference: &Difference, [first, second]: [&str; 2]) -> String {
    let Difference {
        topic,
        tick,
        time,
        field,
        recorded,
        replayed,
    } = difference;
    format!(
        "The first difference is at tick {tick} ({time} s), `{field}` of `{topic}`:\n  {first} {recorded}\n  {second} {replayed}\n"
    )
}

fn table(comparisons: &[Comparison]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
        "topic",
        "compared",
        "different",
        "first at, s",
        "largest difference",
        "at, s",
    ]);
    for comparison in comparisons {
        let first = comparison.first.as_ref();
        table.add_row([
            comparison.topic.to_string(),
            comparison.compared.to_string(),
            comparison.different.to_string(),
            first.map_or_else(String::new, |difference| difference.time.to_string()),
            comparison
                .largest
                .map_or_else(String::new, |(largest, _)| format!("{largest:.3e}")),
            comparison
                .largest
                .map_or_else(String::new, |(_, time)| time.to_string()),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_of_a_key_that_was_set_in_flight_is_named_with_the_time() {
        let in_flight = ["controller.k1", "controller.lambda_disturbance"]
            .map(|key| (scenario_file::path_of(key).unwrap(), 3.5));
        let shown = |set: &str| set_again(&in_flight, &[set.to_owned()]);
        assert!(shown("controller.k1=9").starts_with("`controller.k1` was set in flight at 3.5 s"));
        assert!(shown("controller.lambda_disturbance.0=9").contains("lambda_disturbance"));
        assert_eq!(shown("controller={k1=9}").lines().count(), 2);
        assert_eq!(shown("controller.k2=9"), "");
    }
}
