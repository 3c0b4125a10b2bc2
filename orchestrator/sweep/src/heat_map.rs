//! Heat maps: the median of a result in each cell of the plane of two varied values, on one colour scale for all entries.
//!
//! Cells without a flight are hatched. Numbers are black or white, whichever has the higher contrast.

use std::fmt::Write;

use report::text_table::escaped;
use statistics::quantile::{median, sorted};

use crate::definition::Map;
use crate::parts::Parts;
use crate::report::{Shown, digits, with_unit};

/// Number of ranges of an axis with many values.
const RANGES: usize = 8;

/// Size of the plane and its margins, in pixels.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 330.0;
const LEFT: f64 = 130.0;
const TOP: f64 = 34.0;
const BELOW: f64 = 104.0;
const RIGHT: f64 = 130.0;

/// Font size, and the approximate width of a letter.
const LETTER: f64 = 12.0;
const LETTER_WIDTH: f64 = 0.6 * LETTER;

/// Colours from the lowest to the highest value (`ColorBrewer`'s `Blues`), distinct in grey as well.
const COLORS: [[f64; 3]; 5] = [
    [247.0, 251.0, 255.0],
    [198.0, 219.0, 239.0],
    [107.0, 174.0, 214.0],
    [33.0, 113.0, 181.0],
    [8.0, 48.0, 107.0],
];

/// Minimum ratio of the highest to the lowest value for a logarithmic scale.
const LOGARITHMIC: f64 = 20.0;

/// Medians in the cells of a plane.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    columns: Parts,
    rows: Parts,
    /// By row from below, then by column; `None` without a flight.
    medians: Vec<Vec<Option<f64>>>,
}

impl Grid {
    /// Computes the medians of values over two others.
    pub(crate) fn new(xs: &[f64], ys: &[f64], shown: &Shown, values: &[f64]) -> Self {
        let (columns, rows) = (Parts::new(xs, RANGES), Parts::new(ys, RANGES));
        let mut cells = vec![vec![Vec::new(); columns.ranges().len()]; rows.ranges().len()];
        for ((x, y), value) in xs.iter().zip(ys).zip(values) {
            if value.is_finite() {
                cells[rows.index(*y)][columns.index(*x)].push(shown.factor * value);
            }
        }
        let medians = cells
            .into_iter()
            .map(|row| row.into_iter().map(|cell| median(&sorted(cell))).collect());
        Self {
            medians: medians.collect(),
            columns,
            rows,
        }
    }
}

/// Colour scale, shared by all maps of one result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    low: f64,
    high: f64,
}

impl Scale {
    /// Returns the scale that spans all values of some maps; `None` without a value.
    pub(crate) fn spanning<'a>(grids: impl IntoIterator<Item = &'a Grid>) -> Option<Self> {
        let values = grids
            .into_iter()
            .flat_map(|grid| grid.medians.iter().flatten().flatten().copied());
        values.fold(None, |scale: Option<Self>, value| {
            let Self { low, high } = scale.unwrap_or(Self {
                low: value,
                high: value,
            });
            Some(Self {
                low: low.min(value),
                high: high.max(value),
            })
        })
    }

    fn is_logarithmic(self) -> bool {
        self.low > 0.0 && self.high / self.low >= LOGARITHMIC
    }

    /// Returns the position of a value on the scale, from 0 to 1.
    fn share(self, value: f64) -> f64 {
        let [low, high, value] = [self.low, self.high, value].map(|value| {
            if self.is_logarithmic() {
                libm::log(value)
            } else {
                value
            }
        });
        if high > low {
            ((value - low) / (high - low)).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    /// Returns the value at a position from 0 to 1.
    fn value(self, share: f64) -> f64 {
        if self.is_logarithmic() {
            self.low * libm::pow(self.high / self.low, share)
        } else {
            self.low + share * (self.high - self.low)
        }
    }
}

/// Returns the colour at a position on the scale, and the text colour for it.
fn colors(share: f64) -> (String, &'static str) {
    let position = share * (COLORS.len() - 1) as f64;
    let below = (position.floor() as usize).min(COLORS.len() - 2);
    let part = position - below as f64;
    let mixed: [f64; 3] = std::array::from_fn(|channel| {
        COLORS[below][channel] + part * (COLORS[below + 1][channel] - COLORS[below][channel])
    });
    let [red, green, blue] = mixed.map(|channel| channel.round() as u8);
    let letters = if contrast(mixed, 0.0) >= contrast(mixed, 255.0) {
        "#000"
    } else {
        "#fff"
    };
    (format!("#{red:02x}{green:02x}{blue:02x}"), letters)
}

/// Returns the contrast of a colour with a grey, by WCAG 2.
fn contrast(color: [f64; 3], grey: f64) -> f64 {
    let linear = |channel: f64| {
        let share = channel / 255.0;
        if share <= 0.04045 {
            share / 12.92
        } else {
            libm::pow((share + 0.055) / 1.055, 2.4)
        }
    };
    let luminance =
        |[red, green, blue]: [f64; 3]| 0.2126 * linear(red) + 0.7152 * linear(green) + 0.0722 * linear(blue);
    let (one, other) = (luminance(color) + 0.05, luminance([grey; 3]) + 0.05);
    one.max(other) / one.min(other)
}

/// Draws a map as SVG.
pub(crate) fn drawing(map: &Map, title: &str, law: &str, grid: &Grid, scale: Scale) -> String {
    let (width, height) = (LEFT + WIDTH + RIGHT, TOP + HEIGHT + BELOW);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"{LETTER}\">\n\
         <defs><pattern id=\"missing\" width=\"6\" height=\"6\" patternUnits=\"userSpaceOnUse\">\
         <path d=\"M0 6L6 0\" stroke=\"#999\" stroke-width=\"1\"/></pattern></defs>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n"
    );
    let heading = format!("{title}: {law}");
    text(
        &mut svg,
        [LEFT + WIDTH / 2.0, TOP - 12.0],
        "middle",
        None,
        "#000",
        &heading,
    );
    draw_cells(&mut svg, grid, scale);
    draw_axes(&mut svg, map, grid);
    draw_scale(&mut svg, scale);
    svg + "</svg>\n"
}

