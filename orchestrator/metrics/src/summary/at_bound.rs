//! Estimates at the bounds of the projection (5): the vehicle violates Assumption 1, or another estimate is wrong.

use std::fmt::{Display, Formatter, Result};

use scenario::Bounds;
use serde::Serialize;

use super::Parameters;

/// An estimate at its bound at the end of a phase.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtBound {
    /// When, s.
    pub time: f64,
    /// The estimate, by the symbol of the paper.
    pub estimate: &'static str,
    /// Its value, kg or m/s².
    pub value: f64,
    /// The bound, in the same unit.
    pub bound: f64,
    /// The key of the bound.
    pub key: &'static str,
}

/// Returns the estimates at their bounds at this time, s.
pub(super) fn at_bound(bounds: &Bounds, time: f64, parameters: &Parameters) -> Vec<AtBound> {
    let mut found = Vec::new();
    let mut look = |estimate, value: f64, [least, largest]: [f64; 2], keys: [&'static str; 2]| {
        let passed = if value <= least {
            Some((least, keys[0]))
        } else if value >= largest {
            Some((largest, keys[1]))
        } else {
            None
        };
        found.extend(passed.map(|(bound, key)| AtBound {
            time,
            estimate,
            value,
            bound,
            key,
        }));
    };
    if let Some(mass) = parameters.mass_estimate {
        let keys = ["controller.bounds.mass_min", "controller.bounds.mass_max"];
        look("m̂", mass, [bounds.mass_min, bounds.mass_max], keys);
    }
    let components = parameters.disturbance_estimate.into_iter().flatten();
    for (name, component) in ["b̂x", "b̂y", "b̂z"].into_iter().zip(components) {
        let keys = ["controller.bounds.disturbance"; 2];
        look(name, component, [-bounds.disturbance, bounds.disturbance], keys);
    }
    found
}

impl Display for AtBound {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let Self {
            time,
            estimate,
            value,
            bound,
            key,
        } = self;
        let (unit, other) = match key {
            &"controller.bounds.disturbance" => ("m/s²", "`controller.initial.mass` nearer to the vehicle's"),
            _ => ("kg", "`controller.bounds.disturbance` wider"),
        };
        write!(
            formatter,
            "At {time} s {estimate} = {value:.3} {unit} rests at its bound of {bound:?} {unit}, so that what is beyond it is \
             not compensated. Set `{key}` wider, or {other}."
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(mass: f64, disturbance: [f64; 3]) -> Vec<(&'static str, &'static str)> {
        let parameters = Parameters {
            mass_estimate: Some(mass),
            disturbance_estimate: Some(disturbance),
            ..Parameters::default()
        };
        let found = at_bound(&Bounds::default(), 30.0, &parameters);
        found.iter().map(|found| (found.estimate, found.key)).collect()
    }

    #[test]
    fn estimates_within_their_bounds_or_without_a_sample_are_not_told() {
        assert_eq!(found(0.2, [0.3, -0.2, 2.9]), []);
        assert_eq!(at_bound(&Bounds::default(), 30.0, &Parameters::default()), []);
    }

    #[test]
    fn an_estimate_that_the_projection_holds_is_told_with_its_key() {
        let (most, least) = ("controller.bounds.mass_max", "controller.bounds.mass_min");
        let disturbance = "controller.bounds.disturbance";
        assert_eq!(found(0.601, [0.0; 3]), [("m̂", most)]);
        assert_eq!(found(0.099, [0.0; 3]), [("m̂", least)]);
        assert_eq!(
            found(0.2, [3.02, 0.0, -3.1]),
            [("b̂x", disturbance), ("b̂z", disturbance)]
        );
    }
}
