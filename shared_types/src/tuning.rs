//! Gains of the control law that may change in flight, each declared once.

use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Calls a macro with the gains that may change in flight, in two groups between which `[controller]` has other keys.
///
/// Each has its description, its type, the form of its key, its range and its symbol. The forms are `stated(default)`,
/// `follows(rule)`, of a key that is computed from others unless stated, and `absent(value)`, of a key without which
/// that value holds.
#[macro_export]
macro_rules! with_gains {
    ($callback:ident) => {
        $callback! {
            {
                /// k1, gain on the position error.
                k1: f64 = stated(4.0), positive, "k1";
                /// k2, gain on the velocity error.
                k2: f64 = stated(4.0), positive, "k2";
                /// k3, gain on the angular velocity error.
                k3: f64 = stated(13.0), positive, "k3";
                /// β, weight of the angular velocity error in the Lyapunov function; follows from `initial.inertia` unless stated.
                beta: f64 = follows(Scenario::beta), positive, "β";
            }
            {
                /// λm, adaptation gain of η̂; with 0 the estimate stays where it begins.
                lambda_mass: f64 = stated(0.3), not_negative, "λm";
                /// Diagonal of Λb, adaptation gains of b̂; with 0 the estimate stays where it begins.
                lambda_disturbance: [f64; 3] = stated([1.0; 3]), not_negative, "Λb";
                /// Λw is this times the identity, adaptation gain of ŵ; 0 holds the estimate; follows from the other gains unless stated.
                lambda_inertia: f64 = follows(Scenario::lambda_inertia), not_negative, "Λw";
                /// κ, weight of the prediction error beside z2 in the estimators of η and b, s; none in the paper.
                prediction_gain: f64 = absent(0.0), not_negative, "κ";
            }
        }
    };
}

macro_rules! gains {
    ($({$(
        $(#[doc = $doc:literal])+
        $gain:ident: $type:ty = $form:ident($value:expr), $range:ident, $symbol:literal;
    )+})+) => {
        /// Gains of the adaptive law that may change in flight: neither the layout of a state nor the schedule depends on them.
        ///
        /// They are no part of a service's state. A host gives them to a service before the first step for which they hold
        /// ([`Service::tune`](crate::Service::tune)), and again to a process that replaces a dead one.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, FromBytes, IntoBytes, Immutable)]
        #[repr(C)]
        pub struct Gains {$($(
            $(#[doc = $doc])+
            pub $gain: $type,
        )+)+}

        impl Gains {
            /// Names of the gains, which are those of their keys in `[controller]`.
            pub const NAMES: &[&str] = &[$($(stringify!($gain),)+)+];
        }
    };
}
with_gains!(gains);
