//! Figures of logs as SVG, with text as text elements.

mod curve;
pub mod downsample;
pub mod legend;
mod marks;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io};

use kuva::prelude::{Layout, LinePlot, Plot, TickFormat};

use curve::Curve;
pub use curve::Span;
pub(crate) use curve::label;
use metrics::tracker::StateSource;
use run_log::{LogReadError, files_of_log};
use scenario::Unflyable;

/// Width of a figure, pixels: that of a rendered README.
pub const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 400.0;

/// Columns that a curve is downsampled to: about one a pixel.
pub const COLUMNS: usize = 800;

/// Columns of text at which the lines below the title wrap.
const SUBTITLE: usize = 100;

/// Smallest distance drawn, m: a logarithmic axis has no zero.
pub const FLOOR: f64 = 1e-4;

/// Palette for colour-blind readers (Okabe and Ito).
pub const COLORS: [&str; 8] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442",
];

/// Colours of curves, distinct from that of the bound.
pub const CURVE_COLORS: [&str; 5] = ["#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#000000"];
/// Colour of the lines at changes of the vehicle.
pub const CHANGE_COLOR: &str = "#666666";

/// Reason why a figure cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// A log cannot be read.
    #[error("{0}")]
    Read(#[from] LogReadError),
    /// A log holds nothing to draw.
    #[error(
        "the log {} has no distance from the path in this time span: nothing to draw; {why}", .log.display()
    )]
    Empty {
        /// The file.
        log: PathBuf,
        /// Why not, or the next step.
        why: String,
    },
    /// The time span is not within the flights.
    #[error("the flights end at {ends} s, and {option} {stated} s is beyond it; ask for less")]
    BeyondTheEnd {
        /// Option that states the bound.
        option: &'static str,
        /// Stated time, s.
        stated: f64,
        /// End of the longest flight, s.
        ends: f64,
    },
    /// The scenario of a log makes no schedule.
    #[error("the scenario of the log {} makes no schedule: {source}; use the program that wrote it", .path.display())]
    Scenario {
        /// The file.
        path: PathBuf,
        /// Reason why not.
        source: Unflyable,
    },
    /// The figure cannot be written.
    #[error("cannot write the figure {}: {source}; choose a path that you may write to", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
}

/// Label of the axis in every figure.
const LABEL: &str = "distance from the path";

/// Returns the name of a figure whose user states none: beside the log, and free or that of an earlier figure.
///
/// # Errors
/// [`PlotError::Write`] if something else has its name.
pub fn file_beside(log: &Path) -> Result<PathBuf, PlotError> {
    let path = log.with_file_name("distance.svg");
    let source = match fs::read_to_string(&path) {
        Ok(text) if text.contains(LABEL) => return Ok(path),
        Ok(_) => io::Error::new(
            io::ErrorKind::AlreadyExists,
            "it is there already and is another figure",
        ),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(path),
        Err(error) => error,
    };
    Err(PlotError::Write { path, source })
}

/// Draws the logs' distances from the path over time into the SVG file `out`, with the theorem's bound where it applies, the
/// changes of the vehicle and the planned faults.
///
/// Each column of pixels shows the smallest and the largest of its samples: no peak is lost.
///
/// Returns a line for each flight that went other than as planned; the figure has it below its title.
///
/// # Errors
/// [`PlotError`].
pub fn distance(logs: &[PathBuf], span: Span, out: &Path) -> Result<Vec<String>, PlotError> {
    let curves = curve::read_all(logs, span)?;
    let inputs: Vec<_> = logs.iter().flat_map(|log| files_of_log(log)).collect();
    result_file::write(out, draw(&curves, span), &inputs).map_err(|source| PlotError::Write {
        path: out.to_owned(),
        source,
    })?;
    Ok(misfortunes(&curves))
}

/// Returns a line for each flight that went other than as planned, with its name if there are several flights.
fn misfortunes(curves: &[Curve]) -> Vec<String> {
    let unlucky = curves.iter().filter(|curve| !curve.misfortunes.is_empty());
    let lines = unlucky.map(|curve| match curves {
        [_] => curve.misfortunes.clone(),
        _ => format!("{}: {}", curve.label, curve.misfortunes),
    });
    lines.collect()
}

fn draw(curves: &[Curve], span: Span) -> String {
    let plots: Vec<Plot> = curves
        .iter()
        .zip(CURVE_COLORS.into_iter().cycle())
        .flat_map(|(curve, color)| lines(curve, color, curves.len() > 1))
        .collect();
    let longest = curves
        .iter()
        .map(|curve| curve.scenario.duration)
        .fold(0.0, f64::max);
    let [from, to] = span.within(longest);
    let mut layout = Layout::auto_from_plots(&plots)
        .with_width(WIDTH)
        .with_height(HEIGHT)
        .with_x_label("time, s")
        .with_y_label(if curves.iter().all(|curve| curve.source == StateSource::Truth) {
            format!("{LABEL}, m")
        } else {
            format!("{LABEL}, as estimated, m")
        })
        .with_x_axis_min(from)
        .with_x_axis_max(to)
        .with_log_y()
        .with_y_tick_format(TickFormat::Custom(Arc::new(|value| value.to_string())))
        .with_legend_position(legend::free_position(
            curves
                .iter()
                .flat_map(|curve| &curve.stretches)
                .map(Vec::as_slice),
            true,
        ));
    if let Some(title) = title(curves) {
        layout = layout.with_title(title);
    }
    let unlucky = misfortunes(curves);
    if !unlucky.is_empty() {
        layout = layout
            .with_subtitle(unlucky.join("; "))
            .with_subtitle_wrap(SUBTITLE);
    }
    for region in marks::fault_regions(curves, [from, to]) {
        layout = layout.with_shaded_region(region);
    }
    let marked = [
        marks::bound_lines(curves),
        marks::change_lines(curves, [from, to]),
        marks::fault_lines(curves, [from, to]),
    ];
    for line in marked.into_iter().flatten() {
        layout = layout.with_reference_line(line);
    }
    kuva::render_to_svg(plots, layout)
}

/// Returns the lines of a curve, one for each stretch; only the first has a legend entry.
fn lines(curve: &Curve, color: &str, is_one_of_many: bool) -> Vec<Plot> {
    let stretches = curve.stretches.iter().enumerate();
    stretches
        .map(|(index, stretch)| {
            let line = LinePlot::new()
                .with_data(stretch.iter().copied())
                .with_color(color)
                .with_stroke_width(1.3);
            Plot::Line(if is_one_of_many && index == 0 {
                line.with_legend(&curve.label)
            } else {
                line
            })
        })
        .collect()
}

/// Returns the description of the scenarios if it is the same for all.
fn title(curves: &[Curve]) -> Option<&str> {
    let mut descriptions = curves.iter().map(|curve| curve.scenario.description.as_str());
    let first = descriptions.next().filter(|text| !text.is_empty())?;
    descriptions.all(|text| text == first).then_some(first)
}

#[cfg(test)]
mod tests;
