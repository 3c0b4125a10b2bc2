//! Results of a sweep as a web page: one file without scripts.

use kuva::backend::svg::SvgBackend;
use kuva::prelude::{Figure, Layout as DrawingLayout, LegendPosition, LinePlot, Plot, ScatterPlot};
use report::plot::COLORS;
use report::text_table::escaped;
use statistics::quantile::sorted;

use crate::definition::{Map, file_name_part};
use crate::expression::Expression;
use crate::heat_map::{self, Grid, Scale};
use crate::prepared::Prepared;
use crate::report::{EntryResults, Report, Results, with_unit};

/// Maximum number of points of a drawing; larger sets are thinned.
const POINTS: usize = 3000;

/// Maximum number of varied values with a scatter plot.
const SCATTERED: usize = 8;

const STYLE: &str = "
:root { color-scheme: light dark; --line: #8884; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 90rem; margin: 2rem auto; padding: 0 1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.85rem; font-variant-numeric: tabular-nums; }
th, td { border: 1px solid var(--line); padding: 0.25rem 0.6rem; text-align: right; }
th:first-child, td:first-child { text-align: left; }
svg { max-width: 100%; height: auto; background: #fff; }
pre { overflow-x: auto; border: 1px solid var(--line); padding: 0.5rem; }
";

/// Returns the page.
#[must_use]
pub(crate) fn page(report: &Report, prepared: &Prepared, results: &Results) -> String {
    let plan = &prepared.plan;
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>Gerono: sweep</title>\n<style>{STYLE}</style>\n<h1>{} samples of {}</h1>\n\
         <p>Intervals hold for independent samples only and are not given for others. Every row can be repeated: \
         <code>gerono sweep fly FOLDER --sample I</code>.</p>\n",
        plan.samples,
        escaped(
            &plan
                .source
                .scenario_path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
        ),
    );
    for (name, drawing) in maps(prepared, results) {
        html += &format!(
            "<h2>{}</h2>\n<p>{drawing}</p>\n",
            escaped(name.trim_end_matches(".svg"))
        );
    }
    if let Some(drawing) = distances(prepared, results) {
        html += &format!(
            "<h2>{}</h2>\n<p>{drawing}</p>\n",
            escaped(&results.shown[0].title)
        );
    }
    for table in report.tables() {
        html += &table.html();
    }
    html += "<h2>Over the varied values</h2>\n";
    for drawing in scatters(prepared, results) {
        html += &format!("<p>{drawing}</p>\n");
    }
    html + &format!(
        "<h2>The sweep</h2>\n<pre>{}</pre>\n</html>\n",
        escaped(&plan.source.text)
    )
}

/// Returns whether positive values span a range, as a logarithmic axis requires.
fn spans(values: impl Iterator<Item = f64>) -> bool {
    let range = values.fold([f64::INFINITY, 0.0_f64], |[low, high], value| {
        [low.min(value), high.max(value)]
    });
    range[0] > 0.0 && range[1] > 1.01 * range[0]
}

/// Returns whether numbers have more than one value.
fn varies(values: &[f64]) -> bool {
    values.iter().any(|value| *value != values[0])
}

fn figure(plots: Vec<Plot>, layout: DrawingLayout) -> String {
    let figure = Figure::new(1, 1)
        .with_cell_size(860.0, 420.0)
        .with_plots(vec![plots])
        .with_layouts(vec![layout]);
    SvgBackend::new().render_scene(&figure.render())
}

/// Keeps every n-th value, so that `laws` such sets have at most about [`POINTS`] points.
fn thinned<T>(values: Vec<T>, laws: usize) -> Vec<T> {
    let step = (laws * values.len()).div_ceil(POINTS).max(1);
    values.into_iter().step_by(step).collect()
}

/// Draws the cumulative distribution of the result by which the entries are ranked.
fn distances(prepared: &Prepared, results: &Results) -> Option<String> {
    let factor = results.shown[0].factor;
    let mut plots = Vec::new();
    for (index, (entry, of_entry)) in prepared.plan.entries.iter().zip(&results.entries).enumerate() {
        let numbers = sorted(of_entry.numbers[0].iter().copied());
        if numbers.is_empty() {
            continue;
        }
        let flown = of_entry.is_flown.iter().filter(|flown| **flown).count();
        #[expect(clippy::cast_precision_loss, reason = "for a drawing")]
        let points = numbers
            .iter()
            .enumerate()
            .map(|(rank, value)| (factor * value, (rank + 1) as f64 / flown as f64));
        let plot = LinePlot::new()
            .with_data(thinned(
                points.filter(|(value, _)| *value > 0.0).collect::<Vec<_>>(),
                prepared.plan.entries.len(),
            ))
            .with_color(COLORS[index % COLORS.len()])
            .with_legend(entry.name.clone());
        plots.push(Plot::from(plot));
    }
    let all = results
        .entries
        .iter()
        .flat_map(|entry| entry.numbers[0].iter().copied());
    if plots.is_empty() || !spans(all.filter(|value| !value.is_nan())) {
        return None;
    }
    let layout = DrawingLayout::auto_from_plots(&plots)
        .with_log_x()
        .with_legend_position(LegendPosition::OutsideRightTop)
        .with_x_label(results.shown[0].title.clone())
        .with_y_label("cumulative share of flights");
    Some(figure(plots, layout))
}

/// Draws the result by which the entries are ranked over each varied number.
fn scatters(prepared: &Prepared, results: &Results) -> Vec<String> {
    let plan = &prepared.plan;
    let all = results
        .entries
        .iter()
        .flat_map(|entry| entry.numbers[0].iter().copied());
    if !spans(all.filter(|value| !value.is_nan())) {
        return Vec::new();
    }
    let varied = plan
        .columns()
        .enumerate()
        .filter(|(column, _)| varies(results.varied(*column)) && plan.is_drawn(*column));
    let drawn = varied.take(SCATTERED).map(|(column, name)| {
        let plots =
            plan.entries
                .iter()
                .zip(&results.entries)
                .enumerate()
                .map(|(index, (entry, of_entry))| {
                    let points = of_entry.varied[column].iter().copied().zip(
                        of_entry.numbers[0]
                            .iter()
                            .map(|value| results.shown[0].factor * value),
                    );
                    let points = points
                        .filter(|(x, y)| x.is_finite() && *y > 0.0)
                        .collect::<Vec<_>>();
                    let plot = ScatterPlot::new()
                        .with_data(thinned(points, plan.entries.len()))
                        .with_size(2.0)
                        .with_marker_opacity(0.6)
                        .with_color(COLORS[index % COLORS.len()])
                        .with_legend(entry.name.clone());
                    Plot::from(plot)
                });
        let plots: Vec<_> = plots.collect();
        let layout = DrawingLayout::auto_from_plots(&plots)
            .with_log_y()
            .with_legend_position(LegendPosition::OutsideRightTop)
            .with_x_label(with_unit(name))
            .with_y_label(results.shown[0].title.clone());
        figure(plots, layout)
    });
    drawn.collect()
}

/// Draws the maps of the sweep, with their file names.
#[must_use]
pub(crate) fn maps(prepared: &Prepared, results: &Results) -> Vec<(String, String)> {
    let maps = prepared.plan.source.definition.map.iter();
    maps.flat_map(|map| drawings_of(map, prepared, results).unwrap_or_default())
        .collect()
}

/// Draws a map for each entry, with its file name.
fn drawings_of(map: &Map, prepared: &Prepared, results: &Results) -> Option<Vec<(String, String)>> {
    let plan = &prepared.plan;
    let index = |name: &str| plan.columns().position(|column| column == name);
    let (x, y) = (index(&map.x)?, index(&map.y)?);
    let (xs, ys) = (results.varied(x), results.varied(y));
    // A law that overrides one of the two values has no map.
    let has_both = |entry: &EntryResults| !entry.varied[x].is_empty() && !entry.varied[y].is_empty();
    let criterion = prepared.layout.criteria().position(|name| name == map.value);
    let drawings: Vec<Option<String>> = if let Some(criterion) = criterion {
        let dots = |entry: &EntryResults| dots(map, xs, ys, &entry.criteria[criterion], &entry.is_flown);
        let drawing = |entry: &EntryResults| has_both(entry).then(|| dots(entry)).flatten();
        results.entries.iter().map(drawing).collect()
    } else {
        let index = results.shown.iter().position(|shown| shown.name == map.value)?;
        let shown = &results.shown[index];
        let grids = results
            .entries
            .iter()
            .map(|entry| Grid::new(xs, ys, shown, &entry.numbers[index]));
        let grids: Vec<Grid> = grids.collect();
        let scale = Scale::spanning(&grids)?;
        let entries = plan.entries.iter().zip(&grids);
        entries
            .zip(&results.entries)
            .map(|((entry, grid), of_entry)| {
                let drawing = || heat_map::drawing(map, &shown.title, &entry.name, grid, scale);
                has_both(of_entry).then(drawing)
            })
            .collect()
    };
    let [x, y] = [&map.x, &map.y].map(|axis| file_name_part(axis));
    let named =
        plan.entries.iter().zip(drawings).filter_map(|(entry, drawing)| {
            Some((format!("map-{x}-{y}-{}.svg", entry.file_name()), drawing?))
        });
    Some(named.collect())
}

/// Draws a criterion over two values with a dot for each sample.
fn dots(map: &Map, xs: &[f64], ys: &[f64], met: &[bool], is_flown: &[bool]) -> Option<String> {
    let is_log = map.log && spans(xs.iter().copied()) && spans(ys.iter().copied());
    // A logarithmic axis has only positive numbers.
    let fits = |x: f64, y: f64| x.is_finite() && y.is_finite() && (!is_log || x > 0.0 && y > 0.0);
    let mut plots = Vec::new();
    for (meets, color, words) in [(true, COLORS[0], "yes"), (false, COLORS[1], "no")] {
        let points = xs.iter().zip(ys).zip(met).zip(is_flown);
        let points = points.filter(|((_, met), flown)| **flown && **met == meets);
        let points: Vec<(f64, f64)> = points.map(|(((x, y), _), _)| (*x, *y)).collect();
        if !points.is_empty() {
            let plot = ScatterPlot::new()
                .with_data(thinned(points, 2))
                .with_size(2.5)
                .with_marker_opacity(0.7)
                .with_color(color)
                .with_legend(format!("{}: {words}", map.value));
            plots.push(Plot::from(plot));
        }
    }
    let [low, high] = [
        xs.iter().copied().reduce(f64::min)?,
        xs.iter().copied().reduce(f64::max)?,
    ];
    for (name, text) in &map.line {
        let line = Expression::parse(text, |name| (name == "x" || name == map.x).then_some(0)).ok()?;
        let at = |share: f64| {
            if is_log {
                libm::exp(libm::log(low) + share * libm::log(high / low))
            } else {
                low + share * (high - low)
            }
        };
        let points = (0..=100)
            .map(|step| at(f64::from(step) / 100.0))
            .map(|x| (x, line.value(&[x])));
        let plot = LinePlot::new()
            .with_data(points.filter(|&(x, y)| fits(x, y)).collect::<Vec<_>>())
            .with_color("#444444")
            .with_dashed()
            .with_legend(name.clone());
        plots.push(Plot::from(plot));
    }
    let points = map.point.iter().filter(|(_, [x, y])| fits(*x, *y));
    let (names, points): (Vec<_>, Vec<_>) = points.map(|(name, [x, y])| (name.clone(), (*x, *y))).unzip();
    if !points.is_empty() {
        let plot = ScatterPlot::new()
            .with_data(points)
            .with_labels(names)
            .with_repel_labels()
            .with_size(5.0)
            .with_color("#000000");
        plots.push(Plot::from(plot));
    }
    let mut layout = DrawingLayout::auto_from_plots(&plots)
        .with_legend_position(LegendPosition::OutsideRightTop)
        .with_x_label(with_unit(&map.x))
        .with_y_label(with_unit(&map.y));
    if is_log {
        layout = layout.with_log_x().with_log_y();
    }
    Some(figure(plots, layout))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_varies_also_if_its_first_and_last_samples_coincide() {
        assert!(varies(&[0.2, 0.1, 0.2]));
        assert!(!varies(&[0.2, 0.2]) && !varies(&[]));
    }

    #[test]
    fn a_map_with_logarithmic_axes_has_numbers_alone_whatever_is_drawn() {
        for xs in [[-0.1, 0.2, 0.3], [0.0, 0.2, 0.3], [0.1, 0.2, 0.3]] {
            let map: Map = toml::from_str(
                "x = 'a'\ny = 'b'\nvalue = 'survived'\nlog = true\nline = { bound = 'x - 0.2' }\n\
                 point = { here = [0.2, 0.2], below = [-1.0, 0.0] }",
            )
            .unwrap();
            let drawing = dots(&map, &xs, &[0.1, 0.2, 0.4], &[true, false, true], &[true; 3]).unwrap();
            assert!(!drawing.contains("NaN") && !drawing.contains("inf"), "{xs:?}");
            assert!(drawing.contains("bound") && drawing.contains("here"), "{xs:?}");
        }
    }
}
