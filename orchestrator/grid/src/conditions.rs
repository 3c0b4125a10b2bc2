//! The conditions in which laws are compared, and the quantities whose margin is searched.
//!
//! A condition changes the rig only: estimator and controller keep the parameters of the base scenario. Factors and differences
//! refer to the values of that scenario, such as its mass; wind, drag, drop-outs, lost frames and lever arms are the same for
//! every scenario.

use scenario::{Scenario, VehicleChange};
use scenario_file::values::ValueError;
use serde::Serialize;
use shared_types::ServiceId;

use crate::error::GridError;

/// Drag of the paper's vehicle, through which wind acts on it.
const DRAG: &str = "vehicle.drag=[0.06, 0.06, 0.02]";
const PARASITIC_DRAG: &str = "vehicle.parasitic_drag=0.004";
const GUSTS: &str = "vehicle.wind={mean=[3.0, 0.0, 0.0], gusts={deviation=1.2, correlation_time=0.5}}";

/// Settings that make a condition or a value of a margin.
type Settings = Result<Vec<String>, Missing>;

/// The scenario lacks the section that a condition changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "it changes what `{0}` states, and the scenario has no such section: state it, as scenarios/fig3_6.toml does"
)]
pub struct Missing(&'static str);

/// A condition of a scenario.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Condition {
    /// Name in tables and on the command line.
    pub name: &'static str,
    /// Settings of the scenario that make the condition.
    pub settings: Vec<String>,
}

/// A condition for any scenario.
#[derive(Clone, Copy, Debug)]
pub struct ConditionKind {
    /// Name in tables and on the command line.
    pub name: &'static str,
    settings: fn(&Scenario) -> Settings,
}

impl ConditionKind {
    /// Returns the condition of a scenario.
    ///
    /// # Errors
    /// [`GridError`] if the scenario lacks what the condition changes.
    pub fn for_scenario(&self, base: &Scenario) -> Result<Condition, GridError> {
        let name = self.name;
        let settings = (self.settings)(base)
            .map_err(|missing| GridError::BadInput(format!("the condition `{name}`: {missing}")))?;
        Ok(Condition { name, settings })
    }
}

/// All conditions.
pub const CONDITIONS: [ConditionKind; 15] = [
    // The unchanged scenario.
    ConditionKind {
        name: "calm",
        settings: |_| Ok(Vec::new()),
    },
    // Half the mass added in place of the coins.
    ConditionKind {
        name: "mass+50%",
        settings: |base| changed_mass(base, 1.5),
    },
    // The mass doubled in place of the coins.
    ConditionKind {
        name: "mass+100%",
        settings: |base| changed_mass(base, 2.0),
    },
    // Rotor and parasitic drag in still air.
    ConditionKind {
        name: "drag",
        settings: |_| Ok(stated(&[DRAG, PARASITIC_DRAG])),
    },
    // Drag, and a steady wind of 3 m/s.
    ConditionKind {
        name: "wind",
        settings: |_| {
            Ok(stated(&[
                DRAG,
                PARASITIC_DRAG,
                "vehicle.wind={mean=[3.0, 0.0, 0.0]}",
            ]))
        },
    },
    // Drag, and wind of 3 m/s with gusts of 1.2 m/s.
    ConditionKind {
        name: "gusts",
        settings: |_| Ok(stated(&[DRAG, PARASITIC_DRAG, GUSTS])),
    },
    // Drag, and wind of 3 m/s ± 1.5 m/s at 1 rad/s.
    ConditionKind {
        name: "sine",
        settings: |_| {
            let wind = "vehicle.wind={mean=[3.0, 0.0, 0.0], sine=[1.5, 0.0, 0.0], sine_frequency=1.0}";
            Ok(stated(&[DRAG, PARASITIC_DRAG, wind]))
        },
    },
    // Ten times the turbulence.
    ConditionKind {
        name: "turbulence",
        settings: |base| {
            let turbulence = base.vehicle.turbulence.as_ref();
            let deviation = turbulence.ok_or(Missing("[vehicle.turbulence]"))?.deviation;
            Ok(vec![setting("vehicle.turbulence.deviation", 10.0 * deviation)])
        },
    },
    // One and a half times the speed of the path.
    ConditionKind {
        name: "fast",
        settings: |base| Ok(vec![setting("path.speed", 1.5 * base.path.speed)]),
    },
    // Five times the cameras' noise.
    ConditionKind {
        name: "noise×5",
        settings: |base| {
            let cameras = base.cameras.as_ref().ok_or(Missing("[cameras]"))?;
            Ok(vec![
                setting("cameras.position_deviation", 5.0 * cameras.position_deviation),
                setting("cameras.attitude_deviation", 5.0 * cameras.attitude_deviation),
            ])
        },
    },
    // Frames act 8 ms later.
    ConditionKind {
        name: "radio+8ms",
        settings: |base| Ok(vec![later_frames(base, 0.008)]),
    },
    // One radio frame in five is lost.
    ConditionKind {
        name: "frames-20%",
        settings: |_| Ok(stated(&["vehicle.actuators.frame_loss=0.2"])),
    },
    // The vehicle is occluded for 0.15 s in every 5 s; longer, and the path would wait.
    ConditionKind {
        name: "drop-outs",
        settings: |_| {
            Ok(stated(&[
                "cameras.occlusion=[{at=5.0, lasts=0.15}, {at=10.0, lasts=0.15}, {at=15.0, lasts=0.15}, \
                 {at=20.0, lasts=0.15}, {at=25.0, lasts=0.15}, {at=30.0, lasts=0.15}, {at=35.0, lasts=0.15}, \
                 {at=40.0, lasts=0.15}, {at=45.0, lasts=0.15}, {at=50.0, lasts=0.15}, {at=55.0, lasts=0.15}]",
            ]))
        },
    },
    // The centre of mass is 5 mm from the tracked point, above it.
    ConditionKind {
        name: "lever-5mm",
        settings: |_| Ok(stated(&["vehicle.center_of_mass=[-0.00216, -0.0013, -0.00432]"])),
    },
    // Gusts, lags +50 %, thrust +5 %.
    ConditionKind {
        name: "wrong-model",
        settings: wrong_model,
    },
];

