//! The drawings, numbered and labelled as in the paper, each from one seed's flights in the baseline laboratory.

use std::collections::BTreeMap;

use super::canvas::{Curve, Panel, Scale, draw};
use super::figures::Figure;
use super::traces::{Channel, Traces};

/// Traces of the drawn flights, by name.
pub type TraceBook = BTreeMap<String, Traces>;

/// A drawing.
#[derive(Clone, Copy, Debug)]
pub struct Drawing {
    /// The experiment of the drawing.
    pub figure: Figure,
    /// File name.
    pub file: &'static str,
    /// Title of the drawing.
    pub title: &'static str,
    /// Names of the flights drawn.
    pub flights: &'static [&'static str],
    panels: fn(&TraceBook) -> Vec<Panel>,
}

impl Drawing {
    /// Returns the drawing as SVG, without curves of missing flights.
    #[must_use]
    pub fn svg(&self, flights: &TraceBook) -> String {
        draw(self.title, &(self.panels)(flights))
    }
}

const FIG10_FLIGHT: &str = "fig10, bob, prior +15 g, wind +0.85 m/s²";
const FOLLOWING: &str = "trajectory_tracking, path.mode=following";
const SOFT: &str = "fig8, k1 = k2 = 0.87";

/// All drawings, in the paper's order.
pub const DRAWINGS: [Drawing; 12] = [
    Drawing {
        figure: Figure::Fig1,
        file: "fig1.svg",
        title: "Fig. 1: ‖z1‖, simulation, mass and inertia step at ts",
        flights: &["fig1"],
        panels: |flights| vec![error(flights, &[("", "fig1")], &[(30.0, "ts")])],
    },
    Drawing {
        figure: Figure::Fig2,
        file: "fig2.svg",
        title: "Fig. 2: ‖z1‖, simulation, three initial position errors",
        flights: &["fig2_near", "fig2_middle", "fig2_far"],
        panels: |flights| {
            let curves = [
                ("‖z1(0)‖ = 8.15 m", "fig2_near"),
                ("‖z1(0)‖ = 26.58 m", "fig2_middle"),
                ("‖z1(0)‖ = 51.40 m", "fig2_far"),
            ];
            vec![error(flights, &curves, &[(30.0, "ts")])]
        },
    },
    Drawing {
        figure: Figure::Fig3To6,
        file: "fig3.svg",
        title: "Fig. 3: actual position and desired path, seen from above",
        flights: &["fig3_6"],
        panels: |flights| flights.get("fig3_6").map(map).into_iter().collect(),
    },
    Drawing {
        figure: Figure::Fig3To6,
        file: "fig4.svg",
        title: "Fig. 4: ‖z1‖ in the laboratory, coins laid on at ts",
        flights: &["fig3_6", "fig3_6, paper mode"],
        panels: |flights| {
            let curves = [
                ("δ = 0.25, offset removed", "fig3_6"),
                ("paper mode, δ = 0.1", "fig3_6, paper mode"),
            ];
            vec![error(flights, &curves, &[(30.0, "ts")])]
        },
    },
    Drawing {
        figure: Figure::Fig3To6,
        file: "fig5.svg",
        title: "Fig. 5: m̂ and m̃, Λb = 1",
        flights: &["fig3_6, Λb = 1"],
        panels: |flights| {
            let mass = [
                ("m̂", "fig3_6, Λb = 1", Channel::MassEstimate),
                ("m", "fig3_6, Λb = 1", Channel::Mass),
            ];
            let mass_error = [("|m̃|", "fig3_6, Λb = 1", Channel::MassError)];
            vec![
                over_time(flights, "mass, kg", &mass, &[(30.0, "ts")]),
                over_time(flights, "|m̃|, kg", &mass_error, &[(30.0, "ts")]),
            ]
        },
    },
    Drawing {
        figure: Figure::Fig3To6,
        file: "fig6.svg",
        title: "Fig. 6: T and body rates (the vehicle takes rates in place of τ)",
        flights: &["fig3_6"],
        panels: |flights| {
            let rates = [("ωx", "fig3_6", Channel::RateX), ("ωy", "fig3_6", Channel::RateY)];
            let thrust = [("T", "fig3_6", Channel::Thrust)];
            vec![
                over_time(flights, "T, N", &thrust, &[(30.0, "ts")]),
                over_time(flights, "ω, rad/s", &rates, &[(30.0, "ts")]),
            ]
        },
    },
    Drawing {
        figure: Figure::Fig7,
        file: "fig7.svg",
        title: "Fig. 7: hover in the jet of a fan, estimators on",
        flights: &["fig7"],
        panels: |flights| {
            let marks = [(30.0, "ta")];
            let push = [
                ("b̂y", "fig7", Channel::DisturbanceEstimateY),
                ("by", "fig7", Channel::DisturbanceY),
            ];
            vec![
                error(flights, &[("", "fig7")], &marks),
                over_time(flights, "b̂y, m/s²", &push, &marks),
                over_time(flights, "roll φ, rad", &[("φ", "fig7", Channel::Roll)], &marks),
            ]
        },
    },
    Drawing {
        figure: Figure::Fig8,
        file: "fig8.svg",
        title: "Fig. 8: ‖z1‖, the same fan, estimators off",
        flights: &["fig8", SOFT, "fig7"],
        panels: |flights| {
            let curves = [
                ("off, k1 = k2 = 4", "fig8"),
                ("off, k1 = k2 = 0.87", SOFT),
                ("on (Fig. 7)", "fig7"),
            ];
            vec![error(flights, &curves, &[(30.0, "tb")])]
        },
    },
    Drawing {
        figure: Figure::Fig9,
        file: "fig9.svg",
        title: "Fig. 9: hover in the jet of a fan that is carried around",
        flights: &["fig9"],
        panels: |flights| vec![error(flights, &[("", "fig9")], &[(20.0, "tc")])],
    },
    Drawing {
        figure: Figure::Fig10,
        file: "fig10.svg",
        title: "Fig. 10: |m̃| under a steady vertical wind, prior +15 g, bz = 0.85 m/s²",
        flights: &[FIG10_FLIGHT],
        panels: |flights| {
            let curves = [
                ("proposed", FIG10_FLIGHT, Channel::MassError),
                ("I&I observer", FIG10_FLIGHT, Channel::ObserverMassError),
            ];
            vec![over_time(flights, "|m̃|, kg", &curves, &[])]
        },
    },
    Drawing {
        figure: Figure::Fig11,
        file: "fig11.svg",
        title: "Fig. 11: yaw steps on the tilted eight",
        flights: &["fig11"],
        panels: |flights| {
            let marks = [(20.0, "t1"), (50.0, "t2")];
            let yaw = [("ψ", "fig11", Channel::Yaw), ("ψd", "fig11", Channel::YawDesired)];
            let yaw_error = [("ψe", "fig11", Channel::YawError)];
            vec![
                error(flights, &[("", "fig11")], &marks),
                over_time(flights, "ψ, ψd, rad", &yaw, &marks),
                over_time(flights, "ψe, rad", &yaw_error, &marks),
            ]
        },
    },
    Drawing {
        figure: Figure::Tracking,
        file: "tracking.svg",
        title: "Path following and trajectory tracking from the same start",
        flights: &["trajectory_tracking", FOLLOWING],
        panels: |flights| {
            let both = [("following", FOLLOWING), ("tracking", "trajectory_tracking")];
            let curves = |channel| both.map(|(label, flight)| (label, flight, channel));
            vec![
                error(flights, &both, &[]),
                over_time(flights, "T, N", &curves(Channel::Thrust), &[]),
                over_time(flights, "‖ω‖, rad/s", &curves(Channel::Rate), &[]),
            ]
        },
    },
];

