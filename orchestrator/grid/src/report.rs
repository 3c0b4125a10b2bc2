//! Results of a grid as tables and as JSON.

use std::fmt::{Display, Formatter};

use report::text_table::TextTable;
use serde::Serialize;

use crate::conditions::{Condition, MARGINS};
use crate::flights::{Base, Cell};
use crate::front::{self, FrontPoint};
use crate::laws::ControlLaw;
use crate::margins::{Margin, SEEDS, SURVIVED};

/// Results of a grid: the content of `grid.json`.
#[derive(Clone, Debug, Serialize)]
pub struct GridReport {
    /// Name of the base scenario.
    pub base: String,
    /// Seeds of every cell.
    pub seeds: Vec<u64>,
    /// The laws with their settings.
    pub laws: Vec<ControlLaw>,
    /// The conditions with their settings.
    pub conditions: Vec<Condition>,
    /// The cells, laws first.
    pub cells: Vec<Cell>,
    /// The margins, laws first; empty if they were not searched.
    pub margins: Vec<Margin>,
    /// Performance and margin of every law; empty if margins were not searched.
    pub front: Vec<FrontPoint>,
}

impl GridReport {
    /// Makes the report.
    #[must_use]
    pub fn new(
        base: &Base,
        laws: &[ControlLaw],
        conditions: &[Condition],
        seeds: &[u64],
        cells: Vec<Cell>,
        margins: Vec<Margin>,
    ) -> Self {
        let mut report = Self {
            base: base.name(),
            seeds: seeds.to_vec(),
            laws: laws.to_vec(),
            conditions: conditions.to_vec(),
            cells,
            margins,
            front: Vec::new(),
        };
        let points = report.laws.iter().filter_map(|law| report.point(&law.name));
        report.front = front::compared(&points.collect::<Vec<_>>());
        report
    }

    /// Returns performance and margin of a law; `None` if margins were not searched.
    fn point(&self, law: &str) -> Option<FrontPoint> {
        let delay = self.margin(law, front::MARGIN)?.survived;
        let cells = self.cells.iter().filter(|cell| cell.law == law);
        let distances: Vec<_> = cells.clone().map(|cell| cell.rms).collect();
        Some(FrontPoint {
            law: law.to_owned(),
            rms: front::geometric_mean(&distances),
            lost: cells.map(|cell| cell.lost.len()).sum(),
            delay,
            beaten_by: Vec::new(),
        })
    }

    /// Returns the result of a law in a condition.
    #[must_use]
    pub fn cell(&self, law: &str, condition: &str) -> Option<&Cell> {
        let matches = |cell: &&Cell| cell.law == law && cell.condition == condition;
        self.cells.iter().find(matches)
    }

    /// Returns the margin of a law.
    #[must_use]
    pub fn margin(&self, law: &str, quantity: &str) -> Option<&Margin> {
        let matches = |margin: &&Margin| margin.law == law && margin.quantity == quantity;
        self.margins.iter().find(matches)
    }

    /// Returns the smallest median RMS distance of a condition, m.
    #[must_use]
    pub fn best(&self, condition: &str) -> Option<f64> {
        let cells = self.cells.iter().filter(|cell| cell.condition == condition);
        cells.filter_map(|cell| cell.rms).reduce(f64::min)
    }

    /// Returns the tables: errors, peaks, body rates, margins and front.
    #[must_use]
    pub fn tables(&self) -> Vec<TextTable> {
        let seeds = counted(self.seeds.len());
        let mut tables = vec![
            self.by_condition(
                &format!("RMS distance from the path in steady state, cm: median of {seeds}, and flights lost"),
                |cell| with_losses(centimetres(cell.rms), cell),
            ),
            self.by_condition(
                &format!("RMS distance from the path in steady state, cm: worst of {seeds}, and flights lost"),
                |cell| with_losses(centimetres(cell.worst_rms), cell),
            ),
            self.by_condition(
                &format!("Largest distance from the path in the transient before the steady state, cm: median of {seeds}"),
                |cell| centimetres(cell.peak),
            ),
            self.by_condition(
                &format!("RMS body rate in steady state, rad/s: median of {seeds}"),
                |cell| cell.body_rate.map_or_else(|| "–".to_owned(), |rate| format!("{rate:.2}")),
            ),
        ];
        if !self.margins.is_empty() {
            tables.push(self.margin_table());
            tables.push(self.front_table());
        }
        tables
    }

    fn by_condition(&self, title: &str, text: impl Fn(&Cell) -> String) -> TextTable {
        let columns: Vec<_> = self
            .conditions
            .iter()
            .map(|condition| condition.name.to_owned())
            .collect();
        let line = |law: &ControlLaw| {
            let cells = columns.iter().map(|condition| {
                let cell = self.cell(&law.name, condition);
                cell.map_or_else(String::new, &text)
            });
            law_row(&law.name, cells)
        };
        table(title, &columns, self.laws.iter().map(line))
    }