fn draw_cells(svg: &mut String, grid: &Grid, scale: Scale) {
    let (width, height) = cell_size(grid);
    for (row, medians) in grid.medians.iter().enumerate() {
        for (column, median) in medians.iter().enumerate() {
            let (x, y) = (
                LEFT + column as f64 * width,
                TOP + HEIGHT - (row + 1) as f64 * height,
            );
            let (fill, letters) = match median {
                Some(median) => colors(scale.share(*median)),
                None => ("url(#missing)".to_owned(), "#000"),
            };
            rectangle(svg, [x, y, width, height], &fill, "#fff");
            if let Some(median) = median {
                let at = [x + width / 2.0, y + height / 2.0 + LETTER / 3.0];
                text(svg, at, "middle", None, letters, &digits(*median));
            }
        }
    }
    rectangle(svg, [LEFT, TOP, WIDTH, HEIGHT], "none", "#000");
}

fn draw_axes(svg: &mut String, map: &Map, grid: &Grid) {
    let (width, height) = cell_size(grid);
    let longest = grid.columns.labels().map(|label| label.chars().count()).max();
    let turns = longest.unwrap_or_default() as f64 * LETTER_WIDTH > width;
    for (column, label) in grid.columns.labels().enumerate() {
        let at = [LEFT + (column as f64 + 0.5) * width, TOP + HEIGHT + LETTER + 4.0];
        // Long labels are turned so that they do not overlap.
        let (anchor, turn) = if turns {
            ("end", Some(-35.0))
        } else {
            ("middle", None)
        };
        text(svg, at, anchor, turn, "#000", &label);
    }
    for (row, label) in grid.rows.labels().enumerate() {
        let at = [
            LEFT - 6.0,
            TOP + HEIGHT - (row as f64 + 0.5) * height + LETTER / 3.0,
        ];
        text(svg, at, "end", None, "#000", &label);
    }
    text(
        svg,
        [LEFT + WIDTH / 2.0, TOP + HEIGHT + BELOW - 8.0],
        "middle",
        None,
        "#000",
        &with_unit(&map.x),
    );
    text(
        svg,
        [16.0, TOP + HEIGHT / 2.0],
        "middle",
        Some(-90.0),
        "#000",
        &with_unit(&map.y),
    );
}

/// Draws the colour bar at the right, with five values and the meaning of hatching.
fn draw_scale(svg: &mut String, scale: Scale) {
    const STEPS: u32 = 50;
    let (x, width) = (LEFT + WIDTH + 20.0, 18.0);
    let height = HEIGHT / f64::from(STEPS);
    for step in 0..STEPS {
        let (fill, _) = colors((f64::from(step) + 0.5) / f64::from(STEPS));
        let y = TOP + HEIGHT - f64::from(step + 1) * height;
        rectangle(svg, [x, y, width, height], &fill, &fill);
    }
    for quarter in 0..=4_u32 {
        let share = f64::from(quarter) / 4.0;
        let at = [x + width + 5.0, TOP + HEIGHT * (1.0 - share) + LETTER / 3.0];
        text(svg, at, "start", None, "#000", &digits(scale.value(share)));
    }
    let y = TOP + HEIGHT + 14.0;
    rectangle(svg, [x, y, width, LETTER], "url(#missing)", "#000");
    text(
        svg,
        [x + width + 5.0, y + LETTER - 2.0],
        "start",
        None,
        "#000",
        "no value",
    );
}

