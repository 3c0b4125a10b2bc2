//! The picture: a function of the run's snapshot, the last minute, and the user's selection and mode.
//!
//! 80 columns and 24 rows hold everything. With less room, events are left out first, then trends, then columns; the
//! state of the flight, the services and the keys stay.

mod help;
mod laboratory;
mod overlay;
mod services;
mod trends;

use std::time::Duration;

use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::Widget;

use self::services::ServiceTable;
use super::history::History;
use super::keys::{Break, Controls, Intent, Mode};
use super::words::{cut, short_time};
use run_client::Snapshot;

/// Minimum columns and rows of a useful picture.
const SMALLEST: (u16, u16) = (20, 4);

/// Rows of a printed view; they hold everything.
const PRINTED_ROWS: u16 = 24;

/// Contents of a picture.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    pub run: &'a str,
    /// The last snapshot; `None` before the first answer.
    pub snapshot: Option<&'a Snapshot>,
    pub history: &'a History,
    pub controls: &'a Controls,
    /// Time without an answer, if longer than the limit.
    pub silence: Option<Duration>,
}

impl Widget for &View<'_> {
    fn render(self, area: Rect, buffer: &mut Buffer) {
        if area.width < SMALLEST.0 || area.height < SMALLEST.1 {
            Line::raw("too small").render(area, buffer);
            return;
        }
        match self.snapshot {
            Some(snapshot) => self.draw(snapshot, area, buffer),
            None => self.draw_waiting(area, buffer),
        }
        match self.controls.mode() {
            Mode::Help => overlay::draw(" help ", &help::TEXT, area, buffer),
            Mode::Set(_) => {
                let above_keys = Rect {
                    height: area.height - 1,
                    ..area
                };
                overlay::draw(" gains ", self.controls.gains(), above_keys, buffer);
            }
            Mode::Watch | Mode::Confirm(_) => {}
        }
    }
}

impl View<'_> {
    /// Returns the picture as text, without the line of the keys.
    #[must_use]
    pub fn without_keys(&self, width: u16) -> String {
        let lines = self.lines(width, PRINTED_ROWS);
        let (_, lines) = lines.split_last().expect("a view has rows");
        let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
        text.trim_end().to_owned() + "\n"
    }

    /// Returns the picture as lines of text.
    fn lines(&self, width: u16, height: u16) -> Vec<String> {
        let mut buffer = Buffer::empty(Rect::new(0, 0, width, height));
        self.render(buffer.area, &mut buffer);
        let row = |row| {
            let cells = (0..width).map(|column| buffer[(column, row)].symbol());
            cells.collect::<String>().trim_end().to_owned()
        };
        (0..height).map(row).collect()
    }

    fn draw(&self, snapshot: &Snapshot, area: Rect, buffer: &mut Buffer) {
        let table = ServiceTable::new(&snapshot.services, self.controls.selected(), area.width);
        let laboratory = laboratory::line(snapshot, area.width);
        let warning = warning(snapshot);
        let rows = Rows::within(area, table.height(), laboratory.is_some(), warning.is_some());
        self.title(&snapshot.scenario, area.width)
            .render(rows.title, buffer);
        fitting(status(snapshot), area.width).render(rows.status, buffer);
        fitting(capture_to_frame(snapshot), area.width).render(rows.chain, buffer);
        if let Some(text) = warning {
            let text = cut(&text, area.width.into());
            Line::styled(text, Style::new().red().bold()).render(rows.warning, buffer);
        }
        if let Some(parts) = laboratory {
            fitting(parts, area.width).render(rows.laboratory, buffer);
        }
        table.draw(rows.services, buffer);
        services::inputs(&snapshot.services, self.controls.selected()).render(rows.inputs, buffer);
        trends::draw(self.history, rows.trends, buffer);
        events(snapshot, rows.events, buffer);
        self.keys(area.width).render(rows.keys, buffer);
    }

    fn draw_waiting(&self, area: Rect, buffer: &mut Buffer) {
        let [title, waiting, _, keys] = Layout::vertical([
            Constraint::Length(1),
            Constraint::Length(1),
            Constraint::Fill(1),
            Constraint::Length(1),
        ])
        .areas(area);
        self.title("waiting for the flight to begin", area.width)
            .render(title, buffer);
        Line::raw("The run has not answered yet.").render(waiting, buffer);
        self.keys(area.width).render(keys, buffer);
    }

    fn title(&self, scenario: &str, width: u16) -> Line<'static> {
        let right = match self.silence {
            Some(silence) => format!("NO ANSWER for {} s", silence.as_secs()),
            None => format!("run {}", self.run),
        };
        let room = usize::from(width).saturating_sub(right.chars().count() + 2);
        let left = cut(&format!("gerono top  {scenario}"), room);
        let style = Style::new().reversed();
        let style = if self.silence.is_some() {
            style.red()
        } else {
            style
        };
        let gap = usize::from(width).saturating_sub(left.chars().count() + right.chars().count());
        Line::styled(format!("{left}{}{right}", " ".repeat(gap)), style)
    }

    fn keys(&self, width: u16) -> Line<'static> {
        match self.controls.mode() {
            Mode::Confirm(intent) => {
                return Line::styled(confirmation(intent), Style::new().red().reversed());
            }
            Mode::Set(setting) => return prompt(setting, width),
            Mode::Watch | Mode::Help => {}
        }
        if !self.controls.notice().is_empty() {
            return Line::styled(self.controls.notice().to_owned(), Style::new().bold());
        }
        let faults = if self.controls.may_break() {
            ["k kill", "f freeze"].as_slice()
        } else {
            &["(no faults)"]
        };
        let parts = ["? help", "q leave", "s set"]
            .iter()
            .chain(faults)
            .chain(&["↑↓ select"]);
        fitting(parts.map(|&part| Span::raw(part).dim()).collect(), width)
    }
}

