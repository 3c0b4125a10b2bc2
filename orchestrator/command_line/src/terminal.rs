//! Terminal output of text from other programs.

use std::io::{self, Write};

use scenario_file::printable::printable_lines;

/// Writer that passes each line to a terminal as [`printable_lines`].
#[derive(Debug)]
pub struct Terminal<W: Write> {
    screen: W,
    line: Vec<u8>,
}

impl<W: Write> Terminal<W> {
    pub fn new(screen: W) -> Self {
        let line = Vec::new();
        Self { screen, line }
    }

    fn show(&mut self) -> io::Result<()> {
        let line = String::from_utf8_lossy(&self.line);
        let shown = self.screen.write_all(printable_lines(&line).as_bytes());
        self.line.clear();
        shown
    }
}

impl<W: Write> Write for Terminal<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for piece in bytes.split_inclusive(|&byte| byte == b'\n') {
            self.line.extend_from_slice(piece);
            if piece.ends_with(b"\n") {
                self.show()?;
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.show()?;
        self.screen.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_come_in_pieces_are_shown_whole() {
        let mut terminal = Terminal::new(Vec::new());
        let text = "é\u{9b}1m\n\x1b[2J";
        text.as_bytes()
            .chunks(1)
            .for_each(|piece| terminal.write_all(piece).unwrap());
        terminal.flush().unwrap();
        assert_eq!(
            String::from_utf8(terminal.screen).unwrap(),
            "é\\u009b1m\n\\u001b[2J"
        );
    }
}
