//! The meanings of the keys and of the words of the view.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;
use ratatui::widgets::{Block, Clear, Widget};

const TEXT: [&str; 20] = [
    "↑ ↓       select a service",
    "k         kill it (SIGKILL), after a y    only with",
    "f         freeze it (SIGSTOP), after a y  --allow-faults",
    "?         this help; any key closes it",
    "q, Esc    leave; Ctrl-C leaves from everywhere",
    "",
    "Hz        steps in the last second; down: dead or being started",
    "step      how long its steps of the last second took",
    "wake      how long after it could have stepped it began to",
    "age       of its oldest input at its last step; none: never had one",
    "miss      steps left out since the start",
    "late      inputs that came too late since the start",
    "died      how often it died and was restarted",
    "",
    "capture → frame   from a capture to the frame that rests on it,",
    "                  in the last second",
    "distance  from the path: the true one, in a laboratory the estimated one",
    "m̂         estimate of the mass",
    "‖b̂‖       estimate of the disturbance, its size",
    "Bars are the largest of their time; empty: nothing was known.",
];

/// Columns of the text and of its frame.
const WIDTH: u16 = 72;

/// Draws it over the middle of the view.
pub(super) fn draw(area: Rect, buffer: &mut Buffer) {
    let width = WIDTH.min(area.width);
    let height = (TEXT.len() as u16 + 2).min(area.height);
    let place = Rect {
        x: area.x + (area.width - width) / 2,
        y: area.y + (area.height - height) / 2,
        width,
        height,
    };
    Clear.render(place, buffer);
    let block = Block::bordered().title(" help ");
    let inner = block.inner(place);
    block.render(place, buffer);
    for (text, row) in TEXT.iter().zip(inner.rows()) {
        Line::raw(*text).render(row, buffer);
    }
}
