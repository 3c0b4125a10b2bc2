//! Ablation of the laboratory design: the eight of Figs. 3 to 6 without each of its parts, and in laboratories that differ from
//! the model.

use serde::Serialize;
use statistics::quantile::median_of;

use super::column::Column;
use super::flight::{FlightResults, FlightSpecification, ScenarioSource};
use super::measure::Measured;

/// A design with a part left out, or a laboratory that differs from the model.
#[derive(Clone, Copy, Debug)]
struct Variant {
    name: &'static str,
    settings: &'static [&'static str],
}

const NO_ROLL_OUT: &str = "controller.rates.roll_out=false";
const NO_PUSHES: &str = "controller.rates.unexplained=false";
const NO_PREDICTION: &str = "estimator.kalman.prediction=false";
const NO_LAG_INVERSION: &str = "controller.rates.lag_inversion=false";
const WITH_OFFSET: &str = "controller.remove_offset=false";
const PAPER_DELTA: &str = "controller.delta=0.1";

const MARKERS_BELOW: &str = "vehicle.center_of_mass=[0.0, 0.0, -0.03]";
const MARKERS_ABOVE: &str = "vehicle.center_of_mass=[0.0, 0.0, 0.03]";
const ESTIMATED: &str = "estimator.kalman.marker_offset_deviation=0.02";

const VARIANTS: [Variant; 17] = [
    Variant {
        name: "as designed",
        settings: &[],
    },
    Variant {
        name: "roll-out without disturbances not yet estimated",
        settings: &[NO_PUSHES],
    },
    Variant {
        name: "roll-out off",
        settings: &[NO_ROLL_OUT],
    },
    Variant {
        name: "prediction off",
        settings: &[NO_PREDICTION],
    },
    Variant {
        name: "lag inversion off",
        settings: &[NO_LAG_INVERSION],
    },
    Variant {
        name: "roll-out, prediction and lag inversion off",
        settings: &[NO_ROLL_OUT, NO_PREDICTION, NO_LAG_INVERSION],
    },
    Variant {
        name: "offset kept",
        settings: &[WITH_OFFSET],
    },
    Variant {
        name: "paper mode: δ = 0.1, offset kept",
        settings: &[PAPER_DELTA, WITH_OFFSET],
    },
    Variant {
        name: "paper mode, roll-out off",
        settings: &[PAPER_DELTA, WITH_OFFSET, NO_ROLL_OUT],
    },
    Variant {
        name: "paper mode, prediction off",
        settings: &[PAPER_DELTA, WITH_OFFSET, NO_PREDICTION],
    },
    Variant {
        name: "markers 30 mm below the centre of mass, undeclared",
        settings: &[MARKERS_BELOW],
    },
    Variant {
        name: "markers 30 mm below, stated",
        settings: &[MARKERS_BELOW, "model.marker_offset=[0.0, 0.0, 0.03]"],
    },
    Variant {
        name: "markers 30 mm below, estimated",
        settings: &[MARKERS_BELOW, ESTIMATED],
    },
    Variant {
        name: "markers 30 mm above, undeclared",
        settings: &[MARKERS_ABOVE],
    },
    Variant {
        name: "markers 30 mm above, estimated",
        settings: &[MARKERS_ABOVE, ESTIMATED],
    },
    Variant {
        name: "frames 10 ms later than modelled",
        settings: &["schedule.latency.\"rc/frame -> plant\"=0.015"],
    },
    Variant {
        name: "cameras five times as noisy as modelled",
        settings: &[
            "cameras.position_deviation=1.5e-3",
            "cameras.attitude_deviation=1e-2",
        ],
    },
];

/// Results of a variant: medians over the seeds, in the baseline laboratory.
#[derive(Clone, Debug, Serialize)]
pub struct AblationRow {
    /// Name of the variant.
    pub variant: &'static str,
    /// Settings that make the variant.
    pub settings: &'static [&'static str],
    /// RMSE of the error over the last 20 s, cm.
    pub rmse: Option<f64>,
    /// RMSE of the worst seed, cm.
    pub worst_rmse: Option<f64>,
    /// Largest error over the last 20 s, cm.
    pub largest: Option<f64>,
    /// Peak after the coins, cm.
    pub peak: Option<f64>,
    /// Root mean square of the body rates over the last 20 s, rad/s.
    pub rates: Option<f64>,
    /// Reason why a flight has no result.
    pub note: String,
}

/// Returns the flights of the table.
pub fn specifications() -> impl Iterator<Item = FlightSpecification> {
    VARIANTS
        .into_iter()
        .map(|variant| FlightSpecification::changed(variant.name, ScenarioSource::FIG3_6, variant.settings))
}

/// Returns the table of the flights flown.
#[must_use]
pub fn table(results: &FlightResults, seeds: &[u64]) -> Vec<AblationRow> {
    VARIANTS.map(|variant| line(variant, results, seeds)).into()
}

fn line(variant: Variant, results: &FlightResults, seeds: &[u64]) -> AblationRow {
    let flown: Result<Vec<Measured>, String> = seeds
        .iter()
        .map(|&seed| {
            results
                .flown(Column::Baseline, seed)
                .result(variant.name)
                .cloned()
        })
        .collect();
    let all = |value: fn(&Measured) -> f64| Some(flown.as_ref().ok()?.iter().map(value));
    let middle = |value| all(value).and_then(median_of);
    AblationRow {
        variant: variant.name,
        settings: variant.settings,
        rmse: middle(|measured| 1e2 * measured.error.rmse()),
        worst_rmse: all(|measured| 1e2 * measured.error.rmse()).map(|values| values.fold(0.0, f64::max)),
        largest: middle(|measured| 1e2 * measured.error.max()),
        peak: middle(|measured| 1e2 * measured.error_transient.max()),
        rates: middle(|measured| measured.rate.rmse()),
        note: flown.err().unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_variant_differs_from_the_design_and_can_be_flown() {
        let designed = ScenarioSource::FIG3_6.load(&[], 101).unwrap();
        for specification in specifications().skip(1) {
            assert_ne!(
                specification.load(Column::Baseline, 101).unwrap(),
                designed,
                "{}",
                specification.name
            );
        }
    }

    #[test]
    fn a_variant_that_cannot_fly_says_so_in_its_line() {
        let lines = table(&FlightResults::default(), &[101]);
        assert_eq!(lines.len(), VARIANTS.len());
        assert!(
            lines
                .iter()
                .all(|line| line.rmse.is_none() && line.note.contains("not flown"))
        );
    }
}
