//! Checks of sections that depend on each other.

use super::{Findings, six_digits};
use crate::{GRAVITY, Key, RateCommand, RcLink, Scenario, Vector};
use shared_types::service::seconds;
use shared_types::wiring::{ServiceId, Topic};

/// Maximum number of steps of the law over the hold of a command: one step of the controller computes all of them.
const MAX_STEPS: f64 = 1000.0;

/// Tolerance of a whole number of steps, for the rounding of decimals.
const STEP_TOLERANCE: f64 = 1e-6;

impl Scenario {
    pub(super) fn check_sections(&self, has_good_link: bool, found: &mut Findings) {
        match &self.controller.rates {
            Some(rates) => self.check_rate_commands(rates, found),
            None => self.check_torque_commands(found),
        }
        self.check_hover_thrust(has_good_link, found);
    }

    /// Checks the sections that a controller of body rates needs.
    fn check_rate_commands(&self, rates: &RateCommand, found: &mut Findings) {
        let at = Key::root().then("controller").then("rates");
        if self.vehicle.actuators.is_none() {
            found.add(
                at.clone(),
                "the controller commands body rates, but the vehicle has no rate loop that follows them",
                "add `[vehicle.actuators]`, which may be empty, or leave `controller.rates` out",
            );
        }
        if self.is_foreign(ServiceId::Controller) {
            return;
        }
        if self.model.is_none() {
            found.add(
                at.clone(),
                "the controller computes body rates by a model of the vehicle, but there is none",
                "add `[model]`, which may be empty, or leave `controller.rates` out",
            );
        }
        if self.estimator.is_none() && self.navigation.is_none() {
            let filter = if self.sensors.is_some() {
                "navigation"
            } else {
                "estimator.kalman"
            };
            found.add(
                at.clone(),
                "the controller needs a thrust and an acceleration that only a filter estimates",
                format!("add `[{filter}]`, which may be empty, or leave `controller.rates` out"),
            );
        }
        self.check_roll_out(rates, &at.then("roll_out_step"), found);
    }

    /// Requires a whole number of steps over the hold of a command.
    fn check_roll_out(&self, rates: &RateCommand, key: &Key, found: &mut Findings) {
        let step = rates.roll_out_step;
        let (true, Ok(schedule)) = (found.is_in_range(key), self.schedule()) else {
            return;
        };
        let hold = seconds(schedule.time_ns(schedule.topic_rate(Topic::ControlCommand).period));
        let count = hold / step;
        let whole = libm::round(count);
        if whole < 1.0 || (count - whole).abs() > STEP_TOLERANCE {
            let fitting = hold / libm::ceil(count).min(MAX_STEPS);
            found.add(
                key.clone(),
                format!("{step:?} s does not divide the {hold:?} s for which a command is held"),
                format!("use {} or another whole part of {hold:?}", six_digits(fitting)),
            );
        } else if whole > MAX_STEPS {
            found.add(
                key.clone(),
                format!("{whole:?} steps for one command, more than {MAX_STEPS:?}"),
                format!(
                    "raise `roll_out_step` to {} or more",
                    six_digits(hold / MAX_STEPS)
                ),
            );
        }
    }

    /// Refuses sections that need body rates when torque is commanded, and reports the first. Cameras without velocities
    /// belong to them, because the filter that estimates velocities predicts by body rates.
    fn check_torque_commands(&self, found: &mut Findings) {
        let root = Key::root();
        let sections = [
            (
                self.vehicle.actuators.is_some(),
                root.then("vehicle").then("actuators"),
                "the vehicle's rate loop follows body rates",
            ),
            (
                self.rc_output.is_some(),
                root.then("rc_output"),
                "the radio link carries body rates",
            ),
            (
                self.estimator.is_some(),
                root.then("estimator"),
                "the filter predicts by the body rates of the frames",
            ),
            (
                self.navigation.is_some(),
                root.then("navigation"),
                "the estimator predicts by the body rates of the frames",
            ),
            (
                self.cameras.is_some(),
                root.then("cameras"),
                "these cameras measure poses only, and the filter that estimates velocities predicts by body rates",
            ),
        ];
        if let Some((_, key, what)) = sections.into_iter().find(|(is_stated, ..)| *is_stated) {
            let fix = format!("add `[controller.rates]`, which may be empty, or leave `{key}` out");
            found.add(key, format!("{what}, but the controller commands torque"), fix);
        }
    }

    /// Requires motors and a link with sufficient thrust to hover at any time of the flight.
    fn check_hover_thrust(&self, has_good_link: bool, found: &mut Findings) {
        let [least, most] = self.hover_thrusts();
        let vehicle = &self.vehicle;
        if let Some(actuators) = &vehicle.actuators
            && actuators.thrust_max > 0.0
            && most >= actuators.thrust_max
        {
            found.add(
                Key::root().then("vehicle").then("actuators").then("thrust_max"),
                format!(
                    "it takes {} N to hold the vehicle in the air, but its largest thrust is {:?} N",
                    six_digits(most),
                    actuators.thrust_max
                ),
                format!(
                    "raise `thrust_max` above {}, or make the vehicle lighter",
                    six_digits(most)
                ),
            );
        }
        let factor = vehicle
            .actuators
            .as_ref()
            .map_or(1.0, |actuators| actuators.thrust_factor);
        if let Some(link) = &self.rc_output
            && factor > 0.0
            && has_good_link
        {
            check_reach(link, [least / factor, most / factor], found);
        }
    }

    /// Returns the smallest and the largest hover thrust in the course of the flight, N.
    fn hover_thrusts(&self) -> [f64; 2] {
        let (mut mass, mut disturbance) = (self.vehicle.mass, self.vehicle.disturbance);
        let first = hover_thrust(mass, &disturbance);
        self.vehicle
            .change
            .iter()
            .fold([first; 2], |[least, most], change| {
                mass = change.mass.unwrap_or(mass);
                disturbance = change.disturbance.unwrap_or(disturbance);
                let thrust = hover_thrust(mass, &disturbance);
                [least.min(thrust), most.max(thrust)]
            })
    }
}

/// Requires a link that covers the commanded hover thrusts, N.
fn check_reach(link: &RcLink, [least, most]: [f64; 2], found: &mut Findings) {
    let [lowest, highest] = link.thrust_limits();
    let is_low = 0.0 < least && least <= lowest;
    if is_low || most >= highest {
        found.add(
            Key::root().then("rc_output").then("thrust_range"),
            format!(
                "{} N must be commanded to hold the vehicle in the air, but the thrust channel reaches from {} N to {} N",
                six_digits(if is_low { least } else { most }),
                six_digits(lowest),
                six_digits(highest)
            ),
            "widen `thrust_range` or choose another `thrust_offset` and `thrust_slope`; the paper's numbers need [-1.0, 1.0]",
        );
    }
}

/// Returns the thrust that balances gravity and a constant disturbance (in {I}, m/s²) for a mass (kg), N.
fn hover_thrust(mass: f64, disturbance: &Vector) -> f64 {
    let [x, y, z] = *disturbance;
    mass * (x * x + y * y + (z + GRAVITY) * (z + GRAVITY)).sqrt()
}
