//! The texts that a scenario is made of, the file's and those of the `--set` arguments, and the places in them.
//!
//! The texts share one range of offsets: the file comes first, each argument after it. So every value of the
//! merged document, wherever it came from, knows its place by one span.

use std::ops::Range;
use std::sync::Arc;

use miette::NamedSource;

use super::Finding;

/// The texts, each with its first offset.
#[derive(Debug)]
pub(super) struct Sources {
    texts: Vec<(usize, Arc<NamedSource<String>>)>,
}

impl Sources {
    pub(super) fn new(file_name: &str, file: &str, arguments: &[String]) -> Self {
        let argument_names = arguments.iter().map(|argument| ("--set", argument.as_str()));
        let mut start = 0;
        let texts = std::iter::once((file_name, file))
            .chain(argument_names)
            .map(|(name, text)| {
                let source = (start, Arc::new(NamedSource::new(name, shown(text))));
                // One more than the text, so that its end is not the next one's beginning.
                start += text.len() + 1;
                source
            })
            .collect();
        Self { texts }
    }

    /// The arguments in their order, each with its first offset.
    pub(super) fn arguments(&self) -> impl Iterator<Item = (usize, &str)> {
        self.texts[1..]
            .iter()
            .map(|(start, source)| (*start, source.inner().as_str()))
    }

    /// Something that is wrong at a place.
    pub(super) fn finding(
        &self,
        span: Range<usize>,
        title: impl Into<String>,
        reason: impl Into<String>,
        fix: impl Into<String>,
    ) -> Finding {
        let text = self.texts.partition_point(|(start, _)| *start <= span.start);
        let (start, source) = &self.texts[text.saturating_sub(1)];
        Finding {
            title: title.into(),
            reason: reason.into(),
            fix: fix.into(),
            source_code: source.clone(),
            span: within_line(
                source.inner(),
                span.start - start..span.end.saturating_sub(*start),
            )
            .into(),
        }
    }
}

/// A text as a snippet can show it: an empty one has no line to point at.
fn shown(text: &str) -> String {
    if text.is_empty() { "\n" } else { text }.to_owned()
}

/// The part of a span that lies in its first line and inside the text.
fn within_line(text: &str, span: Range<usize>) -> Range<usize> {
    let start = text.floor_char_boundary(span.start.min(text.len().saturating_sub(1)));
    let line_end = text[start..]
        .find(['\r', '\n'])
        .map_or(text.len(), |length| start + length);
    let end = text.ceil_char_boundary(span.end).min(line_end);
    start..end.max(start)
}
