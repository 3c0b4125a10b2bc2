//! The grid as a web page: a heat map, performance against margin, and the tables. One file without scripts.

use std::sync::Arc;

use kuva::backend::svg::SvgBackend;
use kuva::prelude::{Figure, Layout, LinePlot, Plot, ScatterPlot, TickFormat};
use report::plot::COLORS;
use report::text_table::escaped;

use crate::front::MARGIN;
use crate::laws::ControlLaw;
use crate::report::{GridReport, centimetres};

/// Condition shown in the plot of performance against margin.
const PERFORMANCE: &str = "gusts";

const STYLE: &str = "
:root { color-scheme: light dark; --line: #8884; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 90rem; margin: 2rem auto; padding: 0 1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.85rem; font-variant-numeric: tabular-nums; }
th, td { border: 1px solid var(--line); padding: 0.25rem 0.6rem; text-align: right; }
th:first-child, td:first-child { text-align: left; }
td[style] { color: #111; }
svg { max-width: 100%; height: auto; background: #fff; }
code { white-space: pre-wrap; }
";

/// Returns the page.
#[must_use]
pub fn page(report: &GridReport) -> String {
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>Gerono: control laws compared</title>\n\
         <style>{STYLE}</style>\n<h1>Control laws compared</h1>\n<p>{}; {} seeds from {} on, the same for every law. \
         Conditions change the rig, not the parameters of estimator and controller.</p>\n",
        escaped(&report.base),
        report.seeds.len(),
        report.seeds.first().unwrap_or(&0),
    );
    html += &heat_map(report);
    if let Some(drawing) = pareto(report) {
        html += &format!("<h2>Performance against margin</h2>\n<p>{drawing}</p>\n");
    }
    for table in report.tables().iter().skip(1) {
        html += &table.html();
    }
    html += "<h2>Settings</h2>\n<ul>\n";
    for law in &report.laws {
        html += &settings(&law.name, &law.settings.join(" "));
    }
    for condition in &report.conditions {
        html += &settings(condition.name, &condition.settings.join(" "));
    }
    html + "</ul>\n</html>\n"
}

fn settings(name: &str, settings: &str) -> String {
    format!("<li>{}: <code>{}</code></li>\n", escaped(name), escaped(settings))
}

/// Returns the RMS of every law in every condition, coloured by the ratio to the best law of the condition.
fn heat_map(report: &GridReport) -> String {
    let mut html = "<h2>RMS distance from the path in steady state, cm</h2>\n<p>Median over the seeds. Green is the best law of the \
                    condition, red four times its distance or a flight lost.</p>\n<div class=\"wide\"><table>\n<tr><th>law</th>"
        .to_owned();
    for condition in &report.conditions {
        html += &format!("<th>{}</th>", escaped(condition.name));
    }
    html += "</tr>\n";
    for law in &report.laws {
        html += &format!("<tr><td>{}</td>", escaped(&law.name));
        for condition in &report.conditions {
            let cell = report.cell(&law.name, condition.name);
            let rms = cell.and_then(|cell| cell.rms);
            let lost = cell.map_or(0, |cell| cell.lost.len());
            let ratio = match (rms, report.best(condition.name)) {
                (Some(rms), Some(best)) if lost == 0 => rms / best,
                _ => f64::INFINITY,
            };
            let lost = if lost > 0 {
                format!(" ({lost} lost)")
            } else {
                String::new()
            };
            html += &format!(
                "<td style=\"background: {}\">{}{lost}</td>",
                color(ratio),
                centimetres(rms)
            );
        }
        html += "</tr>\n";
    }
    html + "</table></div>\n"
}

/// Returns the colour of a ratio, from green at 1 to red at 4, on a logarithmic scale.
fn color(ratio: f64) -> String {
    let share = (0.5 * libm::log2(ratio)).clamp(0.0, 1.0);
    format!("hsl({:.0} 70% 75%)", 130.0 * (1.0 - share))
}

/// Plots margin against distance with a point for each law. `None` if no law has both.
#[must_use]
pub fn pareto(report: &GridReport) -> Option<String> {
    let points = report.laws.iter().filter_map(|law| {
        let rms = report.cell(&law.name, PERFORMANCE)?.rms?;
        let margin = report.margin(&law.name, MARGIN)?.survived?;
        Some((law.name.clone(), (100.0 * rms, margin)))
    });
    let points: Vec<(String, (f64, f64))> = points.collect();
    if points.is_empty() {
        return None;
    }
    // Lines connect the bandwidth variants of a law.
    let families =
        points.chunk_by(|(one, _), (other, _)| ControlLaw::family(one) == ControlLaw::family(other));
    let lines = families
        .zip(COLORS.iter().cycle())
        .filter(|(family, _)| family.len() > 1);
    let lines = lines.map(|(family, color)| {
        let data: Vec<_> = family.iter().map(|(_, point)| *point).collect();
        Plot::from(LinePlot::new().with_data(data).with_color(*color))
    });
    let mut plots: Vec<_> = lines.collect();
    let (names, points): (Vec<_>, Vec<_>) = points.into_iter().unzip();
    let plot = ScatterPlot::new()
        .with_data(points)
        .with_color("#0072b2")
        .with_size(6.0)
        .with_labels(names)
        .with_repel_labels();
    plots.push(Plot::from(plot));
    let layout = Layout::auto_from_plots(&plots)
        .with_log_x()
        .with_x_tick_format(TickFormat::Custom(Arc::new(|value| value.to_string())))
        .with_x_label("RMS distance in gusts, cm: less is better")
        .with_y_label("delay survived, ms: more is better");
    let figure = Figure::new(1, 1)
        .with_cell_size(860.0, 420.0)
        .with_plots(vec![plots])
        .with_layouts(vec![layout]);
    Some(SvgBackend::new().render_scene(&figure.render()))
}
