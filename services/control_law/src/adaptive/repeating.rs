//! The part of the disturbance that repeats with the path, as the law uses it (not in the paper).

use nalgebra::{SVector, Vector3};

/// J1 b, J2 b and J3 b, kg m³/s².
pub type InertiaTimesDisturbance = SVector<f64, 9>;

/// The repeating part at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeating {
    /// Σ φk âk in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
    /// Σ φk′ γ̇ âk in {I}, m/s³: its rate as the path advances.
    pub rate_world: Vector3<f64>,
    /// Σ φk ŵk.
    pub w: InertiaTimesDisturbance,
    /// λa Σ φk² = λa N: its rate by adaptation, over z2 + κε, 1/s².
    pub gain: f64,
}

impl Repeating {
    /// Without harmonics.
    pub const NOTHING: Self = Self {
        disturbance_world: Vector3::new(0.0, 0.0, 0.0),
        rate_world: Vector3::new(0.0, 0.0, 0.0),
        w: InertiaTimesDisturbance::from_array_storage(nalgebra::ArrayStorage([[0.0; 9]])),
        gain: 0.0,
    };
}
