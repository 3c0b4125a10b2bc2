//! The parts of pages about flights, which pages of other crates use too.

/// Drawings over time: [uPlot](https://github.com/leeoniya/uPlot), version 1.6.32 (`uplot.LICENSE`).
pub const UPLOT: &str = include_str!("assets/uplot.js");

/// Style of [`UPLOT`].
pub const UPLOT_STYLE: &str = include_str!("assets/uplot.css");

/// Style of all pages.
pub const STYLE: &str = include_str!("assets/report.css");

/// Colours, elements, numbers in words, axes.
pub const COMMON: &str = include_str!("assets/common.js");

/// The 3D view.
pub const ORBIT: &str = include_str!("assets/orbit.js");

/// Returns a page with its parts in place of its marks `{{name}}`. A part is not looked at again: a mark in it is text like
/// any other.
///
/// # Panics
/// If a mark does not end.
#[must_use]
pub fn filled_in<'a>(page: &str, part: impl Fn(&str) -> &'a str) -> String {
    let mut html = String::new();
    let mut pieces = page.split("{{");
    html += pieces.next().unwrap_or_default();
    for piece in pieces {
        let (name, rest) = piece.split_once("}}").expect("a mark ends");
        html += part(name);
        html += rest;
    }
    html
}

/// Returns JSON that can stand in a script element: no text in it can end that.
#[must_use]
pub fn escaped_json(json: &str) -> String {
    json.replace('<', "\\u003c")
}

/// Returns text as HTML shows it.
#[must_use]
pub fn escaped_text(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}
