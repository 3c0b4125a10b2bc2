//! One step along the vector field: the classical Runge–Kutta method of fourth order, and R back to SO(3).
//!
//! The four stages treat R as any matrix. That leaves SO(3) by O(h⁵), so one polar iteration at the end moves R
//! by no more than the method's own error: the order stays four, and what is left of the defect is the square
//! of O(h⁵), far below rounding at any step that flies. Runge–Kutta–Munthe-Kaas methods reach the same order
//! with sines and cosines in every stage, at several times the cost and with no smaller an error here.

use shared_types::rotation::orthonormalized;

use crate::rigid_body::{Motion, MotionRate};

/// The motion `h` s later along the field ẋ = `rate`(x); a negative `h` goes back in time.
#[must_use]
#[inline]
pub fn advanced(motion: &Motion, h: f64, rate: impl Fn(&Motion) -> MotionRate) -> Motion {
    let k1 = rate(motion);
    let k2 = rate(&motion.moved(&k1, 0.5 * h));
    let k3 = rate(&motion.moved(&k2, 0.5 * h));
    let k4 = rate(&motion.moved(&k3, h));
    let end = motion.moved(&(k1 + (k2 + k3) * 2.0 + k4), h / 6.0);
    Motion {
        world_from_body: orthonormalized(&end.world_from_body),
        ..end
    }
}
