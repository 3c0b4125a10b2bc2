//! The last minute as sparklines.

use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Style;
use ratatui::text::Line;
use ratatui::widgets::{Sparkline, Widget};

use super::super::history::{History, Trend};
use super::rule;

/// Bar heights within one row.
const LEVELS: u16 = 8;

/// Maximum rows of a sparkline.
const MAX_ROWS: u16 = 4;

/// Width from which the scale is shown, columns.
const WITH_SCALE: u16 = 60;

/// Returns the rows of the section for sparklines of `rows` rows each.
pub(super) fn height(rows: u16) -> u16 {
    1 + Trend::ALL.len() as u16 * rows.clamp(1, MAX_ROWS)
}

/// Draws all trends, as tall as the area permits.
pub(super) fn draw(history: &History, area: Rect, buffer: &mut Buffer) {
    if area.height == 0 {
        return;
    }
    rule("last minute", area.width).render(area, buffer);
    let rows = (area.height - 1) / Trend::ALL.len() as u16;
    for (place, trend) in (0..).zip(Trend::ALL) {
        let y = area.y + 1 + place * rows;
        draw_one(
            history,
            trend,
            Rect {
                y,
                height: rows,
                ..area
            },
            buffer,
        );
    }
}

fn draw_one(history: &History, trend: Trend, area: Rect, buffer: &mut Buffer) {
    let scale_width = if area.width < WITH_SCALE { 0 } else { 20 };
    let [name, value, _, line, scale] = Layout::horizontal([
        Constraint::Length(9),
        Constraint::Length(12),
        Constraint::Length(2),
        Constraint::Fill(1),
        Constraint::Length(scale_width),
    ])
    .areas(area);
    let (symbol, unit, begins_at_zero) = about(trend);
    Line::raw(format!(" {symbol}")).render(name, buffer);
    let newest = history.newest(trend);
    let text = newest.map_or_else(|| "–".to_owned(), |newest| format!("{newest:.4} {unit}"));
    Line::raw(text).right_aligned().render(value, buffer);

    let columns = history.columns(trend, line.width.into());
    let Some((low, high)) = range(&columns) else {
        return;
    };
    let low = if begins_at_zero { 0.0 } else { low };
    let top = LEVELS * area.height;
    let level = |value: f64| level(value, low, high, top);
    Sparkline::default()
        .data(columns.iter().map(|value| value.map(level)))
        .max(top.into())
        .style(Style::new().cyan())
        .render(line, buffer);
    Line::styled(format!("  {low:.4}…{high:.4}"), Style::new().dim()).render(scale, buffer);
}

/// Returns symbol and unit of a trend, and whether its scale begins at zero: a distance is judged by its size, an
/// estimate by its change.
fn about(trend: Trend) -> (&'static str, &'static str, bool) {
    match trend {
        Trend::PositionError => ("distance", "m", true),
        Trend::MassEstimate => ("m̂", "kg", false),
        Trend::DisturbanceEstimate => ("‖b̂‖", "m/s²", false),
    }
}

fn range(columns: &[Option<f64>]) -> Option<(f64, f64)> {
    let values = columns.iter().flatten().copied();
    let low = values.clone().reduce(f64::min)?;
    Some((low, values.reduce(f64::max)?))
}

/// Returns the height of a bar out of `top`: at least one, since an empty bar means no value.
fn level(value: f64, low: f64, high: f64, top: u16) -> u64 {
    let part = if high > low {
        (value - low) / (high - low)
    } else {
        0.0
    };
    1 + (part * f64::from(top - 1)).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_value_is_seen_and_none_is_too_tall(low in -1e3..1e3_f64, span in 0.0..1e3_f64, part in 0.0..=1.0_f64, rows in 1..=MAX_ROWS) {
            let top = rows * LEVELS;
            let level = level(low + part * span, low, low + span, top);
            prop_assert!((1..=u64::from(top)).contains(&level), "{}", level);
        }
    }
}
