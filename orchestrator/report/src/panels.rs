//! Arrangement of the plots. The page's script draws these panels and names no channel itself.

use std::collections::BTreeSet;

use serde::Serialize;
use serde_json::{Value, json};
use shared_types::Topic;

/// Time axes with their curves.
#[derive(Serialize)]
struct Panel {
    title: &'static str,
    unit: &'static str,
    is_logarithmic: bool,
    /// `true` if the theorem's bound of each flight is drawn as well.
    has_bound: bool,
    groups: &'static [Group],
}

/// Curves of one quantity. With several logs each group gets a separate panel.
#[derive(Serialize)]
struct Group {
    /// Name of the group within the panel.
    name: &'static str,
    curves: &'static [Curve],
}

/// A channel of a topic.
#[derive(Serialize)]
struct Curve {
    topic: &'static str,
    channel: &'static str,
    label: &'static str,
    /// 0 for a solid line, 1 dashed, 2 dotted.
    dash: u8,
}

const ERRORS: &str = "control/errors";
const TRUTH: &str = "vehicle/truth";
const STATE: &str = "vehicle/state";
const COMMAND: &str = "control/command";
const ADAPTATION: &str = "control/adaptation";
const REFERENCE: &str = "path/reference";
const INNOVATIONS: &str = "navigation/innovations";
const POSES: &str = "navigation/poses";
const BASELINES: &str = "navigation/baseline";

const fn curve(topic: &'static str, channel: &'static str, label: &'static str, dash: u8) -> Curve {
    Curve {
        topic,
        channel,
        label,
        dash,
    }
}

const fn group(name: &'static str, curves: &'static [Curve]) -> Group {
    Group { name, curves }
}

macro_rules! innovation {
    ($source:literal of $topic:ident) => {
        group($source, &[curve($topic, $source, $source, 0)])
    };
}

const fn panel(title: &'static str, unit: &'static str, groups: &'static [Group]) -> Panel {
    Panel {
        title,
        unit,
        is_logarithmic: false,
        has_bound: false,
        groups,
    }
}

/// Makes a group for each axis, with a curve for each `topic, channel, symbol, text after the symbol, dash`.
macro_rules! for_each_axis {
    (@group $axis:literal $($topic:ident $channel:literal $symbol:literal $words:literal $dash:literal;)+) => {
        group(
            $axis,
            &[$(curve($topic, concat!($channel, "_", $axis), concat!($symbol, $axis, $words), $dash)),+],
        )
    };
    ($($curves:tt)+) => {
        &[
            for_each_axis!(@group "x" $($curves)+),
            for_each_axis!(@group "y" $($curves)+),
            for_each_axis!(@group "z" $($curves)+),
        ]
    };
}

