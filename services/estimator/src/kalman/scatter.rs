//! Noise of the cameras, estimated from the captures.
//!
//! The stated deviations are a guess. If the cameras scatter more, a filter with the stated deviations follows the noise and
//! refuses good captures, and the vehicle turns over. For the innovation ν of a capture and white noise
//!
//! ```text
//!     ½ E‖νₖ − νₖ₋₁‖²/3 ≈ V + P          for position and attitude each
//! ```
//!
//! A running mean of that less P estimates V. A difference contains only the noise from capture to capture: a jump counts
//! only at its beginning and its end, a slightly wrong model almost not. Neither is noise, and V must not grow by them.
//!
//! The filter uses the larger of the stated noise and a quarter (`TRUSTED`) of that mean. For cameras as stated, this is the
//! stated noise, bit for bit.

use nalgebra::{SMatrix, SVector};

use super::filter_state::{MEASURED, PoseNoise};

/// Time constant of the mean, in captures.
const CAPTURES: f64 = 20.0;

/// Share of the scatter that counts: deviations of up to twice the stated ones have no effect.
const TRUSTED: f64 = 0.25;

/// Maximum contribution of one capture, in means: a jump adds 40 % to the mean, and noise of ten times the deviation is
/// detected after a dozen captures.
const LARGEST_SHARE: f64 = 9.0;

/// Scatter of the captures.
#[derive(Clone, Copy, Debug)]
pub struct Scatter {
    /// Mean of the observed variances.
    pub(super) seen: PoseNoise,
    /// Innovation of the previous capture; 0 if the filter started from it.
    pub(super) innovation: SVector<f64, MEASURED>,
}

impl Scatter {
    /// Makes the scatter of cameras as stated.
    #[must_use]
    pub fn new(stated: PoseNoise) -> Self {
        Self {
            seen: stated,
            innovation: SVector::zeros(),
        }
    }

    /// Adds the innovation of a capture, used or not; `p` is the covariance of the estimated pose.
    pub fn observe(
        &mut self,
        innovation: &SVector<f64, MEASURED>,
        p: &SMatrix<f64, MEASURED, MEASURED>,
        stated: PoseNoise,
    ) {
        let difference = innovation - self.innovation;
        self.innovation = *innovation;
        let parts = [
            (0, &mut self.seen.position, stated.position),
            (3, &mut self.seen.attitude, stated.attitude),
        ];
        for (measured, mean, stated) in parts {
            let unsure = p.fixed_view::<3, 3>(measured, measured).trace();
            let variance = (0.5 * difference.fixed_rows::<3>(measured).norm_squared() - unsure) / 3.0;
            let counted = variance.clamp(0.0, LARGEST_SHARE * mean.max(stated));
            *mean += (counted - *mean) / CAPTURES;
        }
    }

    /// Returns the noise that the filter uses.
    #[must_use]
    pub fn noise(&self, stated: PoseNoise) -> PoseNoise {
        PoseNoise {
            position: stated.position.max(TRUSTED * self.seen.position),
            attitude: stated.attitude.max(TRUSTED * self.seen.attitude),
        }
    }
}
