//! An error-state Kalman filter on captured poses, with the frames already sent as its input.
//!
//! The body is where thrust, gravity and the body rates of the on-board rate loop carry it. Both follow what the
//! radio says as first-order lags, so that the frames already sent tell them better than poses ever could:
//!
//! ```text
//!     ṗ = v          v̇ = g e3 − (T/m) R e3 + d          Ṙ = R S(ω + ω_bias)          p, v, d in {I}
//!     Ṫ = (T_frame − T)/τT        ω̇ = (ω_frame − ω)/τω        ḋ, ω̇_bias: white noise
//! ```
//!
//! m, τT and τω are believed, not known: d takes up wind and what mass and thrust are wrong by, ω_bias what the
//! rates are wrong by. They serve the state alone; the paper's b̂ and η̂ are estimated by the controller.
//!
//! The error state (δp, δv, θ, δω_bias, δd) ∈ R¹⁵ holds the attitude's error as a rotation vector in {B},
//! R_true = R exp S(θ): J. Solà, "Quaternion kinematics for the error-state Kalman filter" (2017), local angular
//! error, here with rotation matrices and without an accelerometer; equation numbers in this module are his.
//!
//! * [`attitude`]: logarithm and right Jacobian of SO(3);
//! * [`commands`]: what thrust and rates follow, and when;
//! * [`motion`]: the nominal state and its step;
//! * [`error_state`]: the transition of its error, and the noise that enters;
//! * [`filter_state`]: nominal state and covariance together: propagation and the use of a pose;
//! * [`scatter`]: the noise of the cameras, if it is more than stated;
//! * [`filter`]: which captures are used, when the filter starts anew, prediction.

pub mod attitude;
pub mod commands;
pub mod error_state;
pub mod filter;
pub mod filter_state;
pub mod motion;
pub mod scatter;
mod state;

pub use filter::{KalmanFilter, Outcome};
pub use state::KalmanState;