/// Returns the line of a setting that is being typed. A long setting shows its end.
fn prompt(setting: &str, width: u16) -> Line<'static> {
    const KEYS: &str = "Enter: set, Esc: no";
    let room = usize::from(width).saturating_sub("set ▏  ".chars().count() + KEYS.len());
    let hidden = setting.chars().count().saturating_sub(room);
    let shown: String = setting.chars().skip(hidden).collect();
    Line::styled(format!("set {shown}▏  {KEYS}"), Style::new().reversed())
}

fn confirmation(Intent { kind, service, pid }: &Intent) -> String {
    let verb = match kind {
        Break::Kill => "kill",
        Break::Freeze => "freeze",
    };
    format!("{verb} {service} ({pid})? y: yes, else: no")
}

/// Layout of the picture.
struct Rows {
    title: Rect,
    status: Rect,
    warning: Rect,
    chain: Rect,
    laboratory: Rect,
    services: Rect,
    inputs: Rect,
    trends: Rect,
    events: Rect,
    keys: Rect,
}

impl Rows {
    /// Divides the rows in the order of importance.
    fn within(area: Rect, table: u16, has_laboratory: bool, has_warning: bool) -> Self {
        let mut left = area.height;
        let mut take = |wanted: u16| {
            let given = wanted.min(left);
            left -= given;
            Constraint::Length(given)
        };
        let [keys, status] = [take(1), take(1)];
        let warning = take(u16::from(has_warning));
        let laboratory = take(u16::from(has_laboratory));
        let services = take(table);
        let [title, chain, inputs] = [take(1), take(1), take(1)];
        let trends = if left < trends::height(1) {
            0
        } else {
            trends::height(left.saturating_sub(8) / 6)
        };
        let parts = [
            title,
            status,
            warning,
            chain,
            laboratory,
            services,
            inputs,
            Constraint::Length(trends),
            Constraint::Fill(1),
            keys,
        ];
        let [
            title,
            status,
            warning,
            chain,
            laboratory,
            services,
            inputs,
            trends,
            events,
            keys,
        ] = Layout::vertical(parts).areas(area);
        Self {
            title,
            status,
            warning,
            chain,
            laboratory,
            services,
            inputs,
            trends,
            events,
            keys,
        }
    }
}

