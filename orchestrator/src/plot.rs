//! Figures of logs, as SVG with real text.

pub(crate) mod downsample;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use kuva::prelude::{Layout, LegendPosition, LinePlot, Plot, ReferenceLine, TickFormat};
use shared_types::samples::ControlErrors;
use shared_types::scenario::{Scenario, VehicleChange};
use shared_types::service::seconds;

use crate::log::{LogReadError, LogReader};
use crate::summary::z1_norm;
use downsample::Extremes;

/// Size of a figure, pixels: as wide as a README is shown.
pub(crate) const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 400.0;

/// Columns that a curve is drawn in: about one a pixel.
pub(crate) const COLUMNS: usize = 800;

/// Least ‖z1‖ that is drawn, m: the axis is logarithmic and knows no zero.
pub(crate) const FLOOR: f64 = 1e-4;

/// Colours of the curves, told apart by eyes of all kinds (Okabe and Ito), also from that of the bound.
pub(crate) const CURVE_COLORS: [&str; 5] = ["#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#000000"];
const BOUND_COLOR: &str = "#d55e00";
pub(crate) const CHANGE_COLOR: &str = "#666666";

/// Why a figure cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// A log cannot be read.
    #[error(transparent)]
    Read(#[from] LogReadError),
    /// A log holds nothing to draw.
    #[error("the log {} holds no sample of `control/errors`: nothing to draw", .0.display())]
    Empty(PathBuf),
    /// The figure cannot be written.
    #[error("cannot write the figure {}: {source}; choose a place that you may write to", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

/// ‖z1‖ over time of one flight.
struct Curve {
    label: String,
    scenario: Scenario,
    points: Vec<(f64, f64)>,
}

/// Draws ‖z1‖ over time of the logs into the SVG file `out`, with the theorem's bound and the changes of the vehicle.
///
/// Of many samples in one column of pixels, the smallest and the largest are drawn: no peak is lost.
///
/// # Errors
/// [`PlotError`].
pub fn z1(logs: &[PathBuf], out: &Path) -> Result<(), PlotError> {
    let curves = logs
        .iter()
        .map(|log| read_curve(log))
        .collect::<Result<Vec<_>, _>>()?;
    std::fs::write(out, draw(&curves)).map_err(|source| PlotError::Write {
        path: out.to_owned(),
        source,
    })
}

fn read_curve(log: &Path) -> Result<Curve, PlotError> {
    let reader = LogReader::open(log)?;
    let scenario = reader.manifest().scenario.clone();
    let mut extremes = Extremes::new(scenario.duration, COLUMNS);
    for errors in reader.samples::<ControlErrors>() {
        let errors = errors?;
        extremes.add(seconds(errors.header.stamp_ns), z1_norm(&errors).max(FLOOR));
    }
    let points = extremes.finish();
    if points.is_empty() {
        return Err(PlotError::Empty(log.to_owned()));
    }
    Ok(Curve {
        label: label(log),
        scenario,
        points,
    })
}

/// What a log is called in a legend: its folder, which tells runs apart, or its own name.
fn label(log: &Path) -> String {
    let folder = log.parent().and_then(Path::file_name);
    let name = if log.file_name().is_some_and(|name| name == "run.mcap") {
        folder
    } else {
        None
    };
    name.or(log.file_stem())
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn draw(curves: &[Curve]) -> String {
    let is_one_of_many = curves.len() > 1;
    let plots: Vec<Plot> = curves
        .iter()
        .zip(CURVE_COLORS.into_iter().cycle())
        .map(|(curve, color)| {
            let line = LinePlot::new()
                .with_data(curve.points.iter().copied())
                .with_color(color)
                .with_stroke_width(1.3);
            Plot::Line(if is_one_of_many {
                line.with_legend(&curve.label)
            } else {
                line
            })
        })
        .collect();
    let longest = curves
        .iter()
        .map(|curve| curve.scenario.duration)
        .fold(0.0, f64::max);
    let mut layout = Layout::auto_from_plots(&plots)
        .with_width(WIDTH)
        .with_height(HEIGHT)
        .with_x_label("time, s")
        .with_y_label("‖z1‖, distance from the path, m")
        .with_x_axis_min(0.0)
        .with_x_axis_max(longest)
        .with_log_y()
        .with_y_tick_format(TickFormat::Custom(Arc::new(|value| value.to_string())))
        .with_legend_position(LegendPosition::InsideTopRight);
    if let Some(title) = title(curves) {
        layout = layout.with_title(title);
    }
    for line in bound_lines(curves).into_iter().chain(change_lines(curves)) {
        layout = layout.with_reference_line(line);
    }
    kuva::render_to_svg(plots, layout)
}

/// The description that all scenarios share, if they do.
fn title(curves: &[Curve]) -> Option<&str> {
    let mut descriptions = curves.iter().map(|curve| curve.scenario.description.as_str());
    let first = descriptions.next().filter(|text| !text.is_empty())?;
    descriptions.all(|text| text == first).then_some(first)
}

/// The theorem's bound of every controller that flew.
fn bound_lines(curves: &[Curve]) -> Vec<ReferenceLine> {
    let mut bounds: Vec<f64> = curves
        .iter()
        .map(|curve| curve.scenario.controller.ultimate_bound())
        .collect();
    bounds.sort_by(f64::total_cmp);
    bounds.dedup();
    bounds
        .into_iter()
        .map(|bound| {
            ReferenceLine::horizontal(bound)
                .with_color(BOUND_COLOR)
                .with_label(format!("theorem's bound: {bound:.4} m"))
        })
        .collect()
}

/// The moments at which the vehicle of any flight changed, with what changed if it is the same in all.
fn change_lines(curves: &[Curve]) -> Vec<ReferenceLine> {
    let mut changes: Vec<&VehicleChange> = curves
        .iter()
        .flat_map(|curve| &curve.scenario.vehicle.change)
        .collect();
    changes.sort_by(|left, right| left.at.total_cmp(&right.at));
    changes
        .chunk_by(|left, right| left.at == right.at)
        .map(|same_time| {
            let is_same_change = same_time.iter().all(|change| change == &same_time[0]);
            ReferenceLine::vertical(same_time[0].at)
                .with_color(CHANGE_COLOR)
                .with_dasharray("3 3")
                .with_label(if is_same_change {
                    describe(same_time[0])
                } else {
                    "vehicle changes".to_owned()
                })
        })
        .collect()
}

/// What of the vehicle changes.
fn describe(change: &VehicleChange) -> String {
    let mut parts = Vec::new();
    if let Some(mass) = change.mass {
        parts.push(format!("mass becomes {mass} kg"));
    }
    if change.inertia.is_some() {
        parts.push("inertia changes".to_owned());
    }
    if let Some([x, y, z]) = change.disturbance {
        parts.push(format!("disturbance becomes [{x}, {y}, {z}] m/s²"));
    }
    parts.join(", ")
}

#[cfg(test)]
mod tests;