/// Settings that are the same for every scenario.
fn stated(settings: &[&str]) -> Vec<String> {
    settings.iter().map(|&setting| setting.to_owned()).collect()
}

/// Returns the setting of a computed number, rounded to twelve digits, so that 1.5 times 0.19 kg is 0.285 kg.
fn setting(key: &str, value: f64) -> String {
    format!("{key}={:?}", rounded(value))
}

fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

/// Returns settings that multiply the vehicle's initial mass by `factor` from the first change on.
fn changed_mass(base: &Scenario, factor: f64) -> Settings {
    let changes_mass = |(index, change): &(usize, &VehicleChange)| *index == 0 || change.mass.is_some();
    let mass = |(index, _)| {
        setting(
            &format!("vehicle.change.{index}.mass"),
            factor * base.vehicle.mass,
        )
    };
    let changes = base.vehicle.change.iter().enumerate();
    let settings: Vec<_> = changes.filter(changes_mass).map(mass).collect();
    if settings.is_empty() {
        return Err(Missing("[[vehicle.change]]"));
    }
    Ok(settings)
}

/// Returns the setting that adds a delay, s, to the latency of radio frames.
fn later_frames(base: &Scenario, delay: f64) -> String {
    let stated = base.schedule.latency.get("rc/frame -> plant");
    let latency = stated.copied().unwrap_or(0.0) + delay;
    setting("schedule.latency.\"rc/frame -> plant\"", latency)
}

fn wrong_model(base: &Scenario) -> Settings {
    let actuators = base.vehicle.actuators.as_ref();
    let actuators = actuators.ok_or(Missing("[vehicle.actuators]"))?;
    let longer = |lag: f64| 1.5 * lag;
    let mut settings = stated(&[DRAG, PARASITIC_DRAG, GUSTS]);
    settings.push(setting(
        "vehicle.actuators.thrust_lag",
        longer(actuators.thrust_lag),
    ));
    let down = actuators.thrust_lag_down.map(longer);
    settings.extend(down.map(|lag| setting("vehicle.actuators.thrust_lag_down", lag)));
    let rate_lag = actuators.rate_lag.map(|lag| rounded(longer(lag)));
    settings.push(format!("vehicle.actuators.rate_lag={rate_lag:?}"));
    let factor = 1.05 * actuators.thrust_factor;
    settings.push(setting("vehicle.actuators.thrust_factor", factor));
    Ok(settings)
}

impl std::str::FromStr for ConditionKind {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let found = CONDITIONS.into_iter().find(|condition| condition.name == text);
        found.ok_or_else(|| ValueError::Unknown {
            what: "condition",
            there_is: format!(
                "there is {}",
                CONDITIONS.map(|condition| condition.name).join(", ")
            ),
        })
    }
}

/// A quantity whose margin is searched: the largest value that a law survives.
#[derive(Clone, Copy, Debug)]
pub struct Quantity {
    /// Name in tables.
    pub name: &'static str,
    /// Unit of the values.
    pub unit: &'static str,
    /// Resolution of the margin, in the unit.
    pub step: f64,
    /// Number of steps to the largest value flown.
    pub steps: u32,
    settings: fn(&Scenario, f64) -> Settings,
    /// `true` if it limits the error that a law acts on, which only the baselines support.
    limits_error: bool,
}

