//! Lines around a position in a text, escaped for a terminal.

use std::ops::Range;

use miette::{MietteError, MietteSpanContents, SourceCode, SourceSpan, SpanContents};

use crate::printable::printable_in_place;

/// Maximum length of a line that is shown completely, and the part of a longer line shown before the position, characters.
const MAX_LINE: usize = 200;
const SHOWN_BEFORE: usize = 60;

/// Mark of omitted text.
const CUT: &str = "…";

/// Text and the offsets of its lines.
#[derive(Debug)]
pub(super) struct Lines {
    text: String,
    starts: Vec<usize>,
}

/// Line of a position, with the previous and the next one. Long lines are truncated, and control characters are replaced.
#[derive(Clone, Debug)]
pub(super) struct Snippet {
    name: String,
    text: String,
    /// Span in `text`.
    span: Range<usize>,
    /// Number of lines before the snippet.
    lines_before: usize,
    /// Line and column in the whole text, from 1, the column in characters.
    position: [usize; 2],
    /// `true` if the start of the line is omitted.
    is_truncated: bool,
}

impl Snippet {
    /// Renames the text, if it has this name.
    pub(super) fn rename(&mut self, from: &str, to: &str) {
        if self.name == from {
            to.clone_into(&mut self.name);
        }
    }
}

impl Lines {
    pub(super) fn new(text: &str) -> Self {
        let newlines = text.match_indices('\n').map(|(offset, _)| offset + 1);
        Self {
            starts: std::iter::once(0).chain(newlines).collect(),
            text: text.to_owned(),
        }
    }

    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// Returns the snippet of a span; only the first line of a longer one.
    pub(super) fn snippet(&self, name: &str, span: Range<usize>) -> Snippet {
        let text = &self.text;
        let start = text.floor_char_boundary(span.start.min(text.len().saturating_sub(1)));
        let number = self.starts.partition_point(|&line| line <= start) - 1;
        let line = self.line(number);
        let line_start = self.starts[number];
        let before = &text[line_start..start];
        let end = text
            .ceil_char_boundary(span.end)
            .clamp(start, (line_start + line.len()).max(start));

        let mut shown = String::new();
        if number > 0 {
            shown += &truncated(self.line(number - 1), 0);
            shown.push('\n');
        }
        let column = before.chars().count();
        let left_out = if line.chars().count() > MAX_LINE {
            column.saturating_sub(SHOWN_BEFORE)
        } else {
            0
        };
        let own = truncated(line, left_out);
        let own_start = shown.len();
        let mark = if left_out > 0 { CUT.len() } else { 0 };
        let cut_bytes = byte_of(line, left_out);
        let shown_offset = |at: usize| {
            // An offset beyond the shown part of the line is shown at its end.
            let shown = (at - line_start).min(line.len()).saturating_sub(cut_bytes) + mark;
            own_start + own.floor_char_boundary(shown.min(own.len()))
        };
        let span = shown_offset(start)..shown_offset(end);
        shown += &own;
        shown.push('\n');
        if number + 1 < self.starts.len() {
            shown += &truncated(self.line(number + 1), 0);
            shown.push('\n');
        }
        Snippet {
            name: name.to_owned(),
            text: shown,
            span,
            lines_before: number.saturating_sub(1),
            position: [number + 1, column + 1],
            is_truncated: left_out > 0,
        }
    }

    /// Returns a line without its line break.
    fn line(&self, number: usize) -> &str {
        let rest = &self.text[self.starts[number]..];
        let line = rest.split_once('\n').map_or(rest, |(line, _)| line);
        line.strip_suffix('\r').unwrap_or(line)
    }
}

impl Snippet {
    /// Returns the position: name of the text, line, and column in characters.
    pub(super) fn position(&self) -> String {
        let [line, column] = self.position;
        format!("{}:{line}:{column}", self.name)
    }

    pub(super) fn span(&self) -> SourceSpan {
        self.span.clone().into()
    }

    /// Returns the true column, if the snippet shows another one.
    pub(super) fn true_column(&self) -> Option<usize> {
        self.is_truncated.then_some(self.position[1])
    }
}

impl SourceCode for Snippet {
    fn read_span<'a>(
        &'a self,
        span: &SourceSpan,
        context_lines_before: usize,
        context_lines_after: usize,
    ) -> Result<Box<dyn SpanContents<'a> + 'a>, MietteError> {
        let read = self
            .text
            .read_span(span, context_lines_before, context_lines_after)?;
        let column = match read.column() {
            0 => 0,
            _ if span.offset() == self.span.start => self.position[1] - 1,
            column => column,
        };
        Ok(Box::new(MietteSpanContents::new_named(
            self.name.clone(),
            read.data(),
            *read.span(),
            self.lines_before + read.line(),
            column,
            read.line_count(),
        )))
    }
}

/// Returns a line to show without its first `left_out` characters.
fn truncated(line: &str, left_out: usize) -> String {
    let rest = &line[byte_of(line, left_out)..];
    let end = byte_of(rest, MAX_LINE);
    let start_mark = if left_out > 0 { CUT } else { "" };
    let end_mark = if end < rest.len() { CUT } else { "" };
    format!("{start_mark}{}{end_mark}", printable_in_place(&rest[..end]))
}

/// Returns the byte offset of a character, or the end of the line.
fn byte_of(line: &str, character: usize) -> usize {
    line.char_indices()
        .nth(character)
        .map_or(line.len(), |(offset, _)| offset)
}
