//! Gains of the control law that may change in flight.

use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Gains of the adaptive law that may change in flight: neither the layout of a state nor the schedule depends on them.
///
/// They are not part of a service's state. A host passes them to a service before the first step at which they apply
/// ([`Service::tune`](crate::Service::tune)), and again to a process that replaces a dead one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Gains {
    /// k1, gain on the position error, 1/s.
    pub k1: f64,
    /// k2, gain on the velocity error, 1/s.
    pub k2: f64,
    /// k3, gain on the angular velocity error.
    pub k3: f64,
    /// β, weight of the angular velocity error in the Lyapunov function.
    pub beta: f64,
    /// λm, gain of the estimator of η.
    pub lambda_mass: f64,
    /// Diagonal of Λb, gains of the estimator of b.
    pub lambda_disturbance: [f64; 3],
    /// Gain of the estimator of w: Λw is this times the identity.
    pub lambda_inertia: f64,
    /// κ, weight of the prediction error beside z2 in the estimators of η and b, s.
    pub prediction_gain: f64,
}
