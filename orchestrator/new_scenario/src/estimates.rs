//! What follows from the mass, the size, the propellers and the battery of a quadcopter, with its uncertainty.

use scenario::{GRAVITY, Model, RadioProtocol, Vector};

use super::{Airframe, Implausible, Surroundings};

/// Edges of the homogeneous cuboid with the vehicle's inertia, in diagonals from motor to motor.
///
/// J/(m d²) is then 0.059 about the horizontal axes and 0.107 about the vertical one. Published values: Crazyflie 0.056 and
/// 0.114, X500 0.044 and 0.082, a 260 mm racer 0.050 and 0.094, Hummingbird 0.063 and 0.122, the paper's vehicle 0.081 and
/// 0.163.
const CUBOID: Vector = [0.8, 0.8, 0.25];

/// Maximum thrust of one propeller by the square of its diameter and the cells, N/m².
///
/// Published values: Crazyflie 69, the model of the X500 in PX4 33, the paper's vehicle 35, Hummingbird 40. Motors of racers have
/// three times as much.
const THRUST_PER_CELL: f64 = 45.0;

/// Range of the maximum thrust over the weight to which the estimate is limited.
const THRUST_TO_WEIGHT: [f64; 2] = [2.0, 6.0];

/// Range of the estimate, over the weight, beyond which one of the numbers is wrong.
const PLAUSIBLE: [f64; 2] = [0.5, 20.0];

/// Thrusts that the firmware of a Crazyflie makes of the largest of its packets, N, by its motors.
const CRAZYFLIE_THRUSTS: [(f64, &str); 3] = [
    (0.48, "the propellers of the 2.1+"),
    (0.72, "the thrust upgrade kit"),
    (0.8, "the motors of a Brushless"),
];

/// Least ratio of the thrust to the weight of a Crazyflie. A heavier vehicle has other motors.
const CRAZYFLIE_RATIO: f64 = 1.2;

/// Time constant of the thrust per inch of the propeller, s: geometrically similar propellers with equal tip speeds follow
/// after times in proportion to their diameters. The paper's vehicle has 0.03 s with 5.5 inches.
const LAG_PER_INCH: f64 = 0.005;

/// Time constant of the thrust of coreless motors on one cell, s: that of the Crazyflie by Förster (2015).
const LAG_OF_CORELESS: f64 = 0.07;

/// Time constant of the body rates by that of the thrust, and its minimum, s: 0.02 s and 0.03 s for the paper's vehicle.
const RATE_LAG: [f64; 2] = [0.67, 0.02];

/// Gains on the error of yaw, 1/s, and on its integral, 1/s².
const YAW_GAINS: [f64; 2] = [4.0, 0.5];

/// Time constant of a Crazyflie's rate of yaw, s: its firmware integrates the rate to an angle, and turns the vehicle by that.
const CRAZYFLIE_YAW_LAG: f64 = 0.2;

/// Gains that go with it.
const CRAZYFLIE_YAW_GAINS: [f64; 2] = [1.5, 0.1];

/// Diagonal above which body rates are limited to the lower ones, m.
const LARGE: f64 = 0.35;

const INCH: f64 = 0.0254;

/// Estimated properties of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimates {
    /// Edges of the cuboid with the vehicle's inertia, m.
    pub cuboid: Vector,
    /// Diagonal of J, kg m².
    pub inertia: Vector,
    /// Maximum thrust of all propellers, N.
    pub thrust_max: f64,
    /// Maximum thrust by propellers and cells alone, over the weight, if it is outside of the limits.
    pub limited: Option<f64>,
    /// Motors of a Crazyflie, if the maximum thrust is that of its firmware with them.
    pub of_crazyflie: Option<&'static str>,
    /// Time constant of the thrust, s.
    pub thrust_lag: f64,
    /// Time constants of the body rates, s.
    pub rate_lag: Vector,
    /// Gains on the error of yaw, 1/s, and on its integral, 1/s².
    pub yaw_gains: [f64; 2],
    /// Body rates at the ends of the channels, rad/s.
    pub rate_max: Vector,
}

