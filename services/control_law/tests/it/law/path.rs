//! The paper's tilted figure of eight (27) with its derivatives.

use nalgebra::Vector3;
use shared_types::rotation::paper_rx;
use std::f64::consts::{FRAC_PI_2, PI};

/// pd and its first three derivatives by γ: Rx(π/20) [ℓ sin wγ cos wγ, ℓ sin wγ, −1.2]ᵀ, ℓ = 1.2, w = 0.6.
pub(crate) fn tilted_eight(gamma: f64) -> [Vector3<f64>; 4] {
    const SIZE: f64 = 1.2;
    const W: f64 = 0.6;
    let tilt = paper_rx(PI / 20.0);
    let (mut x_scale, mut y_scale, mut quarter_turns) = (0.5 * SIZE, SIZE, 0.0);
    [-1.2, 0.0, 0.0, 0.0].map(|z| {
        let x = x_scale * libm::sin(2.0 * W * gamma + quarter_turns * FRAC_PI_2);
        let y = y_scale * libm::sin(W * gamma + quarter_turns * FRAC_PI_2);
        x_scale *= 2.0 * W;
        y_scale *= W;
        quarter_turns += 1.0;
        tilt * Vector3::new(x, y, z)
    })
}
