//! Invariants of every frame that a decoder gives.

use motion_capture::wire::{Frame, MOST_BODIES};

/// Panics unless every pose is one.
pub fn check(frame: &Frame) {
    assert!(frame.bodies().len() <= MOST_BODIES);
    for pose in frame.bodies().iter().filter_map(|body| body.pose) {
        assert!(pose.position.iter().all(|coordinate| coordinate.abs() <= 1e3));
        assert!((pose.capture_from_markers.determinant() - 1.0).abs() < 1e-9);
    }
}