    fn margin_table(&self) -> TextTable {
        let is_searched = |name: &str| self.margins.iter().any(|margin| margin.quantity == name);
        let searched: Vec<_> = MARGINS
            .iter()
            .filter(|quantity| is_searched(quantity.name))
            .collect();
        let line = |law: &ControlLaw| {
            let cells = searched
                .iter()
                .map(|quantity| match self.margin(&law.name, quantity.name) {
                    Some(Margin {
                        survived: Some(value),
                        failed,
                        ..
                    }) => format!("{}{value}", if failed.is_none() { "≥ " } else { "" }),
                    Some(_) => "–".to_owned(),
                    None => "not flown".to_owned(),
                });
            law_row(&law.name, cells)
        };
        let title = format!(
            "Margins: the largest value with which the first {} stay within {} cm of the path, RMS in the last 20 s",
            counted(self.seeds.len().min(SEEDS)),
            100.0 * SURVIVED
        );
        let columns = searched
            .iter()
            .map(|quantity| format!("{}, {}", quantity.name, quantity.unit));
        let columns: Vec<_> = columns.collect();
        table(&title, &columns, self.laws.iter().map(line))
    }

    fn front_table(&self) -> TextTable {
        let line = |point: &FrontPoint| {
            let beaten_by = match point.beaten_by.as_slice() {
                [] => "none: it is on the front".to_owned(),
                [shown @ .., _, _] if shown.len() > 1 => {
                    format!("{} and {} more", point.beaten_by[..2].join(", "), shown.len())
                }
                laws => laws.join(", "),
            };
            let delay = point
                .delay
                .map_or_else(|| "–".to_owned(), |delay| delay.to_string());
            let cells = [centimetres(point.rms), point.lost.to_string(), delay, beaten_by];
            law_row(&point.law, cells)
        };
        let title = "Front: a law is beaten by another that is no worse in RMS, lost flights and delay survived, and better in \
                     one of them";
        let columns = [
            "geometric mean of the RMS, cm",
            "flights lost",
            "delay survived, ms",
            "beaten by",
        ];
        table(title, &columns.map(str::to_owned), self.front.iter().map(line))
    }

    /// Returns the tables as Markdown, each after its title.
    #[must_use]
    pub fn markdown(&self) -> String {
        let tables = self.tables();
        tables.iter().map(|table| table.markdown() + "\n").collect()
    }
}

fn counted(seeds: usize) -> String {
    format!("{seeds} seed{}", if seeds == 1 { "" } else { "s" })
}

/// Makes a table with a row for each law.
fn table(title: &str, columns: &[String], lines: impl Iterator<Item = Vec<String>>) -> TextTable {
    let header: Vec<_> = std::iter::once("law")
        .chain(columns.iter().map(String::as_str))
        .collect();
    TextTable::new(title, &header, lines)
}

fn law_row(law: &str, cells: impl IntoIterator<Item = String>) -> Vec<String> {
    std::iter::once(format!("`{law}`")).chain(cells).collect()
}

/// Formats a distance in centimetres, precisely enough to distinguish laws.
#[must_use]
pub fn centimetres(distance: Option<f64>) -> String {
    distance.map_or_else(|| "–".to_owned(), |distance| format!("{:.2}", 100.0 * distance))
}

fn with_losses(text: String, cell: &Cell) -> String {
    match cell.lost.len() {
        0 => text,
        count => format!("{text} ({count} lost)"),
    }
}

/// Transposes a table: few laws in many conditions would be too wide for a terminal.
fn transposed(table: &TextTable) -> TextTable {
    let turned = |row: usize| table.lines.iter().map(move |cells| cells[row].clone());
    let header: Vec<_> = std::iter::once(String::new()).chain(turned(0)).collect();
    let lines = table.header.iter().enumerate().skip(1);
    let lines = lines.map(|(row, name)| std::iter::once(name.clone()).chain(turned(row)).collect());
    TextTable::new(&table.title, &header, lines)
}

impl Display for GridReport {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        for mut table in self.tables() {
            let cells = table.lines.iter_mut().flatten();
            cells.for_each(|cell| cell.retain(|character| character != '`'));
            let shown = if table.lines.len() < table.header.len() {
                transposed(&table)
            } else {
                table
            };
            writeln!(formatter, "{shown}\n")?;
        }
        let lost = self
            .cells
            .iter()
            .flat_map(|cell| cell.lost.iter().map(move |lost| (cell, lost)));
        for (cell, lost) in lost.clone().take(10) {
            writeln!(
                formatter,
                "lost: {} in {}, seed {}: {}",
                cell.law, cell.condition, lost.seed, lost.reason
            )?;
        }
        if lost.clone().count() > 10 {
            writeln!(formatter, "… and {} more in grid.json", lost.count() - 10)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn captions_say_how_many_seeds_stand_behind_a_number() {
        let base = Base::load(None).unwrap();
        let law: ControlLaw = "indi".parse().unwrap();
        let margin = Margin {
            law: law.name.clone(),
            quantity: "delay".to_owned(),
            unit: "ms".to_owned(),
            survived: Some(16.0),
            failed: Some(17.0),
            failure: None,
        };
        let other = "mine:controller.k1=3.0".parse().unwrap();
        let seeds: Vec<u64> = (201..221).collect();
        let report = GridReport::new(&base, &[law, other], &[], &seeds, Vec::new(), vec![margin]);
        let tables = report.tables();
        let [rms, worst, peak, rates, margins, _] = &tables[..] else {
            panic!("{tables:?}")
        };
        assert!(
            [rms, worst, peak, rates]
                .iter()
                .all(|table| table.title.contains("20 seeds"))
        );
        assert!(margins.title.contains("the first 5 seeds"), "{}", margins.title);
        assert_eq!(margins.lines, [["`indi`", "16"], ["`mine`", "not flown"]]);
    }
}
