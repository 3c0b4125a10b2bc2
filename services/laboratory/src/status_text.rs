//! Text of a driver's status about refusals, without allocations.

use std::fmt::Write;

/// Period of the text, ns.
const PERIOD_NS: u64 = 100_000_000;

/// Text of fixed capacity.
pub(super) struct StatusText {
    pub(super) bytes: [u8; 200],
    pub(super) length: usize,
    due_ns: u64,
}

impl Default for StatusText {
    fn default() -> Self {
        Self {
            bytes: [0; 200],
            length: 0,
            due_ns: 0,
        }
    }
}

impl StatusText {
    /// Replaces the text, if its period is over.
    pub(super) fn update(&mut self, now_ns: u64, write: impl FnOnce(&mut Self) -> std::fmt::Result) {
        if now_ns < self.due_ns {
            return;
        }
        *self = Self {
            due_ns: now_ns + PERIOD_NS,
            ..Self::default()
        };
        // An error means that the text is full.
        let _ = write(self);
    }
}

impl Write for StatusText {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        let length = text.floor_char_boundary(self.bytes.len() - self.length);
        self.bytes[self.length..][..length].copy_from_slice(&text.as_bytes()[..length]);
        self.length += length;
        if length < text.len() {
            return Err(std::fmt::Error);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_that_are_too_long_are_cut_between_characters() {
        let mut reason = StatusText::default();
        write!(reason, "µ{}", "x".repeat(50)).unwrap();
        assert_eq!(reason.length, 52);
        assert!(write!(reason, "{}", "µ".repeat(200)).is_err());
        let text = std::str::from_utf8(&reason.bytes[..reason.length]).unwrap();
        assert_eq!(text.chars().filter(|character| *character == 'µ').count(), 75);
        assert!(write!(reason, "more").is_err());
    }
}
