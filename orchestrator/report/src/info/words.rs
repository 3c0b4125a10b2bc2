//! Text form of a log's content.

use std::fmt::{Display, Formatter, Result};

use comfy_table::{Table, presets};
use serde_json::Value;

use super::{Info, Judged, State, TopicInfo};
use metrics::tracker::StateSource;
use scenario_file::printable::printable;

impl Display for State {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        formatter.pad(match self {
            Self::Complete => "complete",
            Self::Recovered => "recovered",
            Self::Unclosed => "never closed, or still being written",
            Self::Damaged => "damaged",
        })
    }
}

impl Display for Info {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let Self { log, state, .. } = self;
        let files = match self.files {
            1 => String::new(),
            count => format!("{count} files with "),
        };
        writeln!(
            formatter,
            "{log}: {state}; {:.1} MB in {files}{} chunks, compression {}, format {}",
            self.bytes as f64 * 1e-6,
            self.chunks,
            self.compression,
            self.format_version
        )?;
        if let Some(reason) = &self.reason {
            writeln!(formatter, "{reason}")?;
        }
        match &self.recovery {
            Some(recovery) if *state == State::Recovered => {
                let source = printable(&recovery.source);
                writeln!(formatter, "recovered from {source}: {recovery}")?;
            }
            Some(recovery) => writeln!(formatter, "a recovery would give: {recovery}")?,
            None => {}
        }
        self.write_flight(formatter)?;
        if let Some(judged) = &self.judged {
            write_judged(formatter, judged)?;
        }
        if let Some(summary) = &self.summary {
            write_summary(formatter, summary)?;
        }
        if let Some(host) = &self.host {
            let state = if host.is_whole { "complete" } else { "incomplete" };
            let counts: Vec<_> = host
                .samples
                .iter()
                .map(|(channel, count)| format!("{count} of {}", printable(channel)))
                .collect();
            let counts = if counts.is_empty() {
                "the start of the run, and no samples".to_owned()
            } else {
                counts.join(", ")
            };
            writeln!(formatter, "{}: {state}; {counts}", host.log)?;
        }
        Ok(())
    }
}

impl Info {
    fn write_flight(&self, formatter: &mut Formatter<'_>) -> Result {
        let scenario = &self.scenario;
        writeln!(
            formatter,
            "\n{}\ncontrol law: {}\nseed {}, tick {} s, planned {} s",
            printable(&scenario.description),
            printable(&self.control_law),
            scenario.seed,
            scenario.schedule.tick,
            scenario.duration
        )?;
        if let (Some(first), Some(last)) = (self.first_tick, self.last_tick) {
            writeln!(
                formatter,
                "{} samples of ticks {first} to {last} ({:.3} s)",
                self.samples, self.seconds
            )?;
        }
        writeln!(formatter, "\n{}", topic_table(&self.topics))?;
        for fault in &self.faults {
            writeln!(formatter, "planned fault {fault}")?;
        }
        Ok(())
    }
}

fn topic_table(topics: &[TopicInfo]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
        "topic",
        "samples",
        "rate, Hz",
        "first tick",
        "last tick",
        "gaps",
        "missing",
    ]);
    for topic in topics {
        let rate = topic.rate.filter(|_| topic.samples > 2);
        table.add_row([
            topic.topic.to_owned(),
            topic.samples.to_string(),
            rate.map_or_else(String::new, |rate| format!("{rate:.3}")),
            topic.first_tick.to_string(),
            topic.last_tick.to_string(),
            topic.gaps.to_string(),
            topic.missing.to_string(),
        ]);
    }
    table
}

/// Writes the kill, the loss of the vehicle and its distance from the path, computed from the log.
fn write_judged(formatter: &mut Formatter<'_>, judged: &Judged) -> Result {
    if let Some(kill) = &judged.killed {
        writeln!(formatter, "\nKILLED {kill}")?;
    }
    if let Some(failed) = &judged.failed_take_off {
        writeln!(formatter, "\n{failed}")?;
    }
    if let Some(response) = &judged.response {
        writeln!(formatter, "\nWRONG: {response}")?;
    }
    if let Some(loss) = &judged.lost {
        writeln!(formatter, "\nLOST at {} s: {loss}", loss.time)?;
    }
    if let Some(metrics) = &judged.metrics {
        let estimated = match judged.source {
            StateSource::Truth => "",
            StateSource::Estimate => ", as estimated",
        };
        if let Some(steady) = &judged.steady {
            let [from, to] = steady.span;
            writeln!(
                formatter,
                "distance from the path{estimated}, in steady state ({from:.1} to {to:.1} s): RMS {:.3} cm, 95 % {:.3} cm",
                100.0 * steady.rmse,
                100.0 * steady.p95
            )?;
        }
        writeln!(
            formatter,
            "distance from the path{estimated}, over the whole flight: RMS {:.3} cm, 95 % {:.3} cm, largest {:.3} cm at {:.3} s",
            100.0 * metrics.rmse,
            100.0 * metrics.p95,
            100.0 * metrics.max,
            metrics.time_of_max
        )?;
    }
    Ok(())
}

