//! Scripts and styles of the pages about flights, shared with the pages of other crates.

/// Time-series plots: [uPlot](https://github.com/leeoniya/uPlot), version 1.6.32 (`uplot.LICENSE`).
pub const UPLOT: &str = include_str!("assets/uplot.js");

/// Style of [`UPLOT`].
pub const UPLOT_STYLE: &str = include_str!("assets/uplot.css");

/// Style of all pages.
pub const STYLE: &str = include_str!("assets/report.css");

/// Shared script: colours, elements, number formatting, axes.
pub const COMMON: &str = include_str!("assets/common.js");

/// The 3D view.
pub const ORBIT: &str = include_str!("assets/orbit.js");

/// Returns a page with its placeholders `{{name}}` replaced. Replacements are not expanded: a placeholder in one stays text.
///
/// # Panics
/// If a placeholder is not closed.
#[must_use]
pub fn filled_in<'a>(page: &str, part: impl Fn(&str) -> &'a str) -> String {
    let mut html = String::new();
    let mut pieces = page.split("{{");
    html += pieces.next().unwrap_or_default();
    for piece in pieces {
        let (name, rest) = piece.split_once("}}").expect("a placeholder is closed");
        html += part(name);
        html += rest;
    }
    html
}

/// Returns JSON that is safe inside a script element: no text in it can close the element.
#[must_use]
pub fn escaped_json(json: &str) -> String {
    json.replace('<', "\\u003c")
}

/// Escapes text for HTML.
#[must_use]
pub fn escaped_text(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}
