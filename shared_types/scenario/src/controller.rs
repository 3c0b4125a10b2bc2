//! Gains and bounds of the control law.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Baseline, LawKind, Scenario, Vector};
use crate::range::{between, moment, not_negative, not_zero, positive};
use shared_types::Gains;
use shared_types::wiring::ServiceId;

/// Expands a gain's key by its form: type, default, value in a scenario, and key that states a value.
macro_rules! form {
    (type stated $type:ty) => { $type };
    (type $form:ident $type:ty) => { Option<$type> };
    (default stated $default:expr) => { $default };
    (default $form:ident $value:expr) => { None };
    (value stated $default:expr, $key:expr, $scenario:expr) => { $key };
    (value follows $rule:expr, $key:expr, $scenario:expr) => { $rule($scenario) };
    (value absent $value:expr, $key:expr, $scenario:expr) => { $key.unwrap_or($value) };
    (key stated $default:expr, $before:expr, $gain:expr) => { $gain };
    (key follows $rule:expr, $before:expr, $gain:expr) => { Some($gain) };
    (key absent $value:expr, $before:expr, $gain:expr) => {
        ($before.is_some() || $gain != $value).then_some($gain)
    };
}

macro_rules! controller {
    (
        {$(
            $(#[doc = $law_doc:literal])+
            $law:ident: $law_type:ty = $law_form:ident($law_value:expr), $law_range:ident, $law_symbol:literal;
        )+}
        {$(
            $(#[doc = $doc:literal])+
            $gain:ident: $type:ty = $form:ident($value:expr), $range:ident, $symbol:literal;
        )+}
    ) => {
        /// Gains, bounds and initial estimates of the adaptive law.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Controller {
            /// Control law: the paper's, or a baseline for comparison, which needs `rates`.
            #[serde(skip_serializing_if = "LawKind::is_adaptive")]
            pub law: LawKind,
            /// Gains of the baselines.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub baseline: Option<Baseline>,
            $(
                $(#[doc = $law_doc])+
                #[serde(skip_serializing_if = "Stated::is_left_out")]
                #[schemars(transform = $law_range, extend("x-tunable" = true, "x-symbol" = $law_symbol))]
                pub $law: form!(type $law_form $law_type),
            )+
            /// δ, the value to which the velocity error is driven along the thrust axis, m/s.
            #[schemars(transform = not_zero, extend("x-symbol" = "δ", "x-hint" = "the angular velocity (18) divides by it; the paper uses 0.1"))]
            pub delta: f64,
            /// σmax, saturation level; above δ/k1.
            #[schemars(transform = positive, extend("x-symbol" = "σmax"))]
            pub sigma_max: f64,
            $(
                $(#[doc = $doc])+
                #[serde(skip_serializing_if = "Stated::is_left_out")]
                #[schemars(transform = $range, extend("x-tunable" = true, "x-symbol" = $symbol))]
                pub $gain: form!(type $form $type),
            )+
            /// Estimators of the part of the disturbance that is periodic in the path; none in the paper.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub harmonics: Option<Harmonics>,
            /// `true` if the law adds the acceleration that the estimates do not explain to b, as a disturbance observer does;
            /// an ablation, without a proof.
            #[serde(skip_serializing_if = "std::ops::Not::not")]
            pub disturbance_observer: bool,
            /// Known bounds of the unknown parameters.
            pub bounds: Bounds,
            /// Initial values of the estimates.
            pub initial: InitialEstimates,
            /// `true` if the law compensates for the offset below the path that δ causes, so that z1 → 0; not in the paper.
            pub remove_offset: bool,
            /// Commands of thrust and body rates instead of thrust and torque, for a vehicle with an on-board rate loop.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub rates: Option<RateCommand>,
            /// Gain γ of the immersion-and-invariance mass observer, which runs in parallel and is recorded, not used; none
            /// unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(transform = positive, extend("x-symbol" = "γ"))]
            pub observer_gain: Option<f64>,
            /// Planned changes of gains in flight.
            #[serde(skip_serializing_if = "Vec::is_empty")]
            pub change: Vec<ControllerChange>,
            /// Names of the numbers that a plug-in or program in place of the controller publishes on `control/telemetry`.
            #[serde(skip_serializing_if = "Vec::is_empty")]
            pub telemetry: Vec<String>,
        }

        impl Default for Controller {
            fn default() -> Self {
                Self {
                    law: LawKind::Adaptive,
                    baseline: None,
                    $($law: form!(default $law_form $law_value),)+
                    delta: 0.1,
                    sigma_max: 1.5,
                    $($gain: form!(default $form $value),)+
                    harmonics: None,
                    disturbance_observer: false,
                    bounds: Bounds::default(),
                    initial: InitialEstimates::default(),
                    remove_offset: false,
                    rates: None,
                    observer_gain: None,
                    change: Vec::new(),
                    telemetry: Vec::new(),
                }
            }
        }
    };
}
shared_types::with_gains!(controller);

/// Value of a gain's key.
trait Stated {
    /// Returns whether the key is omitted.
    fn is_left_out(&self) -> bool {
        false
    }
}

impl Stated for f64 {}

impl Stated for Vector {}

impl<T> Stated for Option<T> {
    fn is_left_out(&self) -> bool {
        self.is_none()
    }
}

macro_rules! changes {
    ($({$(
        $(#[doc = $doc:literal])+
        $gain:ident: $type:ty = $form:ident($value:expr), $range:ident, $symbol:literal;
    )+})+) => {
        /// Change of gains in flight: stated values take effect immediately, the others do not change.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct ControllerChange {
            /// Time of the change, s.
            #[schemars(transform = moment)]
            pub at: f64,
            $($(
                #[doc = concat!("New ", $symbol, ".")]
                #[serde(default, skip_serializing_if = "Option::is_none")]
                #[schemars(transform = $range, extend("x-symbol" = $symbol))]
                pub $gain: Option<$type>,
            )+)+
        }

        impl ControllerChange {
            /// Returns the gains after the change.
            #[must_use]
            pub fn apply_to(&self, gains: &Gains) -> Gains {
                Gains {$($($gain: self.$gain.unwrap_or(gains.$gain),)+)+}
            }
        }

        impl std::fmt::Display for ControllerChange {
            /// Lists the new values, numbers before vectors.
            fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                let mut stated = Vec::new();
                $($(stated.extend(self.$gain.map(|gain| (size_of_val(&gain), format!("{} {gain:?}", $symbol))));)+)+
                stated.sort_by_key(|(size, _)| *size);
                let stated: Vec<_> = stated.into_iter().map(|(_, text)| text).collect();
                formatter.write_str(&stated.join(", "))
            }
        }

        impl Scenario {
            /// Returns the gains that may change in flight, including derived ones.
            #[must_use]
            pub fn gains(&self) -> Gains {
                Gains {$($($gain: form!(value $form $value, self.controller.$gain, self),)+)+}
            }
        }

        impl Controller {
            /// Returns the controller with these gains stated. A κ of 0 counts as not stated.
            #[must_use]
            pub fn with_gains(&self, gains: &Gains) -> Self {
                Self {
                    $($($gain: form!(key $form $value, self.$gain, gains.$gain),)+)+
                    ..self.clone()
                }
            }
        }
    };
}
shared_types::with_gains!(changes);

/// Harmonics of the disturbance in the path parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Harmonics {
    /// N, number of harmonics.
    #[schemars(transform = between(1, Self::MAX))]
    pub count: u8,
    /// λa, adaptation gain of each harmonic.
    #[schemars(transform = not_negative, extend("x-symbol" = "λa"))]
    pub gain: f64,
    /// Maximum distance from the path at which they adapt, m, so that they do not adapt to single events.
    #[schemars(transform = positive)]
    pub within: f64,
}

impl Harmonics {
    /// Maximum number of harmonics.
    pub const MAX: u8 = 8;
}

impl Default for Harmonics {
    fn default() -> Self {
        Self {
            count: Self::MAX,
            gain: 1.0,
            within: 0.3,
        }
    }
}

impl Controller {
    /// Returns σ⁻¹(δ/k1), the theorem's ultimate bound on ‖z1‖, m.
    #[must_use]
    pub fn ultimate_bound(&self) -> f64 {
        libm::atanh(self.delta.abs() / (self.k1 * self.sigma_max))
    }
}

impl Scenario {
    /// Returns the theorem's ultimate bound on the distance from the path, m. `None` if the theorem does not apply: to an
    /// external service, with estimators switched off, with gains that change in flight, or with `remove_offset`.
    #[must_use]
    pub fn theorem_bound(&self) -> Option<f64> {
        let law = &self.controller;
        let adapts = law.lambda_mass > 0.0 && law.lambda_disturbance.iter().all(|&gain| gain > 0.0);
        let is_ours = law.law.is_adaptive() && !self.is_foreign(ServiceId::Controller);
        (is_ours && adapts && law.change.is_empty() && !law.remove_offset).then(|| law.ultimate_bound())
    }
}

/// Commands of body rates: the torque drives an artificial angular velocity, which is the command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RateCommand {
    /// kp of the yaw law (28), 1/s.
    #[schemars(transform = not_negative, extend("x-symbol" = "kp"))]
    pub yaw_kp: f64,
    /// ki of the yaw law (28), 1/s².
    #[schemars(transform = not_negative, extend("x-symbol" = "ki"))]
    pub yaw_ki: f64,
    /// Maximum magnitude of the yaw law's integral term, rad/s: the largest drift to be compensated. It is frozen while the
    /// proportional term is larger.
    #[schemars(transform = not_negative)]
    pub yaw_integral_max: f64,
    /// Integration step of the artificial angular velocity over the hold of a frame, s.
    #[schemars(transform = positive)]
    pub roll_out_step: f64,
    /// `true` if vehicle and path are predicted over the hold, `false` to use their state at its start.
    pub roll_out: bool,
    /// `true` if the estimated acceleration that the estimates of mass and disturbance do not explain also acts in the
    /// roll-out.
    pub unexplained: bool,
    /// `true` if commands compensate for the modelled lags of thrust and rates.
    pub lag_inversion: bool,
}

