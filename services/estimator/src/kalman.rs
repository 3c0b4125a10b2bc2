//! Error-state Kalman filter on captured poses, with the frames already sent as its input.
//!
//! In the model thrust, gravity and the body rates of the on-board rate loop move the body. Thrust and rates follow the
//! radio's commands as first-order lags, so the sent frames determine them better than poses can:
//!
//! ```text
//!     ṗ = v          v̇ = g e3 − (T/m) R e3 + d          Ṙ = R S(ω + ω_bias)          p, v, d in {I}
//!     Ṫ = (T_frame − T)/τT        ω̇ = (ω_frame − ω)/τω        ḋ, ω̇_bias: white noise
//! ```
//!
//! The cameras track a point at r from the centre of mass, fixed in the body: a pose measures p + R r and R. r is stated, or
//! estimated where the vehicle tilts enough to make it observable. The published position is that of the tracked point, the
//! velocity that of the centre of mass: a controller that interprets R(ω × r) as motion of the vehicle is unstable.
//!
//! m, τT and τω are model parameters and not exact: d absorbs wind and the errors of mass and thrust, ω_bias the error of
//! the rates. Only the estimator uses them; the controller estimates the paper's b̂ and η̂.
//!
//! The error state (δp, δv, θ, δω_bias, δd, δr) ∈ R¹⁸ holds the attitude's error as a rotation vector in {B},
//! R_true = R exp S(θ): J. Solà, "Quaternion kinematics for the error-state Kalman filter" (2017), local angular
//! error, here with rotation matrices and without an accelerometer; equation numbers in this module are his.
//!
//! * [`attitude`]: logarithm and right Jacobian of SO(3);
//! * [`attitude_trust`]: plausibility of attitudes;
//! * [`commands`]: history of the commands that thrust and rates follow;
//! * [`motion`]: the nominal state and its step;
//! * [`error_state`]: the transition of its error, and the process noise;
//! * [`filter_state`]: nominal state and covariance: propagation, and correction by a pose;
//! * [`ground_contact`]: detection of the touch-down;
//! * [`scatter`]: noise of the cameras above the stated one;
//! * [`filter`]: selection of captures, restarts of the filter, prediction.

pub mod attitude;
pub mod attitude_trust;
pub mod commands;
pub mod error_state;
pub mod filter;
pub mod filter_state;
pub mod ground_contact;
pub mod motion;
pub mod scatter;
mod state;

pub use filter::{KalmanFilter, Outcome};
pub use state::KalmanState;
