//! The terminal in raw mode, restored whenever the view ends.

use std::io;
use std::mem::ManuallyDrop;

use ratatui::{DefaultTerminal, Frame};

/// Terminal in raw mode that shows its alternate screen. Dropping it restores the terminal; a panic restores it first,
/// so that its message is visible. The mouse is not captured: selecting text still works.
pub struct Screen {
    // Never dropped: its own `Drop` would panic on a closed terminal.
    terminal: ManuallyDrop<DefaultTerminal>,
    _restored: Restored,
}

/// Guard that restores the terminal.
struct Restored;

impl Screen {
    /// Switches the terminal to raw mode.
    ///
    /// # Errors
    /// If the terminal refuses.
    pub fn enter() -> io::Result<Self> {
        // The guard exists first: a half-completed initialisation is undone as well.
        let restored = Restored;
        Ok(Self {
            terminal: ManuallyDrop::new(ratatui::try_init()?),
            _restored: restored,
        })
    }

    /// Draws a frame at the terminal's current size.
    ///
    /// # Errors
    /// If the terminal was closed.
    pub fn draw(&mut self, picture: impl FnOnce(&mut Frame)) -> io::Result<()> {
        self.terminal.draw(picture).map(|_| ())
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.terminal.show_cursor();
    }
}

impl Drop for Restored {
    fn drop(&mut self) {
        // The panic hook has restored it already; a second time would move the cursor onto its message.
        if !std::thread::panicking() {
            // Errors of a closed terminal are ignored.
            let _ = ratatui::try_restore();
        }
    }
}
