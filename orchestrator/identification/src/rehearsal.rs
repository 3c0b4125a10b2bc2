//! Rehearsals: flights of a laboratory's scenario without the laboratory. What is fitted to one is of the simulation.

use std::net::IpAddr;

use scenario::Scenario;
use serde::Serialize;

/// Simulation that a laboratory's scenario was flown in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rehearsal {
    /// Vehicle and cameras were simulated by the flight itself.
    Simulated,
    /// The cameras were on the same machine, as those of the simulated laboratory are.
    World,
}

impl Rehearsal {
    /// Returns what replaced the laboratory of a scenario; `None` for a laboratory, and for a scenario without one.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Option<Self> {
        if let Some((_, capture)) = scenario.capture_system() {
            let server: Option<IpAddr> = capture.server.parse().ok();
            return server
                .is_some_and(|server| server.is_loopback())
                .then_some(Self::World);
        }
        let link = scenario.rc_output.as_ref();
        let has_link = link.is_some_and(|link| !link.link.is_simulated());
        let is_of_laboratory = scenario.motion_capture.is_some() || has_link;
        (scenario.pose_source().is_simulated() && scenario.real_receivers().is_none() && is_of_laboratory)
            .then_some(Self::Simulated)
    }
}

/// Returns the paragraph below the found values, which are `values`, such as "delay and noise": the lines that go into the
/// scenario, or why they do not. Empty without lines in a laboratory. `is_late` is `true` if the machine was late.
pub(crate) fn advice(rehearsal: Option<Rehearsal>, is_late: bool, values: &str, lines: &str) -> String {
    let put = |head: &str| {
        if lines.is_empty() {
            String::new()
        } else {
            format!("{head}\n\n{lines}")
        }
    };
    match rehearsal {
        _ if is_late => {
            format!(
                "The machine was late in this flight, and {values} contain that. Nothing of it goes into the scenario.\n"
            )
        }
        None => put("Put into the scenario:"),
        Some(Rehearsal::Simulated) => format!(
            "This flight was a rehearsal: {values} are those of the simulation, not of your vehicle, radio and cameras. Nothing of \
             it goes into the scenario.\n"
        ),
        Some(Rehearsal::World) => {
            let put = put("\n\nOnly if the vehicle and its cameras were real, put into the scenario:");
            let end = if put.is_empty() { "\n" } else { "" };
            format!(
                "The cameras of this flight were on this machine. If that was `gerono world`, {values} are those of the simulated \
                 laboratory, not of your vehicle, radio and cameras, and nothing of it goes into the scenario.{put}{end}"
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINES: &str = "[model]\nradio_latency = 0.00013\n";

    #[test]
    fn lines_are_offered_without_a_condition_only_for_a_laboratory() {
        let told = |rehearsal, lines| advice(rehearsal, false, "delay and noise", lines);
        for rehearsal in [None, Some(Rehearsal::World), Some(Rehearsal::Simulated)] {
            let late = advice(rehearsal, true, "delay and noise", LINES);
            assert!(
                late.contains("machine was late") && !late.contains("radio_latency"),
                "{late}"
            );
        }
        assert_eq!(told(None, LINES), format!("Put into the scenario:\n\n{LINES}"));
        assert_eq!(told(None, ""), "");
        for lines in [LINES, ""] {
            let simulated = told(Some(Rehearsal::Simulated), lines);
            assert!(simulated.contains("was a rehearsal") && !simulated.contains("radio_latency"));
            assert!(
                simulated.contains("Nothing of it goes into the scenario"),
                "{simulated}"
            );
        }
        let world = told(Some(Rehearsal::World), LINES);
        assert!(world.contains("`gerono world`, delay and noise are"), "{world}");
        assert!(
            !world.contains("Put into")
                && world.contains("Only if the vehicle and its cameras were real, put")
        );
        assert!(world.ends_with(LINES));
        let as_stated = told(Some(Rehearsal::World), "");
        assert!(as_stated.contains("`gerono world`") && !as_stated.contains("Only if"));
    }
}
