//! Stacked panels of curves as SVG, with text as text elements.

use std::sync::Arc;

use kuva::backend::svg::SvgBackend;
use kuva::prelude::{Figure, Layout, LinePlot, Plot, ReferenceLine, TickFormat};

use report::plot::legend;
use report::plot::{CHANGE_COLOR, CURVE_COLORS, FLOOR, WIDTH};

const PANEL_HEIGHT: f64 = 250.0;

/// A curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Name in the legend, shown if there are several curves.
    pub label: &'static str,
    /// Points of the curve.
    pub points: Vec<(f64, f64)>,
}

/// Axes with their curves and marks.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The label of the horizontal axis.
    pub x_label: &'static str,
    /// The label of the vertical axis.
    pub y_label: &'static str,
    /// The scale of the drawing.
    pub scale: Scale,
    /// The curves.
    pub curves: Vec<Curve>,
    /// Times of events, with labels.
    pub marks: Vec<(f64, &'static str)>,
}

/// The scale of a panel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Linear.
    Linear,
    /// Logarithmic vertical axis.
    Logarithmic,
    /// Linear, with equal scales in both directions: a map.
    Map,
}

/// Draws panels below each other.
#[must_use]
pub fn draw(title: &str, panels: &[Panel]) -> String {
    let drawn: Vec<(Vec<Plot>, Layout)> = panels.iter().map(Panel::draw).collect();
    let (plots, layouts): (Vec<_>, Vec<_>) = drawn.into_iter().unzip();
    let is_map = panels.iter().any(|panel| panel.scale == Scale::Map);
    let height = if is_map { WIDTH * 0.62 } else { PANEL_HEIGHT };
    let figure = Figure::new(panels.len(), 1)
        .with_title(title)
        .with_title_size(15)
        .with_cell_size(WIDTH, height)
        .with_plots(plots)
        .with_layouts(layouts);
    SvgBackend::new().render_scene(&figure.render())
}

impl Panel {
    fn draw(&self) -> (Vec<Plot>, Layout) {
        let is_one_of_many = self.curves.len() > 1;
        let colored = self.curves.iter().zip(CURVE_COLORS.into_iter().cycle());
        let plots: Vec<Plot> = colored
            .map(|(curve, color)| {
                let line = LinePlot::new()
                    .with_data(self.visible(&curve.points))
                    .with_color(color)
                    .with_stroke_width(1.2);
                Plot::Line(if is_one_of_many {
                    line.with_legend(curve.label)
                } else {
                    line
                })
            })
            .collect();
        let layout = self.layout(&plots);
        (plots, layout)
    }

    fn layout(&self, plots: &[Plot]) -> Layout {
        let mut layout = Layout::auto_from_plots(plots)
            .with_x_label(self.x_label)
            .with_y_label(self.y_label)
            .with_legend_position(legend::free_position(
                self.curves.iter().map(|curve| curve.points.as_slice()),
                self.scale == Scale::Logarithmic,
            ));
        layout = match self.scale {
            Scale::Map => layout.with_equal_aspect(),
            Scale::Linear => layout.with_x_axis_min(0.0),
            Scale::Logarithmic => layout
                .with_x_axis_min(0.0)
                .with_log_y()
                .with_y_tick_format(TickFormat::Custom(Arc::new(|value| value.to_string()))),
        };
        for (time, what) in &self.marks {
            let line = ReferenceLine::vertical(*time)
                .with_color(CHANGE_COLOR)
                .with_dasharray("3 3")
                .with_label(*what);
            layout = layout.with_reference_line(line);
        }
        layout
    }

    /// Clamps the points to what the axes can show: a logarithmic axis has no zero.
    fn visible(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let floor = if self.scale == Scale::Logarithmic {
            FLOOR
        } else {
            f64::NEG_INFINITY
        };
        points.iter().map(|&(x, y)| (x, y.max(floor))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawing_names_its_axes_curves_and_marks() {
        let curve = |label| Curve {
            label,
            points: vec![(0.0, 0.0), (1.0, 0.5), (2.0, 0.25)],
        };
        let panel = |y_label, scale| Panel {
            x_label: "time, s",
            y_label,
            scale,
            curves: vec![curve("ours"), curve("theirs")],
            marks: vec![(1.0, "ts")],
        };
        let panels = [
            panel("‖z1‖, m", Scale::Logarithmic),
            panel("m̂, kg", Scale::Linear),
        ];
        let svg = draw("Fig. 0", &panels);
        for text in ["Fig. 0", "time, s", "‖z1‖, m", "m̂, kg", "ours", "theirs", "ts"] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "no point is lost");
    }
}
