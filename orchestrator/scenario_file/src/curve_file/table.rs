//! A CSV file of numbers whose first line names its columns.

use std::ops::Range;

use super::Wrong;

/// The names of the columns, and the rows.
#[derive(Debug)]
pub(super) struct Table {
    /// Names in small letters, with their places.
    names: Vec<(String, Range<usize>)>,
    /// The rows; each has a number a column.
    pub(super) rows: Vec<Row>,
}

/// A line of numbers.
#[derive(Debug)]
pub(super) struct Row {
    /// Its place in the file.
    pub(super) span: Range<usize>,
    /// Its numbers.
    pub(super) numbers: Vec<f64>,
    cells: Vec<Range<usize>>,
}

impl Table {
    /// Reads a table. A comma at the end of a line is none between columns, and a `#` before the names is ignored.
    pub(super) fn read(text: &str) -> Result<Self, Wrong> {
        let mut lines = lines(text);
        let Some((line, at)) = lines.next() else {
            return Err(Wrong::new(&(0..0), "the file is empty", FORMS));
        };
        let names = cells(
            line.strip_prefix('#').unwrap_or(line),
            at + usize::from(line.starts_with('#')),
        );
        let names: Vec<_> = names
            .map(|(name, span)| (name.to_ascii_lowercase(), span))
            .collect();
        if names.iter().all(|(name, _)| name.parse::<f64>().is_ok()) {
            return Err(Wrong::new(
                &(at..at + line.len()),
                "the first line does not name the columns",
                FORMS,
            ));
        }
        if names.len() == 1 {
            return Err(Wrong::new(
                &names[0].1,
                "there is no comma between names of columns",
                FORMS,
            ));
        }
        let rows = lines.map(|(line, at)| Row::read(line, at, &names));
        let rows = rows.collect::<Result<_, _>>()?;
        Ok(Self { names, rows })
    }

    /// Returns whether there is a column of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.names.iter().any(|(known, _)| known == name)
    }

    /// Returns the place of a column.
    pub(super) fn column(&self, name: &str) -> Result<usize, Wrong> {
        let found = self.names.iter().position(|(known, _)| known == name);
        found.ok_or_else(|| Wrong::new(&self.head(), format!("there is no column `{name}`"), FORMS))
    }

    /// Refuses a column of another name than these, and one that is there twice.
    pub(super) fn refuse_columns_but(&self, known: &[&str]) -> Result<(), Wrong> {
        for (index, (name, span)) in self.names.iter().enumerate() {
            if !known.contains(&name.as_str()) {
                return Err(Wrong::new(
                    span,
                    format!("there is no use for a column `{name}`"),
                    FORMS,
                ));
            }
            if self.names[..index].iter().any(|(before, _)| before == name) {
                return Err(Wrong::new(
                    span,
                    format!("a second column `{name}`"),
                    "leave one of them out",
                ));
            }
        }
        Ok(())
    }

    /// Refuses a yaw other than 0 in the columns of such names.
    pub(super) fn refuse_yaw(&self, is_yaw: impl Fn(&str) -> bool) -> Result<(), Wrong> {
        let columns = self
            .names
            .iter()
            .enumerate()
            .filter(|(_, (name, _))| is_yaw(name));
        for (column, (name, _)) in columns {
            if let Some(row) = self.rows.iter().find(|row| row.numbers[column] != 0.0) {
                let reason = format!(
                    "`{name}` is {:?}, and the yaw does not follow the path",
                    row.numbers[column]
                );
                let fix = "leave the columns of yaw out, and state it in `path.yaw` or `path.yaw_step`";
                return Err(Wrong::new(&row.cells[column], reason, fix));
            }
        }
        Ok(())
    }

    /// Refuses more rows than a path has points.
    pub(super) fn refuse_more_rows_than(&self, most: usize) -> Result<(), Wrong> {
        match self.rows.get(most) {
            Some(row) => Err(Wrong::new(
                &row.span,
                format!("a path has at most {most} points"),
                "leave points out: a path needs some ten a second",
            )),
            None => Ok(()),
        }
    }

    fn head(&self) -> Range<usize> {
        let span = |name: Option<&(String, Range<usize>)>| name.map_or(0..0, |(_, span)| span.clone());
        span(self.names.first()).start..span(self.names.last()).end
    }
}

/// The fix for a file of another form.
const FORMS: &str = "write points as `x,y,z` or `t,x,y,z`, or polynomials as `duration,x^0,…,x^7,y^0,…,z^0,…`, a line each below \
                     these names";

impl Row {
    fn read(line: &str, at: usize, names: &[(String, Range<usize>)]) -> Result<Self, Wrong> {
        let span = at..at + line.len();
        let mut row = Self {
            span: span.clone(),
            numbers: Vec::with_capacity(names.len()),
            cells: Vec::with_capacity(names.len()),
        };
        for (cell, span) in cells(line, at) {
            let number = cell.parse().ok().filter(|number: &f64| number.is_finite());
            let number = number.ok_or_else(|| {
                Wrong::new(
                    &span,
                    format!("`{cell}` is no number"),
                    "write a number, such as -1.25e-3",
                )
            })?;
            row.numbers.push(number);
            row.cells.push(span);
        }
        if row.numbers.len() != names.len() {
            let reason = format!("{} numbers below {} names", row.numbers.len(), names.len());
            return Err(Wrong::new(
                &span,
                reason,
                "write a number a column, with commas between them",
            ));
        }
        Ok(row)
    }
}

/// Returns the lines that are not blank, each with its place.
fn lines(text: &str) -> impl Iterator<Item = (&str, usize)> {
    const MARK: char = '\u{feff}';
    let mut next = 0;
    let lines = text.split('\n').map(move |line| {
        let at = next;
        next += line.len() + 1;
        let shown = line.trim_start_matches(MARK);
        (shown.trim_end(), at + line.len() - shown.len())
    });
    lines.filter(|(line, _)| !line.trim().is_empty())
}

/// Returns the cells of a line with their places.
fn cells(line: &str, at: usize) -> impl Iterator<Item = (&str, Range<usize>)> {
    let line = line.strip_suffix(',').unwrap_or(line);
    let mut next = at;
    line.split(',').map(move |cell| {
        let begin = next + cell.len() - cell.trim_start().len();
        next += cell.len() + 1;
        let cell = cell.trim();
        (cell, begin..begin + cell.len())
    })
}