impl Quantity {
    /// Returns whether the margin is defined for the law of a scenario.
    #[must_use]
    pub fn applies_to(&self, scenario: &Scenario) -> bool {
        let has_limit = || {
            scenario.controller.law.uses(&["baseline", "error_limit"])
                && !scenario.is_foreign(ServiceId::Controller)
        };
        !self.limits_error || has_limit()
    }

    /// Returns the settings that set the quantity to a value.
    ///
    /// # Errors
    /// [`GridError`] if the scenario lacks a section that they change.
    pub fn settings(&self, base: &Scenario, value: f64) -> Result<Vec<String>, GridError> {
        let refused = |missing| {
            GridError::BadInput(format!(
                "the margin `{}`: {missing}; or give --no-margins",
                self.name
            ))
        };
        (self.settings)(base, value).map_err(refused)
    }
}

/// The quantities whose margins are searched.
pub const MARGINS: [Quantity; 7] = [
    Quantity {
        name: "delay",
        unit: "ms",
        step: 1.0,
        steps: 60,
        limits_error: false,
        settings: |base, value| Ok(vec![later_frames(base, value / 1e3)]),
    },
    Quantity {
        name: "lever arm",
        unit: "mm",
        step: 1.0,
        steps: 40,
        limits_error: false,
        settings: |_, value| {
            // The tracked point is below the centre of mass, along (0.5, 0.3, 1) of length 1.158: above it there is no limit.
            let [x, y, z] = [-0.5, -0.3, -1.0].map(|part: f64| part * value / 1157.6);
            Ok(vec![format!("vehicle.center_of_mass=[{x:.6}, {y:.6}, {z:.6}]")])
        },
    },
    Quantity {
        name: "mass step",
        unit: "%",
        step: 10.0,
        steps: 18,
        limits_error: false,
        settings: |base, value| {
            let mut settings = changed_mass(base, 1.0 + value / 100.0)?;
            settings.push("vehicle.change.0.at=10.0".to_owned());
            Ok(settings)
        },
    },
    Quantity {
        name: "wind",
        unit: "m/s",
        step: 0.5,
        steps: 40,
        limits_error: false,
        settings: |_, value| {
            let wind = format!(
                "vehicle.wind={{mean=[{value:.1}, 0.0, 0.0], gusts={{deviation={:.2}, correlation_time=0.5}}}}",
                0.4 * value
            );
            Ok(stated(&[DRAG, PARASITIC_DRAG, &wind]))
        },
    },
    Quantity {
        name: "frame loss",
        unit: "%",
        step: 2.0,
        steps: 49,
        limits_error: false,
        settings: |_, value| Ok(vec![format!("vehicle.actuators.frame_loss={:.2}", value / 100.0)]),
    },
    Quantity {
        name: "start",
        unit: "m",
        step: 2.0,
        steps: 30,
        limits_error: false,
        settings: |_, value| Ok(far_start(value)),
    },
    // Baselines act on at most 0.4 m of the error, and hold their integrals above it.
    Quantity {
        name: "start, limited error",
        unit: "m",
        step: 2.0,
        steps: 30,
        limits_error: true,
        settings: |_, value| {
            let mut settings = far_start(value);
            settings.push("controller.baseline.error_limit=0.4".to_owned());
            Ok(settings)
        },
    },
];

