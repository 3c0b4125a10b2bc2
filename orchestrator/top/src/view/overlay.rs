//! A framed text over the middle of the view.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;
use ratatui::widgets::{Block, Clear, Widget};

/// Columns of the overlay with its frame.
const WIDTH: u16 = 72;

/// Draws the overlay; nothing without lines.
pub(super) fn draw(title: &'static str, lines: &[impl AsRef<str>], area: Rect, buffer: &mut Buffer) {
    if lines.is_empty() {
        return;
    }
    let width = WIDTH.min(area.width);
    let height = u16::try_from(lines.len() + 2).map_or(area.height, |wanted| wanted.min(area.height));
    let place = Rect {
        x: area.x + (area.width - width) / 2,
        y: area.y + (area.height - height) / 2,
        width,
        height,
    };
    Clear.render(place, buffer);
    let block = Block::bordered().title(title);
    let inner = block.inner(place);
    block.render(place, buffer);
    for (text, row) in lines.iter().zip(inner.rows()) {
        Line::raw(text.as_ref()).render(row, buffer);
    }
}
