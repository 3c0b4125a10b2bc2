//! The table of services, and the inputs of the selected one.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::Line;
use ratatui::widgets::Widget;

use super::super::words::{short_count, short_time};
use metrics::summary::timing::Quantiles;
use run_client::snapshot::{InputSnapshot, ServiceSnapshot};

/// Columns of the selection mark and a name.
const NAME: usize = 15;

/// Columns that the ages of all inputs need.
const INPUTS: usize = 30;

/// Rows of the heading.
const HEADING: u16 = 2;

/// Column of the table.
struct Column {
    group: &'static str,
    label: &'static str,
    width: usize,
    /// On a narrow terminal the columns of lowest rank stay.
    rank: u8,
    value: fn(&ServiceSnapshot) -> String,
}

const fn column(
    group: &'static str,
    label: &'static str,
    width: usize,
    rank: u8,
    value: fn(&ServiceSnapshot) -> String,
) -> Column {
    Column {
        group,
        label,
        width,
        rank,
        value,
    }
}

/// With the names and the gaps, all columns take 80 characters.
const COLUMNS: [Column; 11] = [
    column("", "pid", 7, 2, |service| service.pid.to_string()),
    column("", "Hz", 5, 0, rate),
    column("step", "p50", 5, 9, |service| {
        quantile(service.step, |times| times.p50)
    }),
    column("step", "p99", 5, 6, |service| {
        quantile(service.step, |times| times.p99)
    }),
    column("wake", "p50", 5, 10, |service| {
        quantile(service.wake, |times| times.p50)
    }),
    column("wake", "p99", 5, 1, |service| {
        quantile(service.wake, |times| times.p99)
    }),
    column("wake", "max", 5, 8, |service| {
        quantile(service.wake, |times| times.max)
    }),
    column("input", "age", 5, 7, oldest_input),
    column("since start", "miss", 4, 3, |service| {
        short_count(service.missed_steps)
    }),
    column("since start", "late", 4, 5, |service| {
        short_count(service.late_inputs)
    }),
    column("since start", "died", 4, 4, |service| {
        short_count(service.restarts)
    }),
];

fn rate(service: &ServiceSnapshot) -> String {
    if service.flies {
        service.rate.to_string()
    } else {
        "down".to_owned()
    }
}

fn quantile(times: Option<Quantiles>, of: fn(&Quantiles) -> f64) -> String {
    times.map_or_else(|| "–".to_owned(), |times| short_time(of(&times)))
}

fn oldest_input(service: &ServiceSnapshot) -> String {
    let oldest = service
        .inputs
        .iter()
        .map(|input| input.age.unwrap_or(f64::INFINITY));
    match oldest.reduce(f64::max) {
        None => "–".to_owned(),
        Some(f64::INFINITY) => "none".to_owned(),
        Some(age) => short_time(age),
    }
}

/// Table of the services, with the columns that fit.
pub(super) struct ServiceTable<'a> {
    services: &'a [ServiceSnapshot],
    selected: usize,
    columns: Vec<&'static Column>,
    /// Width left over, columns.
    left: usize,
}

impl<'a> ServiceTable<'a> {
    pub(super) fn new(services: &'a [ServiceSnapshot], selected: usize, width: u16) -> Self {
        let mut left = usize::from(width).saturating_sub(NAME);
        let mut ranks: Vec<_> = COLUMNS
            .iter()
            .map(|column| (column.rank, column.width + 1))
            .collect();
        ranks.sort_unstable();
        let mut lowest_left_out = u8::MAX;
        for (rank, width) in ranks {
            match left.checked_sub(width) {
                Some(rest) => left = rest,
                None => {
                    lowest_left_out = rank;
                    break;
                }
            }
        }
        let columns = COLUMNS.iter().filter(|column| column.rank < lowest_left_out);
        Self {
            services,
            selected,
            columns: columns.collect(),
            left,
        }
    }

    /// Returns the rows of the complete table.
    pub(super) fn height(&self) -> u16 {
        HEADING + u16::try_from(self.services.len()).unwrap_or(u16::MAX - HEADING)
    }

    /// Draws the table; services that do not fit are scrolled out, but never the selected one.
    pub(super) fn draw(&self, area: Rect, buffer: &mut Buffer) {
        let head = if area.height > HEADING { HEADING } else { 0 };
        let heads = [self.groups(), self.labels()].into_iter().take(head.into());
        for (line, row) in heads.zip(area.rows()) {
            Line::styled(line, Style::new().dim()).render(row, buffer);
        }
        let room = usize::from(area.height - head);
        let first = (self.selected + 1).saturating_sub(room);
        let services = self.services.iter().enumerate().skip(first);
        for ((place, service), row) in services.zip(area.rows().skip(head.into())) {
            Line::styled(self.row(place, service), self.style(place, service)).render(row, buffer);
        }
    }

    fn style(&self, place: usize, service: &ServiceSnapshot) -> Style {
        let style = match service {
            ServiceSnapshot { flies: false, .. } => Style::new().red(),
            ServiceSnapshot { rate: 0, .. } => Style::new().yellow(),
            _ => Style::new(),
        };
        if place == self.selected {
            style.reversed()
        } else {
            style
        }
    }

    /// Returns the names of groups above their columns.
    fn groups(&self) -> String {
        let mut line = " ".repeat(NAME);
        for group in self.columns.chunk_by(|one, other| one.group == other.group) {
            let width = group.iter().map(|column| column.width + 1).sum::<usize>() - 1;
            line += &match group[0].group {
                "" => " ".repeat(width + 1),
                name => {
                    let name = if name.len() <= width { name } else { "" };
                    let rule = width - name.len();
                    format!(" {}{name}{}", "─".repeat(rule / 2), "─".repeat(rule - rule / 2))
                }
            };
        }
        line
    }

    fn labels(&self) -> String {
        let labels = self
            .columns
            .iter()
            .map(|column| right_aligned(column.label, column.width));
        let line = format!("{:NAME$}", " service") + &labels.collect::<String>();
        if self.left >= INPUTS {
            line + "  inputs, by age"
        } else {
            line
        }
    }

    fn row(&self, place: usize, service: &ServiceSnapshot) -> String {
        let mark = if place == self.selected { '>' } else { ' ' };
        let values = self
            .columns
            .iter()
            .map(|column| right_aligned(&(column.value)(service), column.width));
        let line = format!("{:NAME$}", format!("{mark}{}", service.name)) + &values.collect::<String>();
        if self.left >= INPUTS {
            line + "  " + &ages(&service.inputs)
        } else {
            line
        }
    }
}

/// Returns a right-aligned cell after a blank.
fn right_aligned(text: &str, width: usize) -> String {
    let blanks = width.saturating_sub(text.chars().count());
    format!(" {}{text}", " ".repeat(blanks))
}

fn ages(inputs: &[InputSnapshot]) -> String {
    let age = |input: &InputSnapshot| {
        let age = input.age.map_or_else(|| "never".to_owned(), short_time);
        format!("{} {age}", input.topic)
    };
    inputs.iter().map(age).collect::<Vec<_>>().join(", ")
}

/// Returns the line of the selected service's inputs.
pub(super) fn inputs(services: &[ServiceSnapshot], selected: usize) -> Line<'static> {
    let Some(service) = services.get(selected) else {
        return Line::default();
    };
    let ages = ages(&service.inputs);
    Line::raw(format!(" inputs of {}: {ages}", service.name))
}