/// Returns settings for a start at `distance` (m) from the middle of the eight, equal along all three axes, with time to arrive.
fn far_start(distance: f64) -> Vec<String> {
    let away = distance / f64::sqrt(3.0);
    vec![
        format!(
            "vehicle.initial.position=[{away:.3}, {away:.3}, {:.3}]",
            -1.2 - away
        ),
        "duration=120.0".to_owned(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::flights::Base;

    #[test]
    fn conditions_are_found_by_name() {
        for condition in CONDITIONS {
            assert_eq!(
                condition.name.parse::<ConditionKind>().unwrap().name,
                condition.name
            );
        }
        assert!("storm".parse::<ConditionKind>().is_err());
    }

    fn condition(name: &str, base: &Scenario) -> Vec<String> {
        name.parse::<ConditionKind>()
            .unwrap()
            .for_scenario(base)
            .unwrap()
            .settings
    }

    fn quantity(name: &str) -> Quantity {
        MARGINS
            .into_iter()
            .find(|quantity| quantity.name == name)
            .unwrap()
    }

    #[test]
    fn the_conditions_of_the_shipped_scenario_are_those_of_the_published_tables() {
        let base = Base::load(None).unwrap();
        let latency = "schedule.latency.\"rc/frame -> plant\"";
        for (name, published) in [
            ("calm", stated(&[])),
            ("mass+50%", stated(&["vehicle.change.0.mass=0.285"])),
            ("mass+100%", stated(&["vehicle.change.0.mass=0.38"])),
            ("turbulence", stated(&["vehicle.turbulence.deviation=0.5"])),
            ("fast", stated(&["path.speed=1.5"])),
            (
                "noise×5",
                stated(&[
                    "cameras.position_deviation=1.5e-3",
                    "cameras.attitude_deviation=1e-2",
                ]),
            ),
            ("radio+8ms", vec![format!("{latency}=0.013")]),
            (
                "wrong-model",
                stated(&[
                    DRAG,
                    PARASITIC_DRAG,
                    GUSTS,
                    "vehicle.actuators.thrust_lag=0.045",
                    "vehicle.actuators.rate_lag=[0.03, 0.03, 0.03]",
                    "vehicle.actuators.thrust_factor=1.05",
                ]),
            ),
        ] {
            let scenario = |settings: &[String]| base.scenario(settings, 1).unwrap();
            assert_eq!(
                scenario(&condition(name, base.stated())),
                scenario(&published),
                "{name}"
            );
        }
        let of_value = |name, value| quantity(name).settings(base.stated(), value).unwrap();
        for delay in 0..=60 {
            let settings = of_value("delay", f64::from(delay));
            let published = [format!("{latency}={:.3}", f64::from(5 + delay) / 1e3)];
            assert_eq!(
                base.scenario(&settings, 1).unwrap(),
                base.scenario(&published, 1).unwrap()
            );
        }
        for step in (0..=180).step_by(10) {
            let settings = of_value("mass step", f64::from(step));
            let published = [
                format!(
                    "vehicle.change.0.mass={:.4}",
                    0.19 * (1.0 + f64::from(step) / 100.0)
                ),
                "vehicle.change.0.at=10.0".to_owned(),
            ];
            assert_eq!(
                base.scenario(&settings, 1).unwrap(),
                base.scenario(&published, 1).unwrap()
            );
        }
    }

    #[test]
    fn conditions_and_margins_of_another_scenario_go_from_what_it_states() {
        let stated = [
            "vehicle.mass=0.4",
            "vehicle.turbulence.deviation=0.1",
            "vehicle.actuators.thrust_lag=0.04",
            "vehicle.actuators.thrust_lag_down=0.06",
            "vehicle.actuators.rate_lag=[0.01, 0.02, 0.04]",
            "vehicle.actuators.thrust_factor=0.9",
            "vehicle.change.1={at=50.0, mass=0.2}",
            "cameras.position_deviation=1e-3",
            "cameras.attitude_deviation=3e-3",
            "path.speed=0.8",
            "schedule.latency.\"rc/frame -> plant\"=0.02",
        ];
        let base = Base::load(None).unwrap();
        let own = base.scenario(&stated.map(str::to_owned), 1).unwrap();
        let latency = "schedule.latency.\"rc/frame -> plant\"";
        assert_eq!(
            condition("mass+50%", &own),
            ["vehicle.change.0.mass=0.6", "vehicle.change.1.mass=0.6"]
        );
        assert_eq!(
            condition("turbulence", &own),
            ["vehicle.turbulence.deviation=1.0"]
        );
        assert_eq!(condition("fast", &own), ["path.speed=1.2"]);
        assert_eq!(
            condition("noise×5", &own),
            [
                "cameras.position_deviation=0.005",
                "cameras.attitude_deviation=0.015"
            ]
        );
        assert_eq!(condition("radio+8ms", &own), [format!("{latency}=0.028")]);
        assert_eq!(
            condition("wrong-model", &own)[3..],
            [
                "vehicle.actuators.thrust_lag=0.06",
                "vehicle.actuators.thrust_lag_down=0.09",
                "vehicle.actuators.rate_lag=[0.015, 0.03, 0.06]",
                "vehicle.actuators.thrust_factor=0.945",
            ]
        );
        let of_value = |name, value| quantity(name).settings(&own, value).unwrap();
        assert_eq!(of_value("delay", 16.0), [format!("{latency}=0.036")]);
        assert_eq!(of_value("mass step", 30.0)[0], "vehicle.change.0.mass=0.52");
    }

    #[test]
    fn a_condition_of_what_a_scenario_does_not_state_is_refused() {
        let settings = ["vehicle.change=[]".to_owned()];
        let base = Base::load(None).unwrap().scenario(&settings, 1).unwrap();
        let refused = "mass+50%"
            .parse::<ConditionKind>()
            .unwrap()
            .for_scenario(&base)
            .unwrap_err();
        let refused = refused.to_string();
        assert!(refused.contains("[[vehicle.change]]"), "{refused}");
        assert!(quantity("mass step").settings(&base, 10.0).is_err());
    }
}