fn cell_size(grid: &Grid) -> (f64, f64) {
    (
        WIDTH / grid.columns.ranges().len() as f64,
        HEIGHT / grid.rows.ranges().len() as f64,
    )
}

fn rectangle(svg: &mut String, [x, y, width, height]: [f64; 4], fill: &str, stroke: &str) {
    writeln!(
        svg,
        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{fill}\" stroke=\"{stroke}\"/>"
    )
    .expect("a String takes all");
}

fn text(svg: &mut String, [x, y]: [f64; 2], anchor: &str, turn: Option<f64>, fill: &str, text: &str) {
    let turn = turn.map_or_else(String::new, |angle| {
        format!(" transform=\"rotate({angle} {x:.1} {y:.1})\"")
    });
    writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{fill}\"{turn}>{}</text>",
        escaped(text)
    )
    .expect("a String takes all");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> Map {
        toml::from_str("x = \"vehicle.mass\"\ny = \"vehicle.drag.0\"\nvalue = \"rmse\"\n").unwrap()
    }

    fn shown() -> Shown {
        Shown {
            name: "rmse".to_owned(),
            title: "RMS distance, cm".to_owned(),
            factor: 100.0,
        }
    }

    fn fills(svg: &str) -> Vec<&str> {
        let cells = svg
            .lines()
            .filter(|line| line.starts_with("<rect") && line.contains("stroke=\"#fff\""));
        cells
            .map(|line| line.split("fill=\"").nth(1).unwrap().split('"').next().unwrap())
            .collect()
    }

    /// The first law has 1, 2 and 3 cm and a part without a flight, the other 3 cm everywhere: equal values, equal colours.
    #[test]
    fn equal_values_of_different_laws_have_one_colour_and_missing_ones_are_hatched() {
        let (xs, ys) = ([0.1, 0.2, 0.1, 0.2], [0.0, 0.0, 1.0, 1.0]);
        let one = Grid::new(&xs, &ys, &shown(), &[0.01, 0.02, f64::NAN, 0.03]);
        let other = Grid::new(&xs, &ys, &shown(), &[0.03; 4]);
        let scale = Scale::spanning([&one, &other]).unwrap();
        assert_eq!(scale, Scale { low: 1.0, high: 3.0 });
        let one = drawing(&map(), "RMS distance, cm", "paper", &one, scale);
        let other = drawing(&map(), "RMS distance, cm", "indi", &other, scale);
        assert_eq!(fills(&one), ["#f7fbff", "#6baed6", "url(#missing)", "#08306b"]);
        assert_eq!(fills(&other), ["#08306b"; 4]);
        for label in [
            ">vehicle.mass, kg<",
            ">vehicle.drag.0, N s/m<",
            "RMS distance, cm: paper",
            "no value",
            ">1.5<",
            ">2.5<",
        ] {
            assert!(one.contains(label), "{label}");
        }
    }

    /// The least contrast of text by WCAG 2.1, AA.
    #[test]
    fn numbers_are_read_on_every_colour() {
        for step in 0..=100 {
            let (fill, letters) = colors(f64::from(step) / 100.0);
            let channel = |at: usize| f64::from(u8::from_str_radix(&fill[at..at + 2], 16).unwrap());
            let grey = if letters == "#000" { 0.0 } else { 255.0 };
            let contrast = contrast([channel(1), channel(3), channel(5)], grey);
            assert!(contrast >= 4.5, "{fill} {letters}: {contrast}");
        }
    }

    #[test]
    fn long_labels_are_turned_and_wide_ranges_logarithmic() {
        let xs: Vec<f64> = (0..100).map(|index| 0.1 + 1e-4 * f64::from(index)).collect();
        let ys = vec![1.0; 100];
        let values: Vec<f64> = (0..100)
            .map(|index| libm::pow(10.0, f64::from(index) / 33.0 - 2.0))
            .collect();
        let grid = Grid::new(&xs, &ys, &shown(), &values);
        let scale = Scale::spanning([&grid]).unwrap();
        assert!(scale.is_logarithmic());
        assert!((scale.share(scale.value(0.25)) - 0.25).abs() < 1e-12);
        let svg = drawing(&map(), "RMS distance, cm", "paper", &grid, scale);
        assert_eq!(svg.matches("rotate(-35 ").count(), RANGES);
    }
}