/// Returns a panel of ‖z1‖ of labelled flights.
fn error(flights: &TraceBook, curves: &[(&'static str, &str)], marks: &[(f64, &'static str)]) -> Panel {
    let curves: Vec<_> = curves
        .iter()
        .map(|&(label, flight)| (label, flight, Channel::Error))
        .collect();
    Panel {
        scale: Scale::Logarithmic,
        ..over_time(flights, "‖z1‖, m", &curves, marks)
    }
}

/// Returns a panel of labelled channels of flights over time.
fn over_time(
    flights: &TraceBook,
    y_label: &'static str,
    curves: &[(&'static str, &str, Channel)],
    marks: &[(f64, &'static str)],
) -> Panel {
    let curves = curves.iter().filter_map(|&(label, flight, channel)| {
        let traces = flights.get(flight)?;
        Some(Curve {
            label,
            points: traces.channel(channel).to_vec(),
        })
    });
    Panel {
        x_label: "time, s",
        y_label,
        scale: Scale::Linear,
        curves: curves.collect(),
        marks: marks.to_vec(),
    }
}

/// Returns the trajectory seen from above: y to the right, x upwards.
fn map(traces: &Traces) -> Panel {
    let from_above = |positions: &[[f64; 3]]| positions.iter().map(|[x, y, _]| (*y, *x)).collect();
    Panel {
        x_label: "y, m",
        y_label: "x, m",
        scale: Scale::Map,
        curves: vec![
            Curve {
                label: "actual",
                points: from_above(&traces.positions),
            },
            Curve {
                label: "desired",
                points: from_above(&traces.desired_positions),
            },
        ],
        marks: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_drawing_is_made_of_flights_of_its_figure() {
        for drawing in DRAWINGS {
            let specifications = drawing.figure.experiment().specifications;
            for flight in drawing.flights {
                assert!(
                    specifications
                        .iter()
                        .any(|specification| specification.name == *flight),
                    "{}: {flight}",
                    drawing.file
                );
            }
        }
    }

    #[test]
    fn every_figure_of_the_paper_is_drawn() {
        for number in 1..=11 {
            let file = format!("fig{number}.svg");
            assert!(DRAWINGS.iter().any(|drawing| drawing.file == file), "{file}");
        }
    }
}