/// Writes the ultimate distance of each phase, compared with the theorem's bound where it applies.
fn write_phases(formatter: &mut Formatter<'_>, summary: &Value) -> Result {
    for phase in summary["phases"].as_array().into_iter().flatten() {
        let Some(ultimate) = phase["ultimate"].as_f64() else {
            continue;
        };
        let bound = match phase["against_bound"].as_str() {
            Some("within") => ", within the bound",
            Some("near") => ", near the bound",
            Some(_) => ", above the bound",
            None => "",
        };
        let [begins, ends] = ["begins", "ends"].map(|key| {
            let time = phase[key].as_f64();
            time.map_or_else(|| "unknown".to_owned(), |time| time.to_string())
        });
        writeln!(
            formatter,
            "{begins} to {ends} s: ultimate distance from the path at most {:.3} cm{bound}",
            100.0 * ultimate
        )?;
    }
    Ok(())
}

/// Writes the course of the run. Fields that an older program did not write are skipped.
fn write_summary(formatter: &mut Formatter<'_>, summary: &Value) -> Result {
    if summary.get("outcome").is_none()
        && let (Some(seconds), Some(frames)) = (summary["seconds"].as_f64(), summary["frames"].as_u64())
    {
        return writeln!(
            formatter,
            "\nthe simulated laboratory of a flight (`gerono world`): {seconds:.3} s simulated, {frames} frames received; the \
             flight itself has a folder of its own"
        );
    }
    let text = |value: &Value| printable(value.as_str().unwrap_or("unknown")).into_owned();
    let list = |key: &str| summary[key].as_array().cloned().unwrap_or_default();
    write!(
        formatter,
        "\nthe run: {} by {}",
        text(&summary["outcome"]),
        text(&summary["host"])
    )?;
    match summary["reason"].as_str() {
        None | Some("") => writeln!(formatter)?,
        Some(reason) => writeln!(formatter, ": {}", printable(reason))?,
    }
    write_phases(formatter, summary)?;
    for fault in list("faults") {
        write!(formatter, "{}: ", text(&fault["fault"]))?;
        match (fault["peak_error"].as_f64(), fault["back_after"].as_f64()) {
            (Some(peak), Some(back)) => writeln!(
                formatter,
                "at most {peak:.4} m from the path, recovered after {back} s"
            )?,
            (Some(peak), None) => writeln!(
                formatter,
                "at most {peak:.4} m from the path, no recovery recorded"
            )?,
            (None, _) => writeln!(formatter, "distance from the path unknown")?,
        }
    }
    // Summaries of earlier versions have `rebirths`.
    for restart in list("restarts").into_iter().chain(list("rebirths")) {
        let position = restart["tick"].as_u64().map_or_else(
            || "before its first step".to_owned(),
            |tick| format!("after tick {tick}"),
        );
        let lost = restart["lost_seconds"].as_f64();
        let within = lost.map_or_else(String::new, |lost| format!(", within {lost:.3} s"));
        writeln!(
            formatter,
            "{} was restarted {position}{within}",
            text(&restart["service"])
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    struct Shown(Value);

    impl std::fmt::Display for Shown {
        fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
            write_summary(formatter, &self.0)
        }
    }

    #[test]
    fn what_a_summary_lacks_is_unknown_or_left_out() {
        assert_eq!(Shown(json!({})).to_string(), "\nthe run: unknown by unknown\n");
        let world = Shown(json!({ "seconds": 3.9294, "poses": 393, "frames": 0 })).to_string();
        assert!(
            world.starts_with(
                "\nthe simulated laboratory of a flight (`gerono world`): 3.929 s simulated, 0 frames"
            ),
            "{world}"
        );
        let old = json!({
            "outcome": "lost", "host": "lockstep", "reason": "tipped over",
            "restarts": [{ "service": "controller", "tick": 7 }],
            "phases": [{ "ultimate": 0.01 }],
        });
        let shown = Shown(old).to_string();
        assert!(
            shown.starts_with("\nthe run: lost by lockstep: tipped over\n"),
            "{shown}"
        );
        assert!(
            shown.ends_with("controller was restarted after tick 7\n"),
            "{shown}"
        );
        assert!(
            shown.contains("unknown to unknown s") && !shown.contains("NaN"),
            "{shown}"
        );
    }
}