/// All panels, in the order of the page. The page omits a panel without data.
const PANELS: [Panel; 14] = [
    Panel {
        is_logarithmic: true,
        has_bound: true,
        ..panel(
            "Distance from the path",
            "m",
            &[group(
                "",
                &[
                    curve(TRUTH, "error", "true", 0),
                    curve(STATE, "error", "as estimated", 0),
                ],
            )],
        )
    },
    Panel {
        is_logarithmic: true,
        ..panel(
            "Position error of the controller ‖z1‖",
            "m",
            &[group("", &[curve(ERRORS, "z1", "‖z1‖", 0)])],
        )
    },
    panel(
        "Velocity error ‖z2‖",
        "m/s",
        &[group("", &[curve(ERRORS, "z2", "‖z2‖", 0)])],
    ),
    panel(
        "Error of the body rates ‖z3‖",
        "rad/s",
        &[group("", &[curve(ERRORS, "z3", "‖z3‖", 0)])],
    ),
    panel(
        "Error of the path's speed z4",
        "1/s",
        &[group("", &[curve(ERRORS, "z4", "z4", 0)])],
    ),
    panel(
        "Thrust T",
        "N",
        &[group(
            "",
            &[
                curve(COMMAND, "thrust", "commanded", 0),
                curve(TRUTH, "thrust", "acting", 1),
            ],
        )],
    ),
    panel(
        "Torque τ commanded",
        "N m",
        for_each_axis!(COMMAND "torque" "τ" "" 0;),
    ),
    panel(
        "Body rates ω",
        "rad/s",
        for_each_axis!(
            TRUTH "rate" "ω" "" 0;
            COMMAND "rate" "ω" " commanded" 1;
        ),
    ),
    panel(
        "Mass",
        "kg",
        &[group(
            "",
            &[
                curve(ADAPTATION, "mass", "m̂", 0),
                curve(TRUTH, "mass", "m", 1),
                curve(ADAPTATION, "observer_mass", "m̂ of the observer", 2),
            ],
        )],
    ),
    panel(
        "Disturbance b",
        "m/s²",
        for_each_axis!(
            ADAPTATION "disturbance" "b̂" "" 0;
            TRUTH "disturbance" "b" "" 1;
        ),
    ),
    panel(
        "Attitude",
        "rad",
        &[
            group("roll", &[curve(TRUTH, "roll", "roll φ", 0)]),
            group("pitch", &[curve(TRUTH, "pitch", "pitch θ", 0)]),
            group(
                "yaw",
                &[curve(TRUTH, "yaw", "yaw ψ", 0), curve(REFERENCE, "yaw", "ψd", 1)],
            ),
        ],
    ),
    panel(
        "Yaw error ψ − ψd",
        "rad",
        &[group("", &[curve(TRUTH, "yaw_error", "ψe", 0)])],
    ),
    panel(
        "Speed of the path's parameter",
        "1/s",
        &[group(
            "",
            &[
                curve(REFERENCE, "gamma_dot", "γ̇", 0),
                curve(REFERENCE, "gamma_dot_desired", "γ̇d", 1),
            ],
        )],
    ),
    Panel {
        is_logarithmic: true,
        ..panel(
            "Innovations over their predicted deviation",
            "1",
            &[
                innovation!("position" of INNOVATIONS),
                innovation!("velocity" of INNOVATIONS),
                innovation!("field" of INNOVATIONS),
                innovation!("altitude" of INNOVATIONS),
                innovation!("zero velocity" of INNOVATIONS),
                innovation!("resting rate" of INNOVATIONS),
                innovation!("pose position" of POSES),
                innovation!("pose attitude" of POSES),
                innovation!("baseline" of BASELINES),
            ],
        )
    },
];

/// Returns all panels, with one for each of these names of telemetry.
pub fn panels(telemetry: &BTreeSet<&str>) -> Vec<Value> {
    let telemetry_panel = |name: &&str| {
        let curve =
            json!({"topic": Topic::ControlTelemetry.name(), "channel": name, "label": name, "dash": 0});
        json!({
            "title": format!("Telemetry: {name}"), "unit": "", "is_logarithmic": false, "has_bound": false,
            "groups": [{"name": "", "curves": [curve]}],
        })
    };
    let fixed = PANELS.iter().map(|panel| json!(panel));
    fixed.chain(telemetry.iter().map(telemetry_panel)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channels;
    use std::collections::BTreeSet;

    #[test]
    fn every_curve_is_a_channel_and_every_channel_a_curve() {
        let curves: BTreeSet<_> = PANELS
            .iter()
            .flat_map(|panel| panel.groups)
            .flat_map(|group| group.curves)
            .map(|curve| (curve.topic, curve.channel))
            .collect();
        let tables: [(&str, &[&str]); 9] = [
            (TRUTH, &channels::TRUTH),
            (STATE, &channels::STATE),
            (ERRORS, &channels::ERRORS),
            (COMMAND, &channels::COMMAND),
            (ADAPTATION, &channels::ADAPTATION),
            (REFERENCE, &channels::REFERENCE),
            (INNOVATIONS, &channels::INNOVATIONS),
            (POSES, &channels::POSES),
            (BASELINES, &channels::BASELINES),
        ];
        let channels: BTreeSet<_> = tables
            .into_iter()
            .flat_map(|(topic, channels)| channels.iter().map(move |&channel| (topic, channel)))
            .collect();
        assert_eq!(curves, channels);
    }
}
