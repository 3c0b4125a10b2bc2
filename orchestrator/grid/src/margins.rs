//! The margin of a law: the largest value of a quantity that it survives, by bisection.
//!
//! A value is survived if with every seed the flight is completed and its RMS distance from the path in the last 20 s is at
//! most [`SURVIVED`]. The bisection assumes monotonicity: a law that survives a value survives all smaller ones. Its
//! resolution is the quantity's step.

use std::path::Path;

use flight::campaign::Campaign;
use flight::interrupt::Interrupt;
use flight::many;
use reproduce::flight::measure;
use serde::{Deserialize, Serialize};

use crate::conditions::Quantity;
use crate::error::GridError;
use crate::flights::{Base, LostFlight};
use crate::laws::ControlLaw;

/// Maximum RMS distance from the path of a flight that counts as survived, m.
pub const SURVIVED: f64 = 0.1;

/// Maximum number of seeds for each value.
pub const SEEDS: usize = 5;

/// File of the margins in the folder of a grid.
pub const MARGINS: &str = "margins.rows";

/// Duration of a flight, s.
const DURATION: &str = "duration=40.0";

/// Margin of a law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Margin {
    /// Name of the law.
    pub law: String,
    /// Name of the quantity.
    pub quantity: String,
    /// Unit of the values.
    pub unit: String,
    /// Largest value survived; `None` if the law fails at zero.
    pub survived: Option<f64>,
    /// Smallest value that failed; `None` if the largest value is survived.
    pub failed: Option<f64>,
    /// The first flight that failed at `failed`.
    pub failure: Option<LostFlight>,
}

/// Searches the margins of all laws in these quantities; returns fewer if the search was interrupted. Margins are stored in
/// `folder`, from which an interrupted search resumes. Calls `found` with the number of margins, first and after each.
///
/// # Errors
/// [`GridError`] if a setting does not fit the base.
pub fn search(
    base: &Base,
    laws: &[ControlLaw],
    quantities: &[Quantity],
    seeds: &[u64],
    folder: &Path,
    interrupt: &Interrupt,
    found: impl FnMut(usize),
) -> Result<Vec<Margin>, GridError> {
    let seeds = &seeds[..seeds.len().min(SEEDS)];
    let (mut pairs, mut searches) = (Vec::new(), Vec::new());
    for law in laws {
        let scenario = base.scenario(&law.settings, 1)?;
        let applicable = quantities
            .iter()
            .filter(|quantity| quantity.applies_to(&scenario));
        for quantity in applicable {
            pairs.push((law, quantity));
            searches.push((&law.name, scenario.clone(), quantity.name, seeds));
        }
    }
    let campaign = Campaign::new("margins", searches)?;
    let search = |index: usize| {
        let (law, quantity) = pairs[index];
        let margin = margin(base, law, quantity, seeds, interrupt);
        interrupt.signal().is_none().then_some(margin)
    };
    campaign.fly(&folder.join(MARGINS), many::cores(), search, found)
}

fn margin(
    base: &Base,
    law: &ControlLaw,
    quantity: &Quantity,
    seeds: &[u64],
    interrupt: &Interrupt,
) -> Result<Margin, GridError> {
    let value = |step: u32| f64::from(step) * quantity.step;
    let fails = |step: u32| {
        let settings = settings(base, law, quantity, value(step))?;
        match first_failure(base, &settings, seeds, interrupt) {
            Err(failure) if step > 0 => infeasible_value(failure, seeds).map(Some),
            found => found,
        }
    };
    let bracket = bisect(quantity.steps, fails)?;
    let (failed, failure) = bracket.failed.unzip();
    Ok(Margin {
        law: law.name.clone(),
        quantity: quantity.name.to_owned(),
        unit: quantity.unit.to_owned(),
        survived: bracket.survived.map(value),
        failed: failed.map(value),
        failure,
    })
}

/// Returns the settings of a flight. Those of the margin come last: they override the law's own limit of the error.
fn settings(
    base: &Base,
    law: &ControlLaw,
    quantity: &Quantity,
    value: f64,
) -> Result<Vec<String>, GridError> {
    let margin_settings = quantity.settings(base.stated(), value)?;
    Ok([law.settings.clone(), vec![DURATION.to_owned()], margin_settings].concat())
}

