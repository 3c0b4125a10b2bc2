//! CSV file of numbers with a header line.

use std::ops::Range;

use super::FileProblem;

/// Column names and rows.
#[derive(Debug)]
pub(super) struct Table {
    /// Names in lower case, with their positions in the file.
    names: Vec<(String, Range<usize>)>,
    /// Rows, each with one number per column.
    pub(super) rows: Vec<Row>,
}

/// Line of numbers.
#[derive(Debug)]
pub(super) struct Row {
    /// Position in the file.
    pub(super) span: Range<usize>,
    /// Numbers, one per column.
    pub(super) numbers: Vec<f64>,
    cells: Vec<Range<usize>>,
}

impl Table {
    /// Reads a table. Ignores a trailing comma and a `#` before the names.
    pub(super) fn read(text: &str) -> Result<Self, FileProblem> {
        let mut lines = lines(text);
        let Some((line, at)) = lines.next() else {
            return Err(FileProblem::new(&(0..0), "the file is empty", FORMS));
        };
        let names = cells(
            line.strip_prefix('#').unwrap_or(line),
            at + usize::from(line.starts_with('#')),
        );
        let names: Vec<_> = names
            .map(|(name, span)| (name.to_ascii_lowercase(), span))
            .collect();
        if names.iter().all(|(name, _)| name.parse::<f64>().is_ok()) {
            return Err(FileProblem::new(
                &(at..at + line.len()),
                "the first line does not name the columns",
                FORMS,
            ));
        }
        if names.len() == 1 {
            return Err(FileProblem::new(
                &names[0].1,
                "there is no comma between column names",
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

    /// Returns the index of a column.
    pub(super) fn column(&self, name: &str) -> Result<usize, FileProblem> {
        let found = self.names.iter().position(|(known, _)| known == name);
        found.ok_or_else(|| {
            FileProblem::new(&self.header_span(), format!("there is no column `{name}`"), FORMS)
        })
    }

    /// Refuses columns with other names than these, and duplicate ones.
    pub(super) fn refuse_columns_but(&self, known: &[&str]) -> Result<(), FileProblem> {
        for (index, (name, span)) in self.names.iter().enumerate() {
            if !known.contains(&name.as_str()) {
                return Err(FileProblem::new(
                    span,
                    format!("the column `{name}` is unknown"),
                    FORMS,
                ));
            }
            if self.names[..index].iter().any(|(before, _)| before == name) {
                return Err(FileProblem::new(
                    span,
                    format!("a second column `{name}`"),
                    "remove one of them",
                ));
            }
        }
        Ok(())
    }

    /// Refuses a yaw other than 0 in the columns that `is_yaw` accepts.
    pub(super) fn refuse_yaw(&self, is_yaw: impl Fn(&str) -> bool) -> Result<(), FileProblem> {
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
                let fix = "remove the yaw columns, and state the yaw in `path.yaw` or `path.yaw_step`";
                return Err(FileProblem::new(&row.cells[column], reason, fix));
            }
        }
        Ok(())
    }

    /// Refuses more rows than the maximum.
    pub(super) fn refuse_more_rows_than(&self, most: usize) -> Result<(), FileProblem> {
        match self.rows.get(most) {
            Some(row) => Err(FileProblem::new(
                &row.span,
                format!("a path has at most {most} points"),
                "remove points: a path needs about ten per second",
            )),
            None => Ok(()),
        }
    }

    fn header_span(&self) -> Range<usize> {
        let span = |name: Option<&(String, Range<usize>)>| name.map_or(0..0, |(_, span)| span.clone());
        span(self.names.first()).start..span(self.names.last()).end
    }
}

/// The fix for a file of another form.
const FORMS: &str = "write points as `x,y,z` or `t,x,y,z`, or polynomials as `duration,x^0,…,x^7,y^0,…,z^0,…`, one per line below \
                     these names";

impl Row {
    fn read(line: &str, at: usize, names: &[(String, Range<usize>)]) -> Result<Self, FileProblem> {
        let span = at..at + line.len();
        let mut row = Self {
            span: span.clone(),
            numbers: Vec::with_capacity(names.len()),
            cells: Vec::with_capacity(names.len()),
        };
        for (cell, span) in cells(line, at) {
            let number = cell.parse().ok().filter(|number: &f64| number.is_finite());
            let number = number.ok_or_else(|| {
                FileProblem::new(
                    &span,
                    format!("`{cell}` is not a number"),
                    "write a number, such as -1.25e-3",
                )
            })?;
            row.numbers.push(number);
            row.cells.push(span);
        }
        if row.numbers.len() != names.len() {
            let reason = format!("{} numbers below {} names", row.numbers.len(), names.len());
            return Err(FileProblem::new(
                &span,
                reason,
                "write one number per column, separated by commas",
            ));
        }
        Ok(row)
    }
}

/// Returns the non-blank lines with their offsets.
fn lines(text: &str) -> impl Iterator<Item = (&str, usize)> {
    const BYTE_ORDER_MARK: char = '\u{feff}';
    let mut next = 0;
    let lines = text.split('\n').map(move |line| {
        let at = next;
        next += line.len() + 1;
        let shown = line.trim_start_matches(BYTE_ORDER_MARK);
        (shown.trim_end(), at + line.len() - shown.len())
    });
    lines.filter(|(line, _)| !line.trim().is_empty())
}

/// Returns the cells of a line with their positions.
fn cells(line: &str, at: usize) -> impl Iterator<Item = (&str, Range<usize>)> {
    let line = line.strip_suffix(',').unwrap_or(line);
    let mut next = at;
    line.split(',').map(move |cell| {
        let start = next + cell.len() - cell.trim_start().len();
        next += cell.len() + 1;
        let cell = cell.trim();
        (cell, start..start + cell.len())
    })
}
