//! The lines around a place in a text, as a terminal may be given them.

use std::ops::Range;

use miette::{MietteError, MietteSpanContents, SourceCode, SourceSpan, SpanContents};

use crate::printable::printable_in_place;

/// Longest line that is shown whole, and how much of a longer one is shown before the place, characters.
const LONGEST_LINE: usize = 200;
const SHOWN_BEFORE: usize = 60;

/// The mark in place of text that is left out.
const CUT: &str = "…";

/// A text and where its lines begin.
#[derive(Debug)]
pub(super) struct Lines {
    text: String,
    starts: Vec<usize>,
}

/// The line of a place and those before and behind it. Long lines are cut, and control characters are replaced.
#[derive(Clone, Debug)]
pub(super) struct Snippet {
    name: String,
    text: String,
    /// The place, in `text`.
    span: Range<usize>,
    /// Lines of the whole text before the first of this one.
    lines_before: usize,
    /// Line and column of the place in the whole text, from 1, the column in characters.
    place: [usize; 2],
    /// `true` if the line is shown without its begin.
    is_cut: bool,
}

impl Lines {
    pub(super) fn of(text: &str) -> Self {
        let newlines = text.match_indices('\n').map(|(place, _)| place + 1);
        Self {
            starts: std::iter::once(0).chain(newlines).collect(),
            text: text.to_owned(),
        }
    }

    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// Returns a part of the text to show; of a part of several lines, the first.
    pub(super) fn snippet(&self, name: &str, span: Range<usize>) -> Snippet {
        let text = &self.text;
        let begin = text.floor_char_boundary(span.start.min(text.len().saturating_sub(1)));
        let number = self.starts.partition_point(|&start| start <= begin) - 1;
        let line = self.line(number);
        let line_start = self.starts[number];
        let before = &text[line_start..begin];
        let end = text
            .ceil_char_boundary(span.end)
            .clamp(begin, (line_start + line.len()).max(begin));

        let mut shown = String::new();
        if number > 0 {
            shown += &cut(self.line(number - 1), 0);
            shown.push('\n');
        }
        let column = before.chars().count();
        let left_out = if line.chars().count() > LONGEST_LINE {
            column.saturating_sub(SHOWN_BEFORE)
        } else {
            0
        };
        let own = cut(line, left_out);
        let own_start = shown.len();
        let mark = if left_out > 0 { CUT.len() } else { 0 };
        let cut_bytes = byte_of(line, left_out);
        let place = |at: usize| {
            // A place at the end of the line, or beyond what is shown of it, is shown at its end.
            let shown = (at - line_start).min(line.len()).saturating_sub(cut_bytes) + mark;
            own_start + own.floor_char_boundary(shown.min(own.len()))
        };
        let span = place(begin)..place(end);
        shown += &own;
        shown.push('\n');
        if number + 1 < self.starts.len() {
            shown += &cut(self.line(number + 1), 0);
            shown.push('\n');
        }
        Snippet {
            name: name.to_owned(),
            text: shown,
            span,
            lines_before: number.saturating_sub(1),
            place: [number + 1, column + 1],
            is_cut: left_out > 0,
        }
    }

    /// A line without its end.
    fn line(&self, number: usize) -> &str {
        let rest = &self.text[self.starts[number]..];
        let line = rest.split_once('\n').map_or(rest, |(line, _)| line);
        line.strip_suffix('\r').unwrap_or(line)
    }
}

impl Snippet {
    /// Returns where the place is: name of the text, line, and column in characters.
    pub(super) fn place(&self) -> String {
        let [line, column] = self.place;
        format!("{}:{line}:{column}", self.name)
    }

    pub(super) fn span(&self) -> SourceSpan {
        self.span.clone().into()
    }

    /// Returns where the place is, if the snippet shows it elsewhere.
    pub(super) fn true_column(&self) -> Option<usize> {
        self.is_cut.then_some(self.place[1])
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
            _ if span.offset() == self.span.start => self.place[1] - 1,
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

/// Returns a line to show without so many characters at its begin.
fn cut(line: &str, left_out: usize) -> String {
    let rest = &line[byte_of(line, left_out)..];
    let end = byte_of(rest, LONGEST_LINE);
    let begin_mark = if left_out > 0 { CUT } else { "" };
    let end_mark = if end < rest.len() { CUT } else { "" };
    format!("{begin_mark}{}{end_mark}", printable_in_place(&rest[..end]))
}

/// Returns where the character of a number begins, or the line ends.
fn byte_of(line: &str, character: usize) -> usize {
    line.char_indices()
        .nth(character)
        .map_or(line.len(), |(place, _)| place)
}
