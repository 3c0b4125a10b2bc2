//! Sources of a scenario: the text of the file and of the `--set` arguments.
//!
//! The texts share one range of offsets, the file first and then each argument, so that one span identifies the position of
//! any value of the merged document.

use std::ops::Range;

use super::Finding;
use super::snippet::Lines;
use crate::printable::{printable, printable_lines, shortened};

/// Texts with their first offsets and names.
#[derive(Debug)]
pub(super) struct Sources {
    texts: Vec<(usize, String, Lines)>,
}

impl Sources {
    /// Name of an argument.
    pub(super) const ARGUMENT: &str = "--set";

    pub(super) fn new(file_name: &str, file: &str, arguments: &[String]) -> Self {
        let argument_names = arguments
            .iter()
            .map(|argument| (Self::ARGUMENT, argument.as_str()));
        let mut start = 0;
        let texts = std::iter::once((file_name, file))
            .chain(argument_names)
            .map(|(name, text)| {
                let source = (start, printable(name).into_owned(), Lines::new(text));
                // One more than the text, so that its end differs from the start of the next one.
                start += text.len() + 1;
                source
            })
            .collect();
        Self { texts }
    }

    /// Returns the arguments in order, each with its first offset.
    pub(super) fn arguments(&self) -> impl Iterator<Item = (usize, &str)> {
        self.texts[1..]
            .iter()
            .map(|(start, _, lines)| (*start, lines.text()))
    }

    /// Makes a finding at a span.
    pub(super) fn finding(
        &self,
        span: Range<usize>,
        title: impl Into<String>,
        reason: impl Into<String>,
        fix: impl Into<String>,
    ) -> Finding {
        let text = self.texts.partition_point(|(start, ..)| *start <= span.start);
        let (start, name, lines) = &self.texts[text.saturating_sub(1)];
        let shown = |text: String| shortened(&printable_lines(&text));
        Finding {
            title: shown(title.into()),
            reason: shown(reason.into()),
            fix: shown(fix.into()),
            snippet: lines.snippet(name, span.start - start..span.end.saturating_sub(*start)),
            is_of_values: false,
        }
    }
}
