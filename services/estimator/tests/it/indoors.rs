//! Inputs of an estimator without sensors of flight outdoors.

use shared_types::service::InputView;

/// Returns all inputs: a capture and a frame.
pub fn inputs<'a>(pose: InputView<'a>, frame: InputView<'a>) -> [InputView<'a>; 6] {
    let none = InputView::default();
    [pose, frame, none, none, none, none]
}
