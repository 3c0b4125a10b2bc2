//! The conditions in which laws are compared, and the quantities whose margin is searched.
//!
//! What a condition changes is true and not told: estimator and controller believe what the scenario of the base says.

use command_line::values::ValueError;
use serde::Serialize;

/// Drag of the paper's vehicle, and the wind that it then feels.
const DRAG: &str = "vehicle.drag=[0.06, 0.06, 0.02]";
const PARASITIC_DRAG: &str = "vehicle.parasitic_drag=0.004";
const GUSTS: &str = "vehicle.wind={mean=[3.0, 0.0, 0.0], gusts={deviation=1.2, correlation_time=0.5}}";

/// A condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Condition {
    /// Its name in tables and on the command line.
    pub name: &'static str,
    /// The settings that make it.
    pub settings: &'static [&'static str],
}

/// All conditions.
pub const CONDITIONS: [Condition; 15] = [
    // The scenario as it stands.
    Condition {
        name: "calm",
        settings: &[],
    },
    // Half the mass laid on in place of the coins.
    Condition {
        name: "mass+50%",
        settings: &["vehicle.change.0.mass=0.285"],
    },
    // The mass doubled in place of the coins.
    Condition {
        name: "mass+100%",
        settings: &["vehicle.change.0.mass=0.38"],
    },
    // Rotor and parasitic drag in still air.
    Condition {
        name: "drag",
        settings: &[DRAG, PARASITIC_DRAG],
    },
    // Drag, and a steady wind of 3 m/s.
    Condition {
        name: "wind",
        settings: &[DRAG, PARASITIC_DRAG, "vehicle.wind={mean=[3.0, 0.0, 0.0]}"],
    },
    // Drag, and wind of 3 m/s with gusts of 1.2 m/s.
    Condition {
        name: "gusts",
        settings: &[DRAG, PARASITIC_DRAG, GUSTS],
    },
    // Drag, and wind of 3 m/s ± 1.5 m/s at 1 rad/s.
    Condition {
        name: "sine",
        settings: &[
            DRAG,
            PARASITIC_DRAG,
            "vehicle.wind={mean=[3.0, 0.0, 0.0], sine=[1.5, 0.0, 0.0], sine_frequency=1.0}",
        ],
    },
    // Ten times the turbulence, 0.5 m/s².
    Condition {
        name: "turbulence",
        settings: &["vehicle.turbulence.deviation=0.5"],
    },
    // One and a half times the speed of the path.
    Condition {
        name: "fast",
        settings: &["path.speed=1.5"],
    },
    // Five times the cameras' noise.
    Condition {
        name: "noise×5",
        settings: &[
            "cameras.position_deviation=1.5e-3",
            "cameras.attitude_deviation=1e-2",
        ],
    },
    // Frames act 8 ms later.
    Condition {
        name: "radio+8ms",
        settings: &["schedule.latency.\"rc/frame -> plant\"=0.013"],
    },
    // One radio frame in five is lost.
    Condition {
        name: "frames-20%",
        settings: &["vehicle.actuators.frame_loss=0.2"],
    },
    // The cameras do not see the vehicle for 0.15 s in every 5 s: a longer gap, and the path waits.
    Condition {
        name: "drop-outs",
        settings: &[
            "cameras.occlusion=[{at=5.0, lasts=0.15}, {at=10.0, lasts=0.15}, {at=15.0, lasts=0.15}, \
             {at=20.0, lasts=0.15}, {at=25.0, lasts=0.15}, {at=30.0, lasts=0.15}, {at=35.0, lasts=0.15}, \
             {at=40.0, lasts=0.15}, {at=45.0, lasts=0.15}, {at=50.0, lasts=0.15}, {at=55.0, lasts=0.15}]",
        ],
    },
    // The centre of mass is 5 mm from the tracked point, above it.
    Condition {
        name: "lever-5mm",
        settings: &["vehicle.center_of_mass=[-0.00216, -0.0013, -0.00432]"],
    },
    // Gusts, lags half as long again, 5 % more thrust.
    Condition {
        name: "wrong-model",
        settings: &[
            DRAG,
            PARASITIC_DRAG,
            GUSTS,
            "vehicle.actuators.thrust_lag=0.045",
            "vehicle.actuators.rate_lag=[0.03, 0.03, 0.03]",
            "vehicle.actuators.thrust_factor=1.05",
        ],
    },
];

impl std::str::FromStr for Condition {
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
    /// Its name in tables.
    pub name: &'static str,
    /// Unit of its values.
    pub unit: &'static str,
    /// Distance between two values, in the unit: the resolution of the margin.
    pub step: f64,
    /// Number of steps to the largest value that is tried.
    pub steps: u32,
    /// Returns the settings that give a value.
    pub settings: fn(f64) -> Vec<String>,
}

/// The quantities whose margins are searched.
pub const MARGINS: [Quantity; 7] = [
    Quantity {
        name: "delay",
        unit: "ms",
        step: 1.0,
        steps: 60,
        settings: |value| {
            let latency = (5.0 + value) / 1e3;
            vec![format!("schedule.latency.\"rc/frame -> plant\"={latency:.3}")]
        },
    },
    Quantity {
        name: "lever arm",
        unit: "mm",
        step: 1.0,
        steps: 40,
        settings: |value| {
            // The tracked point along (0.5, 0.3, 1), of length 1.158, below the centre of mass: above it there is no limit.
            let [x, y, z] = [-0.5, -0.3, -1.0].map(|part: f64| part * value / 1157.6);
            vec![format!("vehicle.center_of_mass=[{x:.6}, {y:.6}, {z:.6}]")]
        },
    },
    Quantity {
        name: "mass step",
        unit: "%",
        step: 10.0,
        steps: 18,
        settings: |value| {
            let mass = 0.19 * (1.0 + value / 100.0);
            vec![
                format!("vehicle.change.0.mass={mass:.4}"),
                "vehicle.change.0.at=10.0".to_owned(),
            ]
        },
    },
    Quantity {
        name: "wind",
        unit: "m/s",
        step: 0.5,
        steps: 40,
        settings: |value| {
            vec![
                DRAG.to_owned(),
                PARASITIC_DRAG.to_owned(),
                format!(
                    "vehicle.wind={{mean=[{value:.1}, 0.0, 0.0], gusts={{deviation={:.2}, correlation_time=0.5}}}}",
                    0.4 * value
                ),
            ]
        },
    },
    Quantity {
        name: "frame loss",
        unit: "%",
        step: 2.0,
        steps: 49,
        settings: |value| vec![format!("vehicle.actuators.frame_loss={:.2}", value / 100.0)],
    },
    Quantity {
        name: "start",
        unit: "m",
        step: 2.0,
        steps: 30,
        settings: far_start,
    },
    // Baselines act on no more than 0.4 m of the error, and their integrals rest above it.
    Quantity {
        name: "start, limited error",
        unit: "m",
        step: 2.0,
        steps: 30,
        settings: |value| {
            let mut settings = far_start(value);
            settings.push("controller.baseline.error_limit=0.4".to_owned());
            settings
        },
    },
];

/// A start so far from the path, away along all three axes, and time to arrive.
fn far_start(value: f64) -> Vec<String> {
    let away = value / f64::sqrt(3.0);
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

    #[test]
    fn conditions_are_found_by_name() {
        for condition in CONDITIONS {
            assert_eq!(condition.name.parse::<Condition>().unwrap(), condition);
        }
        assert!("storm".parse::<Condition>().is_err());
    }
}
