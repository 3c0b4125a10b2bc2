//! Rules for the gains of the adaptive law and its vehicle.
//!
//! A scenario that violates a rule can be flown but probably should not be: `gerono check` shows value and limit of each
//! rule and suggests a gain. docs/tuning.md explains the rules and contains [`table`].
//!
//! The law is linear near the path. With λ = k2 σmax its loops are, innermost first,
//!
//! * angular velocity: ω follows its setpoint at the rate k3 σmax/(βJ);
//! * attitude: the thrust axis follows u at the rate g/|δ|;
//! * position and velocity: two poles, k1 σmax and k2 σmax;
//! * adaptation: b̂ and, along the thrust axis, η̂ with the gain λm T², T = m g: s² + λ s + Λb + λm T².

mod proposal;
mod rule;

use scenario::{GRAVITY, Key, Problem, Scenario, Vector};
use shared_types::ServiceId;

pub use proposal::{Gains, lambda_mass, table as table_of_gains};
pub use rule::{Rule, table};

/// Rule applied to a scenario, with its value and limit.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// The rule.
    pub rule: Rule,
    /// Key of the number that the rule limits.
    pub key: Key,
    /// Left side of the rule's relation, in the rule's unit.
    pub value: f64,
    /// Right side, in the same unit.
    pub limit: f64,
    fix: String,
}

impl Finding {
    /// Returns whether the scenario satisfies the rule.
    #[must_use]
    pub fn is_kept(&self) -> bool {
        if self.rule.is_upper_limit() {
            self.value <= self.limit
        } else {
            self.value >= self.limit
        }
    }

    /// Returns the violated rule as a warning.
    #[must_use]
    pub fn warning(&self) -> Problem {
        let (rule, bound) = (
            self.rule,
            if self.rule.is_upper_limit() {
                "most"
            } else {
                "least"
            },
        );
        let reason = format!(
            "{} is {}{}, and should be at {bound} {}: {}",
            rule.quantity(),
            digits(self.value),
            rule.unit(),
            digits(self.limit),
            rule.consequence()
        );
        Problem::new(self.key.clone(), reason, self.fix.clone())
    }
}

/// Returns every rule that applies to a scenario without [`problems`](Scenario::problems), innermost loop first; none for
/// another law.
#[must_use]
pub fn findings(scenario: &Scenario) -> Vec<Finding> {
    if scenario.program_of(ServiceId::Controller).is_some() || !scenario.controller.law.is_adaptive() {
        return Vec::new();
    }
    let inertias = inertias(scenario);
    let inertia_findings = inertias
        .iter()
        .flat_map(|(key, inertia)| angular_velocity(scenario, key, *inertia));
    inertia_findings
        .chain([inertia_learning(scenario), attitude(scenario)])
        .chain(disturbance_learning(scenario))
        .chain(prediction_step(scenario))
        .chain(thrust_reserve(scenario))
        .collect()
}

/// Returns the violated rules as warnings.
#[must_use]
pub fn warnings(scenario: &Scenario) -> Vec<Problem> {
    let violated = findings(scenario)
        .into_iter()
        .filter(|finding| !finding.is_kept());
    violated.map(|finding| finding.warning()).collect()
}

/// Checks β, which is valid for vehicles within a range of J, about a factor of 80.
fn angular_velocity(scenario: &Scenario, key: &Key, [x, y, z]: Vector) -> [Finding; 2] {
    let (beta, damping) = (scenario.beta(), scenario.controller.damping());
    let (least, largest) = (x.min(y).min(z), x.max(y));
    let fix = format!(
        "set `controller.beta` to {:?}, or state this inertia in `controller.initial.inertia` and leave `controller.beta` out",
        scenario.beta_for(least)
    );
    [
        Finding {
            rule: Rule::AngularVelocityStep,
            key: key.clone(),
            value: scenario.torque_step() * damping / (beta * least),
            limit: 1.0,
            fix: fix.clone(),
        },
        Finding {
            rule: Rule::AngularVelocityRate,
            key: key.clone(),
            value: damping / (beta * largest),
            limit: attitude_rate(scenario) / 4.0,
            fix,
        },
    ]
}

fn inertia_learning(scenario: &Scenario) -> Finding {
    let limit = scenario.lambda_inertia_limit();
    Finding {
        rule: Rule::InertiaLearning,
        key: controller("lambda_inertia"),
        value: scenario.lambda_inertia(),
        limit,
        fix: format!(
            "leave it out, and {:?} follows from the other gains, or give at most {limit:.2e}",
            scenario.default_lambda_inertia()
        ),
    }
}

fn attitude(scenario: &Scenario) -> Finding {
    let law = &scenario.controller;
    let limit = 2.0 * law.k1.max(law.k2) * law.sigma_max;
    Finding {
        rule: Rule::AttitudeRate,
        key: controller("delta"),
        value: attitude_rate(scenario),
        limit,
        fix: format!(
            "set it to {} or less, or lower k1 and k2",
            digits(0.98 * GRAVITY / limit)
        ),
    }
}

/// Returns the two parts of the adaptation gain for z2, Λb + λm (m g)², 1/s²: disturbance and mass.
fn learning_gains(scenario: &Scenario) -> [f64; 2] {
    let law = &scenario.controller;
    let thrust = masses(scenario).fold(0.0, f64::max) * GRAVITY;
    let disturbance = law.lambda_disturbance.into_iter().fold(0.0, f64::max);
    [disturbance, law.lambda_mass * thrust * thrust]
}

