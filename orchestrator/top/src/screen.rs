//! The terminal while it shows the view, and as it was before whenever that ends.

use std::io;
use std::mem::ManuallyDrop;

use ratatui::{DefaultTerminal, Frame};

/// A terminal in raw mode that shows its alternate screen. Dropped, it is as before; a panic restores it first, so
/// that its message is seen. No mouse is captured: a selection with it goes on to work.
pub struct Screen {
    // Never dropped: on a terminal that is gone its own end would panic.
    terminal: ManuallyDrop<DefaultTerminal>,
    _restored: Restored,
}

/// Gives the terminal back.
struct Restored;

impl Screen {
    /// Takes the terminal.
    ///
    /// # Errors
    /// If it cannot be had.
    pub fn enter() -> io::Result<Self> {
        // Whatever has been changed when this fails half-way is undone as well.
        let restored = Restored;
        Ok(Self {
            terminal: ManuallyDrop::new(ratatui::try_init()?),
            _restored: restored,
        })
    }

    /// Shows a picture, as large as the terminal is now.
    ///
    /// # Errors
    /// If the terminal is gone.
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
        // A panic has restored it already; once more would put the cursor onto its message.
        if !std::thread::panicking() {
            // A terminal that is gone needs nothing.
            let _ = ratatui::try_restore();
        }
    }
}
