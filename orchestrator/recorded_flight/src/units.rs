//! Units of a recording, which its numbers betray: the weight, the field of the earth, and the barometer beside the receiver.

use shared_types::GRAVITY;
use shared_types::gnss::FixKind;
use shared_types::samples::GnssFix;

use crate::recording::{Recording, Timed, WrongLine};

/// Median of the specific force of a vehicle that flies, m/s².
const FORCE: [f64; 2] = [0.4 * GRAVITY, 2.5 * GRAVITY];

/// Median of the field of the earth beside a vehicle's iron, G; it is 0.22 to 0.67 G without that.
const FIELD: [f64; 2] = [0.1, 1.5];

/// Largest angular velocity that an inertial measurement unit can tell, 4000°/s, rad/s.
const ANGULAR_VELOCITY: f64 = 70.0;

/// Median span between two inertial samples, µs: 1 Hz to 20 kHz.
const SPAN: [f64; 2] = [50.0, 1e6];

/// Number of inertial samples below which a gap may be their median span.
const FEW: usize = 20;

/// Median horizontal accuracy of fixes with known carrier numbers, m; none is known below the one.
const ACCURACY: [f64; 2] = [0.0, 1.0];

/// Climb above which the receiver's heights must have changed as well, m, and how much less those may have changed.
const CLIMB: f64 = 3.0;
const LESS_CLIMB: f64 = 50.0;

/// Unit that a number may have been written in, and the factor to the right one.
type Slip = (&'static str, f64);

impl Recording {
    /// Refuses times in another unit.
    pub(crate) fn check_times(&self) -> Result<(), WrongLine> {
        let spans = self
            .imu
            .windows(2)
            .map(|pair| 1e-3 * (pair[1].time_ns - pair[0].time_ns) as f64);
        if self.imu.len() < FEW {
            return Ok(());
        }
        let slips = [("ms", 1e3), ("ns", 1e-3), ("s", 1e6)];
        check(
            "spans between inertial samples",
            "µs",
            SPAN,
            &slips,
            median(spans),
        )
        .map_err(|reason| WrongLine::new(self.imu[1].line, reason))
    }

    /// Refuses a recording whose numbers can only be in other units than the format's.
    pub(crate) fn check_units(&self) -> Result<(), WrongLine> {
        let forces = self
            .imu
            .iter()
            .map(|sample| norm(sample.value.specific_force_body));
        let slips = [("g", GRAVITY), ("mg", 1e-3 * GRAVITY)];
        check("specific forces", "m/s²", FORCE, &slips, median(forces))
            .map_err(|reason| WrongLine::new(self.imu[0].line, reason))?;
        let fields = self.fields.iter().map(|sample| norm(sample.value.field_body));
        let slips = [("µT", 1e-2), ("mG", 1e-3), ("nT", 1e-5), ("T", 1e4)];
        check("magnetic fields", "G", FIELD, &slips, median(fields))
            .map_err(|reason| WrongLine::new(self.fields[0].line, reason))?;
        self.check_rates()?;
        self.check_accuracies()?;
        self.check_heights()
    }

    fn check_accuracies(&self) -> Result<(), WrongLine> {
        let is_fixed = |fix: &&Timed<_>| is_rtk_fixed(&fix.value);
        let Some(first) = self.fixes.iter().find(is_fixed) else {
            return Ok(());
        };
        let accuracies = self
            .fixes
            .iter()
            .filter(is_fixed)
            .map(|fix| fix.value.horizontal_accuracy);
        let slips = [("mm", 1e-3), ("cm", 1e-2)];
        check(
            "horizontal accuracies of RTK fixes",
            "m",
            ACCURACY,
            &slips,
            median(accuracies),
        )
        .map_err(|reason| WrongLine::new(first.line, reason))
    }

    fn check_rates(&self) -> Result<(), WrongLine> {
        let is_too_fast = |rates: [f64; 3]| rates.iter().any(|rate| rate.abs() > ANGULAR_VELOCITY);
        let found = self
            .imu
            .iter()
            .find(|sample| is_too_fast(sample.value.angular_velocity_body));
        found.map_or(Ok(()), |sample| {
            let reason = format!(
                "the angular velocity {:?} is more than any inertial measurement unit can tell in rad/s; if it is in °/s, divide by 57.2958",
                sample.value.angular_velocity_body
            );
            Err(WrongLine::new(sample.line, reason))
        })
    }

    fn check_heights(&self) -> Result<(), WrongLine> {
        let climbed = range(self.altitudes.iter().map(|sample| sample.value.altitude));
        let fixed = range(self.fixes.iter().map(|fix| fix.value.height));
        if climbed < CLIMB || fixed * LESS_CLIMB > climbed {
            return Ok(());
        }
        let reason = format!(
            "the heights of `gps` change by {fixed:.3} m where the altitudes of `baro` change by {climbed:.1} m; heights must be in mm: \
             if they are in m, multiply by 1000"
        );
        Err(WrongLine::new(self.fixes[0].line, reason))
    }
}

fn is_rtk_fixed(fix: &GnssFix) -> bool {
    fix.kind == FixKind::RtkFixed as u8
}

/// Checks a median against its range, and names the unit with which it would lie there.
fn check(what: &str, unit: &str, [low, high]: [f64; 2], slips: &[Slip], median: f64) -> Result<(), String> {
    let is_within = |value: f64| (low..=high).contains(&value);
    if is_within(median) {
        return Ok(());
    }
    let slip = slips.iter().find(|(_, factor)| is_within(median * factor));
    let fix = slip.map_or_else(
        || format!("give them in {unit}"),
        |(wrong, factor)| format!("they look like {wrong}: multiply by {factor}"),
    );
    Err(format!(
        "the {what} have a median of {median:.3}, and in {unit} that is {low:.2} to {high:.2}; {fix}"
    ))
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    nalgebra::Vector3::new(x, y, z).norm()
}

/// Returns the middle one of finite values; at least one.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Returns the largest value less the smallest one.
fn range(values: impl Iterator<Item = f64>) -> f64 {
    let ends = |[low, high]: [f64; 2], value: f64| [low.min(value), high.max(value)];
    let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], ends);
    high - low
}
