//! What is drawn beside what. The page draws what this says, and knows no channel by name.

use serde::Serialize;

/// Axes over time, and what is drawn in them.
#[derive(Serialize)]
pub(super) struct Panel {
    title: &'static str,
    unit: &'static str,
    is_logarithmic: bool,
    /// Whether the theorem's bound of each flight is drawn too.
    has_bound: bool,
    groups: &'static [Group],
}

/// Curves of one quantity. With several logs each group gets a panel of its own.
#[derive(Serialize)]
struct Group {
    /// What tells the group from others in the panel.
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
const COMMAND: &str = "control/command";
const ADAPTATION: &str = "control/adaptation";
const REFERENCE: &str = "path/reference";

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

const fn panel(title: &'static str, unit: &'static str, groups: &'static [Group]) -> Panel {
    Panel {
        title,
        unit,
        is_logarithmic: false,
        has_bound: false,
        groups,
    }
}

/// All panels, in the order of the page. One whose channels a log does not have is left out there.
pub(super) const PANELS: [Panel; 12] = [
    Panel {
        is_logarithmic: true,
        has_bound: true,
        ..panel(
            "Distance from the path",
            "m",
            &[group(
                "",
                &[
                    curve(ERRORS, "z1", "‖z1‖", 0),
                    curve(TRUTH, "error", "‖p − pd‖ true", 2),
                ],
            )],
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
        &[
            group("x", &[curve(COMMAND, "torque_x", "τx", 0)]),
            group("y", &[curve(COMMAND, "torque_y", "τy", 0)]),
            group("z", &[curve(COMMAND, "torque_z", "τz", 0)]),
        ],
    ),
    panel(
        "Body rates ω",
        "rad/s",
        &[
            group(
                "x",
                &[
                    curve(TRUTH, "rate_x", "ωx", 0),
                    curve(COMMAND, "rate_x", "ωx commanded", 1),
                ],
            ),
            group(
                "y",
                &[
                    curve(TRUTH, "rate_y", "ωy", 0),
                    curve(COMMAND, "rate_y", "ωy commanded", 1),
                ],
            ),
            group(
                "z",
                &[
                    curve(TRUTH, "rate_z", "ωz", 0),
                    curve(COMMAND, "rate_z", "ωz commanded", 1),
                ],
            ),
        ],
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
        &[
            group(
                "x",
                &[
                    curve(ADAPTATION, "disturbance_x", "b̂x", 0),
                    curve(TRUTH, "disturbance_x", "bx", 1),
                ],
            ),
            group(
                "y",
                &[
                    curve(ADAPTATION, "disturbance_y", "b̂y", 0),
                    curve(TRUTH, "disturbance_y", "by", 1),
                ],
            ),
            group(
                "z",
                &[
                    curve(ADAPTATION, "disturbance_z", "b̂z", 0),
                    curve(TRUTH, "disturbance_z", "bz", 1),
                ],
            ),
        ],
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
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::channels;
    use std::collections::BTreeSet;

    #[test]
    fn every_curve_is_a_channel_and_every_channel_a_curve() {
        let curves: BTreeSet<_> = PANELS
            .iter()
            .flat_map(|panel| panel.groups)
            .flat_map(|group| group.curves)
            .map(|curve| (curve.topic, curve.channel))
            .collect();
        let tables: [(&str, &[&str]); 5] = [
            (TRUTH, &channels::TRUTH),
            (ERRORS, &channels::ERRORS),
            (COMMAND, &channels::COMMAND),
            (ADAPTATION, &channels::ADAPTATION),
            (REFERENCE, &channels::REFERENCE),
        ];
        let channels: BTreeSet<_> = tables
            .into_iter()
            .flat_map(|(topic, channels)| channels.iter().map(move |&channel| (topic, channel)))
            .collect();
        assert_eq!(curves, channels);
    }
}