impl Default for RateCommand {
    fn default() -> Self {
        Self {
            yaw_kp: 4.0,
            yaw_ki: 0.5,
            yaw_integral_max: 0.5,
            roll_out_step: 0.001,
            roll_out: true,
            unexplained: true,
            lag_inversion: true,
        }
    }
}

impl RateCommand {
    /// Returns the number of roll-out steps over a hold (s), a whole number.
    #[must_use]
    pub fn steps(&self, hold: f64) -> f64 {
        libm::round(hold / self.roll_out_step).max(1.0)
    }
}

/// Bounds of the unknown parameters (Assumption 1), and the excess of the smooth projection (5) over them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Bounds {
    /// mmin, kg.
    #[schemars(transform = positive, extend("x-symbol" = "mmin"))]
    pub mass_min: f64,
    /// mmax, kg.
    #[schemars(transform = positive, extend("x-symbol" = "mmax"))]
    pub mass_max: f64,
    /// bmax of each component of b, m/s².
    #[schemars(transform = positive, extend("x-symbol" = "bmax"))]
    pub disturbance: f64,
    /// ε of the projection of η̂, 1/kg; below 1/mmax.
    #[schemars(transform = positive, extend("x-symbol" = "ε of η̂"))]
    pub epsilon_eta: f64,
    /// ε of the projection of b̂, m/s².
    #[schemars(transform = positive, extend("x-symbol" = "ε of b̂"))]
    pub epsilon_disturbance: f64,
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            mass_min: 0.1,
            mass_max: 0.6,
            disturbance: 3.0,
            epsilon_eta: 0.01,
            epsilon_disturbance: 0.1,
        }
    }
}

/// Initial values of the estimates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InitialEstimates {
    /// 1/η̂, kg.
    #[schemars(transform = positive, extend("x-symbol" = "initial mass estimate"))]
    pub mass: f64,
    /// Diagonal of J for the initial ŵ; β and Λw follow from it unless they are stated, kg m².
    #[schemars(transform = positive, extend("x-symbol" = "J"))]
    pub inertia: Vector,
    /// b̂, m/s².
    pub disturbance: Vector,
}

impl Default for InitialEstimates {
    fn default() -> Self {
        Self {
            mass: 0.2,
            inertia: [6.5e-4, 6.5e-4, 13.0e-4],
            disturbance: [0.0; 3],
        }
    }
}