/// Counts a value that no vehicle could fly as a failure, such as a mass beyond the link's maximum thrust.
fn infeasible_value(failure: GridError, seeds: &[u64]) -> Result<LostFlight, GridError> {
    match failure {
        GridError::Scenario(error) if error.is_of_values() => Ok(LostFlight {
            seed: seeds[0],
            reason: error.without_positions(),
        }),
        failure => Err(failure),
    }
}

fn first_failure(
    base: &Base,
    settings: &[String],
    seeds: &[u64],
    interrupt: &Interrupt,
) -> Result<Option<LostFlight>, GridError> {
    for &seed in seeds {
        let scenario = base.scenario(settings, seed)?;
        let reason = match measure(&scenario, interrupt).transpose()? {
            // The interrupted search has no margin.
            None => return Ok(None),
            Some(Ok(measured)) if measured.error.rmse() <= SURVIVED => continue,
            Some(Ok(measured)) => format!("{:.1} cm from the path", 100.0 * measured.error.rmse()),
            Some(Err(reason)) => reason.to_string(),
        };
        return Ok(Some(LostFlight { seed, reason }));
    }
    Ok(None)
}

/// Result of a bisection: the largest step survived and the smallest step failed, with its failure.
struct Bracket<F> {
    survived: Option<u32>,
    failed: Option<(u32, F)>,
}

/// Bisects the steps from 0 to `last`.
fn bisect<F, E>(last: u32, fails: impl Fn(u32) -> Result<Option<F>, E>) -> Result<Bracket<F>, E> {
    if let Some(failure) = fails(0)? {
        return Ok(Bracket {
            survived: None,
            failed: Some((0, failure)),
        });
    }
    let Some(failure) = fails(last)? else {
        return Ok(Bracket {
            survived: Some(last),
            failed: None,
        });
    };
    let (mut survived, mut failed) = (0, (last, failure));
    while failed.0 - survived > 1 {
        let middle = survived.midpoint(failed.0);
        match fails(middle)? {
            Some(failure) => failed = (middle, failure),
            None => survived = middle,
        }
    }
    Ok(Bracket {
        survived: Some(survived),
        failed: Some(failed),
    })
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    #[test]
    fn the_search_ends_between_the_last_that_is_survived_and_the_first_that_is_not() {
        for limit in 0..=60 {
            let fails = |step: u32| Ok::<_, Infallible>((step >= limit).then_some(step));
            let Ok(bracket) = bisect(49, fails);
            assert_eq!(bracket.survived, limit.min(50).checked_sub(1));
            assert_eq!(
                bracket.failed.map(|(step, _)| step),
                (limit < 50).then_some(limit)
            );
        }
    }

    #[test]
    fn the_settings_of_every_quantity_fit_the_base() {
        let base = Base::load(None).unwrap();
        for quantity in crate::conditions::MARGINS {
            for step in [0, 1, quantity.steps] {
                let value = f64::from(step) * quantity.step;
                let settings = quantity.settings(base.stated(), value).unwrap();
                let law = ["controller.law=indi".to_owned()];
                base.scenario(&[&law[..], &settings].concat(), 1).unwrap();
            }
        }
    }

    #[test]
    fn a_margin_has_its_own_limit_of_the_error() {
        let base = Base::load(None).unwrap();
        let [.., limited] = crate::conditions::MARGINS;
        for limit in [
            "controller.baseline.error_limit=2.0",
            "controller.baseline={error_limit=2.0}",
        ] {
            let law: ControlLaw = format!("mine:controller.law=px4;{limit}").parse().unwrap();
            let settings = settings(&base, &law, &limited, 10.0).unwrap();
            let baseline = base.scenario(&settings, 1).unwrap().controller.baseline.unwrap();
            assert_eq!(baseline.error_limit, Some(0.4));
        }
    }

    #[test]
    fn a_value_that_cannot_be_flown_is_not_survived() {
        let base = Base::load(None).unwrap();
        let heavy = ["vehicle.change.0.mass=0.6".to_owned()];
        let failure = base.scenario(&heavy, 1).unwrap_err();
        let lost = infeasible_value(failure, &[7]).unwrap();
        assert!(lost.reason.contains("5.886 N"), "{lost:?}");
        let failure = base.scenario(&["controller.k9=1.0".to_owned()], 1).unwrap_err();
        assert!(infeasible_value(failure, &[7]).is_err());
    }
}