impl Estimates {
    /// Estimates the properties of a vehicle.
    ///
    /// # Errors
    /// [`Implausible`] if the numbers contradict each other.
    pub fn of(airframe: &Airframe) -> Result<Self, Implausible> {
        let Airframe {
            mass,
            size,
            propeller,
            cells,
        } = *airframe;
        let diameter = propeller * INCH;
        let between_motors = size / std::f64::consts::SQRT_2;
        if diameter > 1.05 * between_motors {
            return Err(Implausible {
                reason: format!(
                    "propellers of {propeller} inch touch each other: with a diagonal of {size} m neighbouring motors are {between_motors:.3} m apart"
                ),
                fix: format!(
                    "give the diagonal from motor to motor, at least {:.2} m with these propellers, and their diameter in inch",
                    (diameter * std::f64::consts::SQRT_2 * 100.0).ceil() / 100.0
                ),
            });
        }
        let weight = mass * GRAVITY;
        let thrust = 4.0 * THRUST_PER_CELL * f64::from(cells) * diameter * diameter;
        let ratio = thrust / weight;
        let [least, most] = PLAUSIBLE;
        if !(least..=most).contains(&ratio) {
            return Err(Implausible {
                reason: format!(
                    "four propellers of {propeller} inch with {cells} cells have about {thrust:.2} N, {ratio:.2} times the weight of {mass} kg"
                ),
                fix: "give the mass with battery in kg, the diameter of a propeller in inch, and the cells in series".to_owned(),
            });
        }
        let [lowest, highest] = THRUST_TO_WEIGHT;
        let stated_ratio = ratio.clamp(lowest, highest);
        let thrust_lag = if cells == 1 {
            LAG_OF_CORELESS
        } else {
            LAG_PER_INCH * propeller
        };
        let rate_lag = (RATE_LAG[0] * thrust_lag).max(RATE_LAG[1]);
        let cuboid = CUBOID.map(|edge| edge * size);
        let body = Model {
            mass,
            size: cuboid,
            ..Model::default()
        };
        Ok(Self {
            cuboid,
            inertia: body.inertia(),
            thrust_max: stated_ratio * weight,
            limited: (stated_ratio != ratio).then_some(ratio),
            of_crazyflie: None,
            thrust_lag,
            rate_lag: [rate_lag; 3],
            yaw_gains: YAW_GAINS,
            rate_max: if size > LARGE {
                [10.0, 10.0, 4.0]
            } else {
                [19.0, 19.0, 8.0]
            },
        })
    }

    /// Estimates the properties of a vehicle, with what its radio link tells of it.
    ///
    /// # Errors
    /// [`Implausible`] if the numbers contradict each other.
    pub fn within(airframe: &Airframe, surroundings: Surroundings) -> Result<Self, Implausible> {
        let estimates = Self::of(airframe)?;
        Ok(match surroundings.radio() {
            Some(RadioProtocol::Crazyflie) => estimates.of_a_crazyflie(airframe.mass),
            _ => estimates,
        })
    }

    /// Describes why the vehicle may not lift itself; `None` if its propellers do by the rule.
    #[must_use]
    pub fn doubt(&self) -> Option<String> {
        let ratio = self
            .limited
            .filter(|ratio| *ratio < 1.0 && self.of_crazyflie.is_none())?;
        Some(format!(
            "by the rule the propellers lift {ratio:.2} times the weight, and the file assumes {:?} times: measure the thrust before a \
             flight, or correct mass (kg), propeller (inch) and cells",
            THRUST_TO_WEIGHT[0]
        ))
    }

    /// Takes the yaw of a Crazyflie's firmware, and its least maximum thrust that lifts a vehicle of this mass, kg, with a reserve, if
    /// one does.
    #[must_use]
    pub fn of_a_crazyflie(self, mass: f64) -> Self {
        let lifts = |(thrust, _): &&(f64, &str)| *thrust >= CRAZYFLIE_RATIO * mass * GRAVITY;
        let thrust = CRAZYFLIE_THRUSTS.iter().find(lifts);
        let [x, y, _] = self.rate_lag;
        Self {
            thrust_max: thrust.map_or(self.thrust_max, |&(thrust_max, _)| thrust_max),
            of_crazyflie: thrust.map(|&(_, motors)| motors),
            rate_lag: [x, y, CRAZYFLIE_YAW_LAG],
            yaw_gains: CRAZYFLIE_YAW_GAINS,
            ..self
        }
    }
}

/// Returns the rules of the estimates as a Markdown table.
#[must_use]
pub fn table() -> String {
    let [width, _, height] = CUBOID;
    let [lowest, highest] = THRUST_TO_WEIGHT;
    let [rate_share, rate_least] = RATE_LAG;
    let of_crazyflies = CRAZYFLIE_THRUSTS.map(|(thrust, motors)| format!("{thrust} N ({motors})"));
    let of_crazyflies = of_crazyflies.join(", ");
    format!(
        "| estimate | rule | from | it may be wrong by |\n\
         | --- | --- | --- | --- |\n\
         | inertia | a cuboid of the mass, {width} d × {width} d × {height} d | Crazyflie, X500, a 260 mm racer, Hummingbird, the paper's vehicle | a factor of 1.4 |\n\
         | largest thrust | 4 · {THRUST_PER_CELL} N/m² · cells · D², but {lowest} to {highest} times the weight; with `--radio crazyflie` the first of {of_crazyflies} that is {CRAZYFLIE_RATIO} times the weight | Crazyflie 69, X500 33, the paper's 35, Hummingbird 40 N/m² | a factor of 1.6; racers have three times as much |\n\
         | lag of the thrust | {LAG_PER_INCH} s per inch; {LAG_OF_CORELESS} s with one cell | the paper's vehicle; Crazyflie (Förster 2015) | a factor of 2 |\n\
         | lag of the body rates | {rate_share} times that of the thrust, at least {rate_least} s | the paper's vehicle | a factor of 2 |\n"
    )
}
