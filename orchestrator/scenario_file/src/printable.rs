//! Escapes untrusted text for a terminal.
//!
//! A description in a log, a name in a packet or the output of another user's run may contain control sequences, which move
//! the cursor, rename the window, insert input, or change the direction of text. All output of `gerono` to a terminal is
//! escaped by [`printable_lines`], and text within a line by [`printable`], so that it cannot add lines.

use std::borrow::Cow;
use std::error::Error;
use std::fmt::Write;
use std::iter::successors;

use miette::Report;

/// Escapes a line of text: every control character as `\u001b`, like JSON.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, is_control)
}

/// Maximum length of a word in a message, such as a name from a file, characters.
const MAX_WORD: usize = 200;

/// Maximum length of a message, characters: ten lines of a wide terminal, and far below the maximum width of a format.
const MAX_TEXT: usize = 2000;

/// Truncates a message and its long words: names and values come from files and arguments of any size.
#[must_use]
pub fn shortened(text: &str) -> String {
    let mut short = String::new();
    let (mut in_text, mut in_word) = (0, 0);
    for character in text.chars() {
        in_word = if character.is_whitespace() { 0 } else { in_word + 1 };
        if in_word == MAX_WORD {
            short.push('…');
        }
        if in_word >= MAX_WORD {
            continue;
        }
        in_text += 1;
        if in_text == MAX_TEXT {
            short.push('…');
            break;
        }
        short.push(character);
    }
    short
}

/// Escapes lines of text: as [`printable`], except for line breaks and tabs.
#[must_use]
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |character| {
        is_control(character) && !matches!(character, '\n' | '\t')
    })
}

/// Replaces every control character except tabs in a line by as many bytes, so that positions do not change.
#[must_use]
pub fn printable_in_place(line: &str) -> String {
    let mut printable = String::with_capacity(line.len());
    for character in line.chars() {
        if is_control(character) && character != '\t' {
            (0..character.len_utf8()).for_each(|_| printable.push('?'));
        } else {
            printable.push(character);
        }
    }
    printable
}

fn escaped(text: &str, is_unwanted: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_unwanted) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        if is_unwanted(character) {
            // All of them are below U+FFFF. Writing to a string does not fail.
            let _ = write!(escaped, "\\u{:04x}", u32::from(character));
        } else {
            escaped.push(character);
        }
    }
    Cow::Owned(escaped)
}

/// Returns whether a terminal interprets a character, or reorders text by it, instead of showing it.
fn is_control(character: char) -> bool {
    character.is_control()
        || matches!(
            character,
            // Line and paragraph separators, and direction marks.
            '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
        )
}

/// Returns the report of an error for a terminal: its message, and below it the causes that no message above contains.
///
/// Many messages contain their cause before the fix.
#[must_use]
pub fn report_of(error: &(dyn Error + 'static)) -> Report {
    let mut messages: Vec<String> = Vec::new();
    for error in successors(Some(error), |&error| error.source()) {
        let text = printable_lines(&error.to_string()).into_owned();
        if !messages.iter().any(|message| message.contains(&text)) {
            messages.push(text);
        }
    }
    let innermost = Report::msg(messages.pop().unwrap_or_default());
    messages.into_iter().rev().fold(innermost, Report::wrap_err)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn long_words_and_long_texts_are_cut_and_others_are_not() {
        let sentence = "`controller.k1` is unknown: there is no key `k1` here";
        assert_eq!(shortened(sentence), sentence);
        let exactly = "é".repeat(199);
        assert_eq!(shortened(&exactly), exactly);
        let name = "x".repeat(70_000);
        let cut = shortened(&format!("there is no key `{name}` here"));
        assert_eq!(cut, format!("there is no key `{}… here", "x".repeat(198)));
        let values = "1.0 ".repeat(20_000);
        assert_eq!(shortened(&values).chars().count(), 2000);
    }

    #[test]
    fn sequences_are_shown_instead_of_obeyed() {
        let hostile = "a\x1b]0;owned\x07\x1b[2Jb\u{9b}31mc\u{202e}d\re\nf";
        assert_eq!(
            printable(hostile),
            r"a\u001b]0;owned\u0007\u001b[2Jb\u009b31mc\u202ed\u000de\u000af"
        );
        assert_eq!(printable_lines("one\n\ttwo\x7f"), "one\n\ttwo\\u007f");
    }

    #[test]
    fn ordinary_text_is_not_copied() {
        let text = "‖z1‖ of the eight, 0.25 cm: “good”";
        assert!(matches!(printable(text), Cow::Borrowed(_)));
    }

    proptest! {
        #[test]
        fn nothing_that_is_obeyed_is_left(text: String) {
            prop_assert!(!printable(&text).contains(is_control));
            let lines = printable_lines(&text);
            prop_assert!(!lines.contains(|character| is_control(character) && !matches!(character, '\n' | '\t')));
        }

        #[test]
        fn json_means_the_same_as_before(text: String) {
            let json = serde_json::to_string_pretty(&serde_json::json!({"text": text})).unwrap();
            let read: serde_json::Value = serde_json::from_str(&printable_lines(&json)).unwrap();
            prop_assert_eq!(read["text"].as_str(), Some(text.as_str()));
        }

        #[test]
        fn places_stay_where_they_were(text: String) {
            let replaced = printable_in_place(&text);
            prop_assert_eq!(replaced.len(), text.len());
            let kept = text.char_indices().filter(|(_, character)| !is_control(*character));
            for (place, character) in kept {
                prop_assert!(replaced[place..].starts_with(character));
            }
        }
    }

    #[derive(Debug, thiserror::Error)]
    enum Level {
        #[error("the disk is full\x1b[2J")]
        Disk,
        #[error("cannot write z1.svg: {0}; make room")]
        Write(#[source] Box<Level>),
        #[error("no figure was drawn")]
        Draw(#[source] Box<Level>),
    }

    #[test]
    fn every_cause_is_told_once_and_harmless() {
        let disk = Box::new(Level::Disk);
        let report = report_of(&Level::Draw(Box::new(Level::Write(disk))));
        let messages: Vec<_> = report.chain().map(ToString::to_string).collect();
        let cause = r"cannot write z1.svg: the disk is full\u001b[2J; make room";
        assert_eq!(messages, ["no figure was drawn", cause]);
    }
}
