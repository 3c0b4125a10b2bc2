//! Ports of an estimator without sensors of flight outdoors.

use shared_types::service::{InputView, OutputSlot};

/// Returns all inputs: a capture and a frame.
pub fn inputs<'a>(pose: InputView<'a>, frame: InputView<'a>) -> [InputView<'a>; 7] {
    let none = InputView::default();
    [pose, frame, none, none, none, none, none]
}

/// Returns all outputs: a state.
pub fn outputs(state: Option<&mut [u8]>) -> [OutputSlot<'_>; 4] {
    [
        OutputSlot { bytes: state },
        OutputSlot::default(),
        OutputSlot::default(),
        OutputSlot::default(),
    ]
}
