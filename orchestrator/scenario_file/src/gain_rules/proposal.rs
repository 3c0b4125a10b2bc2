//! Gains for a vehicle that was weighed and not yet measured.

use super::good_lambda_disturbance;

/// Gains of the adaptive law that `gerono new` states.
///
/// They are slower than the paper's k1 = k2 = 4: with them a vehicle also flies if its thrust is 0.65 to 1.5 times the
/// stated one and its lags are 1.5 times the stated ones, which is what estimates miss by (docs/tuning.md).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// k1.
    pub k1: f64,
    /// k2.
    pub k2: f64,
    /// k3.
    pub k3: f64,
    /// σmax.
    pub sigma_max: f64,
    /// δ, m/s.
    pub delta: f64,
    /// λm.
    pub lambda_mass: f64,
    /// Each element of Λb.
    pub lambda_disturbance: f64,
}

impl Gains {
    /// Returns the gains for a vehicle of a mass, kg, of which nothing else is known.
    #[must_use]
    pub fn for_unmeasured(mass: f64) -> Self {
        Self::with(2.0, 3.0, mass)
    }

    /// Returns the gains for a vehicle of a mass, kg, whose thrust and lags are measured: the paper's.
    #[must_use]
    pub fn for_measured(mass: f64) -> Self {
        Self::with(4.0, 4.0, mass)
    }

    fn with(k1: f64, k2: f64, mass: f64) -> Self {
        let sigma_max = 1.5;
        Self {
            k1,
            k2,
            k3: 13.0,
            sigma_max,
            delta: 0.25,
            lambda_mass: lambda_mass(mass),
            lambda_disturbance: good_lambda_disturbance(k2 * sigma_max),
        }
    }
}

/// Returns λm for a mass, kg: the loop gain of η̂ is λm (m g)², so λm scales with 1/m² from the 0.3 of 0.2 kg.
#[must_use]
pub fn lambda_mass(mass: f64) -> f64 {
    0.3 * (0.2 / mass) * (0.2 / mass)
}

/// Returns the gains for some vehicles as a Markdown table.
#[must_use]
pub fn table() -> String {
    let mut table = "| | k1 | k2 | k3 | σmax | δ, m/s | Λb | λm for 0.027, 0.2, 0.9 and 2 kg |\n\
        | --- | --- | --- | --- | --- | --- | --- | --- |\n"
        .to_owned();
    type Choice = fn(f64) -> Gains;
    let choices: [(&str, Choice); 2] = [
        ("not measured", Gains::for_unmeasured),
        ("measured", Gains::for_measured),
    ];
    for (name, gains_for) in choices {
        let Gains {
            k1,
            k2,
            k3,
            sigma_max,
            delta,
            lambda_disturbance,
            ..
        } = gains_for(1.0);
        let lambdas = [0.027, 0.2, 0.9, 2.0].map(|mass| super::digits(gains_for(mass).lambda_mass));
        let lambdas = lambdas.join(", ");
        let disturbance = super::digits(lambda_disturbance);
        table +=
            &format!("| {name} | {k1} | {k2} | {k3} | {sigma_max} | {delta} | {disturbance} | {lambdas} |\n");
    }
    table
}
