//! The report as text for a terminal.

use std::fmt::{self, Display, Formatter};

use report::text_table::TextTable;

use super::ablation;
use super::column::Column;
use super::judgement::{FigureReport, ReportCell, ReproductionReport, RowReport, Verdict};
use super::observability::Observability;

/// Formats a value with about three significant digits; the spread over the seeds is larger than the rounding.
#[must_use]
pub fn number(value: Option<f64>) -> String {
    let Some(value) = value else {
        return "–".to_owned();
    };
    let size = value.abs();
    let decimals = if size < 0.995 {
        3
    } else if size < 9.95 {
        2
    } else if size < 99.5 {
        1
    } else {
        0
    };
    format!("{value:.decimals$}")
}

impl Display for ReproductionReport {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let seeds = match self.seeds.as_slice() {
            [first, .., last] => format!("seeds {first} to {last}"),
            [seed] => format!("seed {seed}"),
            [] => "no seeds".to_owned(),
        };
        writeln!(
            formatter,
            "{seeds}; seeds 1 to 6 were used for tuning and are not flown here"
        )?;
        for laboratory in &self.laboratories {
            writeln!(
                formatter,
                "{}: {}",
                laboratory.column.name(),
                laboratory.description
            )?;
            for setting in &laboratory.settings {
                writeln!(formatter, "    {setting}")?;
            }
        }
        writeln!(formatter, "\n{}", figures(&self.figures))?;
        for (cell, note) in notes(&self.figures) {
            writeln!(formatter, "{cell}: {note}")?;
        }
        if let Some(observability) = &self.observability {
            write!(formatter, "\n{observability}")?;
        }
        Ok(())
    }
}

/// Returns the table of the figures' numbers with their verdicts.
#[must_use]
pub fn figures(figures: &[FigureReport]) -> TextTable {
    let mut header = ["figure", "quantity", "paper", "bar"].map(str::to_owned).to_vec();
    header.extend(Column::ALL.map(|column| format!("{}\nmedian, worst", column.name())));
    let rows = figures
        .iter()
        .flat_map(|figure| figure.rows.iter().map(|row| row_cells(figure, row)));
    TextTable::new("", &header, rows)
}

fn row_cells(figure: &FigureReport, row: &RowReport) -> Vec<String> {
    let quantity = if row.unit.is_empty() {
        row.quantity.to_owned()
    } else {
        format!("{}, {}", row.quantity, row.unit)
    };
    let mut cells = vec![
        figure.figure.to_owned(),
        quantity,
        row.paper.to_owned(),
        row.bar.text(),
    ];
    cells.extend(row.cells.iter().map(cell_text));
    cells.resize(4 + Column::ALL.len(), String::new());
    cells
}

/// Formats median, worst value and verdict.
#[must_use]
pub fn cell_text(cell: &ReportCell) -> String {
    let verdict = cell.verdict.map_or("", Verdict::name);
    let values = if cell.values.len() > 1 {
        format!("{}, {}", number(cell.median), number(cell.worst))
    } else {
        number(cell.median)
    };
    format!("{values}  {verdict}").trim_end().to_owned()
}

/// Returns the notes on single cells, each with the cell's name.
#[must_use]
pub fn notes(figures: &[FigureReport]) -> Vec<(String, String)> {
    let mut notes = Vec::new();
    for figure in figures {
        for row in &figure.rows {
            for cell in row.cells.iter().filter(|cell| !cell.note.is_empty()) {
                let name = format!("{}, {}, {}", figure.figure, row.quantity, cell.column.name());
                notes.push((name, cell.note.clone()));
            }
        }
    }
    notes
}

impl Display for Observability {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            formatter,
            "Observability of the mass: RMSE of m̂ after 45 s, g, median over {} seeds\n{}",
            self.seeds.len(),
            observability(self)
        )
    }
}

/// Returns the observability table.
#[must_use]
pub fn observability(observability: &Observability) -> TextTable {
    let lines = observability_lines(observability).map(Vec::from);
    TextTable::new("", &observability_header(), lines)
}

/// Returns the header of the observability table.
#[must_use]
pub fn observability_header() -> [&'static str; 6] {
    [
        "flown",
        "prior, g",
        "wind bz, m/s²",
        "ours",
        "I&I observer",
        "frozen",
    ]
}

/// Returns the rows of the observability table.
pub fn observability_lines(observability: &Observability) -> impl Iterator<Item = [String; 6]> {
    observability.lines.iter().map(|line| {
        [
            line.curve.to_owned(),
            format!("{:+}", line.prior_error),
            format!("{:+}", line.wind),
            number(line.ours),
            number(line.observer),
            number(Some(line.frozen)),
        ]
    })
}

/// Returns the ablation table.
#[must_use]
pub fn ablation(lines: &[ablation::AblationRow]) -> TextTable {
    let header = [
        "design",
        "RMSE, worst seed, cm",
        "largest, cm",
        "peak after the coins, cm",
        "body rates, rad/s",
    ];
    let cells = |line: &ablation::AblationRow| {
        let errors = if line.note.is_empty() {
            format!("{}, {}", number(line.rmse), number(line.worst_rmse))
        } else {
            "lost".to_owned()
        };
        vec![
            line.variant.to_owned(),
            errors,
            number(line.largest),
            number(line.peak),
            number(line.rates),
        ]
    };
    TextTable::new("", &header, lines.iter().map(cells))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_mean_something() {
        for (value, text) in [
            (0.1234, "0.123"),
            (0.997, "1.00"),
            (1.234, "1.23"),
            (9.97, "10.0"),
            (38.61, "38.6"),
            (230.4, "230"),
            (-0.0921, "-0.092"),
        ] {
            assert_eq!(number(Some(value)), text);
        }
        assert_eq!(number(None), "–");
    }
}