fn prediction_step(scenario: &Scenario) -> Option<Finding> {
    let kappa = scenario.controller.prediction_gain?;
    let gain: f64 = learning_gains(scenario).into_iter().sum();
    let hold = scenario.command_hold();
    Some(Finding {
        rule: Rule::PredictionStep,
        key: controller("prediction_gain"),
        value: hold * kappa * gain,
        limit: 1.0,
        fix: format!("set it to at most {}", digits(0.98 / (hold * gain))),
    })
}

/// Minimum damping of the adaptation: at 0.24 the vehicle flies in a limit cycle (docs/tuning.md).
const LEARNING_DAMPING: f64 = 0.35;

/// Checks the damping of the adaptation. Only with commands of body rates: torque commands at the base tick have no delay,
/// and tolerate less damping.
fn disturbance_learning(scenario: &Scenario) -> Option<Finding> {
    let law = &scenario.controller;
    law.rates.as_ref()?;
    let velocity_rate = law.k2 * law.sigma_max;
    let [disturbance, mass] = learning_gains(scenario);
    // Gains with a damping of 0.71, and at the limit.
    let good = good_lambda_disturbance(velocity_rate);
    let slowest = velocity_rate / (2.0 * LEARNING_DAMPING);
    let largest = slowest * slowest;
    let (key, fix) = if disturbance > good || mass == 0.0 {
        let fix = format!("set its elements to at most {}", digits(good));
        ("lambda_disturbance", fix)
    } else {
        let fix = format!(
            "set it to {}",
            digits(law.lambda_mass * 0.98 * (largest - disturbance) / mass)
        );
        ("lambda_mass", fix)
    };
    (disturbance + mass > 0.0).then(|| Finding {
        rule: Rule::LearningDamping,
        key: controller(key),
        value: velocity_rate / (2.0 * (disturbance + mass).sqrt()),
        limit: LEARNING_DAMPING,
        fix,
    })
}

/// Returns the elements of Λb that damp the adaptation with 0.71, for a small λm and the rate k2 σmax of the velocity loop, 1/s.
fn good_lambda_disturbance(velocity_rate: f64) -> f64 {
    velocity_rate * velocity_rate / 2.0
}

/// Checks the thrust of the simulated motors with the masses of the simulation, and that of the radio link also with the mass that
/// the estimator believes: a laboratory has nothing else of its vehicle.
fn thrust_reserve(scenario: &Scenario) -> impl Iterator<Item = Finding> {
    let limit = 1.1;
    let finding = |key: Key, thrust: f64, mass: f64, fix: String| Finding {
        rule: Rule::ThrustReserve,
        key,
        value: thrust / (mass * GRAVITY),
        limit,
        fix,
    };
    let simulated = masses(scenario).fold(0.0, f64::max);
    let of_motors = scenario.vehicle.actuators.as_ref().map(|actuators| {
        let key = ["vehicle", "actuators", "thrust_max"].into_iter().collect();
        let needed = digits(limit * simulated * GRAVITY);
        let fix = format!("fly with motors of at least {needed} N, or a lighter load");
        finding(key, actuators.thrust_max, simulated, fix)
    });
    let of_link = scenario.rc_output.as_ref().map(|link| {
        let believed = scenario.model.as_ref().map(|model| model.mass);
        let mass = match believed {
            Some(believed) if scenario.measures_a_vehicle() => believed,
            _ => simulated.max(believed.unwrap_or(0.0)),
        };
        let [_, thrust] = link.thrust_limits();
        let key = Key::root().then("rc_output").then("thrust_slope");
        let fix = "measure the calibration again (`gerono rc identify`), or fly a lighter load";
        finding(key, thrust, mass, fix.to_owned())
    });
    of_motors.into_iter().chain(of_link)
}

fn attitude_rate(scenario: &Scenario) -> f64 {
    GRAVITY / scenario.controller.delta.abs()
}

/// Returns the masses of the vehicle in the course of the flight, kg.
fn masses(scenario: &Scenario) -> impl Iterator<Item = f64> + '_ {
    let vehicle = &scenario.vehicle;
    let changed = vehicle.change.iter().filter_map(|change| change.mass);
    std::iter::once(vehicle.mass).chain(changed)
}

/// Returns the moments of inertia that the torque acts on, with their keys: those of the vehicle, or with body rates those
/// of the model, whose artificial ω the torque drives.
fn inertias(scenario: &Scenario) -> Vec<(Key, Vector)> {
    let root = Key::root();
    if scenario.controller.rates.is_some() {
        let model = scenario.model.clone().unwrap_or_default();
        return vec![(root.then("model").then("size"), model.inertia())];
    }
    let vehicle = root.then("vehicle");
    let changes = scenario.vehicle.change.iter().enumerate();
    let changes = changes.filter_map(|(index, change)| {
        let at = vehicle.then("change").then(index).then("inertia");
        change.inertia.map(|inertia| (at, inertia))
    });
    std::iter::once((vehicle.then("inertia"), scenario.vehicle.inertia))
        .chain(changes)
        .collect()
}

fn controller(key: &str) -> Key {
    Key::root().then("controller").then(key)
}

/// Formats a gain with three digits.
#[must_use]
pub fn digits(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    if (1e-3..1e6).contains(&rounded.abs()) {
        format!("{rounded}")
    } else {
        format!("{rounded:e}")
    }
}

#[cfg(test)]
mod tests;