/// Returns the line of the flight's time, phase and arming.
fn status(snapshot: &Snapshot) -> Vec<Span<'static>> {
    let time = format!("{:.1} s of {:.1} s", snapshot.time, snapshot.duration);
    let mut parts = vec![Span::raw(time).bold()];
    if snapshot.killed {
        parts.push(Span::raw("KILLED").red().bold());
    }
    match &snapshot.phase {
        Some(phase) => {
            parts.push(Span::raw(format!("phase {phase}")));
            if !snapshot.killed {
                parts.push(Span::raw(if snapshot.armed { "armed" } else { "disarmed" }));
            }
        }
        None => parts.push(Span::raw("no phases")),
    }
    if snapshot.landing {
        parts.push(Span::raw("asked to land").yellow());
    }
    parts.push(Span::raw(format!("{} samples recorded", snapshot.recorded)).dim());
    parts
}

/// Returns what is wrong with the flight, or keeps the vehicle from being armed.
fn warning(snapshot: &Snapshot) -> Option<String> {
    let refusal = snapshot.refusal_to_arm.as_ref().filter(|_| !snapshot.killed);
    let told = [
        ("killed", snapshot.killed_by.as_ref()),
        ("WRONG", snapshot.response.as_ref()),
        ("will not arm", refusal),
    ];
    let told = told.map(|(what, text)| text.map(|text| format!("{what}: {text}")));
    let told: Vec<_> = told.into_iter().flatten().collect();
    (!told.is_empty()).then(|| told.join("; "))
}

fn capture_to_frame(snapshot: &Snapshot) -> Vec<Span<'static>> {
    let mut parts = vec![Span::raw("capture → frame")];
    match &snapshot.capture_to_frame {
        Some(times) => {
            let times = [("p50", times.p50), ("p99", times.p99), ("max", times.max)];
            parts.extend(times.map(|(name, time)| Span::raw(format!("{name} {}", short_time(time)))));
        }
        None => parts.push(Span::raw("–")),
    }
    parts
}

/// Joins the parts that fit completely.
fn fitting(parts: Vec<Span<'static>>, width: u16) -> Line<'static> {
    const GAP: &str = "  ";
    let mut line = Line::default();
    for part in parts {
        let gap = if line.spans.is_empty() { "" } else { GAP };
        if line.width() + gap.len() + part.width() <= width.into() {
            line.push_span(gap);
            line.push_span(part);
        }
    }
    line
}

/// Draws the last events that fit, the newest last.
fn events(snapshot: &Snapshot, area: Rect, buffer: &mut Buffer) {
    if area.height < 2 {
        return;
    }
    rule("events", area.width).render(area, buffer);
    let rows = area.rows().skip(1);
    let room = usize::from(area.height - 1);
    if snapshot.events.is_empty() {
        Line::styled("none so far", Style::new().dim()).render(
            Rect {
                y: area.y + 1,
                height: 1,
                ..area
            },
            buffer,
        );
    }
    let first = snapshot.events.len().saturating_sub(room);
    for (event, row) in snapshot.events[first..].iter().zip(rows) {
        let text = format!("{:>7.1} s  {}", event.time, event.text);
        Line::raw(cut(&text, area.width.into())).render(row, buffer);
    }
}

/// Returns the headline of a section.
fn rule(title: &str, width: u16) -> Line<'static> {
    let text = format!("── {title} ");
    let rest = usize::from(width).saturating_sub(text.chars().count());
    Line::styled(text + &"─".repeat(rest), Style::new().dim())
}

#[cfg(test)]
mod tests;
