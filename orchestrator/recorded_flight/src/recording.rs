//! Samples of a recorded flight, from a table in the format with which PX4 tests EKF2, and which the crate `ekf2` has.
//!
//! A line is `TIME,KIND,NUMBERS…`, with the time in µs of the recorder's clock:
//!
//! | kind | numbers |
//! | --- | --- |
//! | `imu` | specific force (m/s²), angular velocity (rad/s), in {B}: forward, right, down |
//! | `gps` | height (mm), longitude, latitude (1e-7°), velocity to the north, to the east and downwards (m/s); and, if known, the kind (0 single point, 1 RTK float, 2 RTK fixed) and the accuracies: horizontal, vertical (m), velocity (m/s) |
//! | `baro` | altitude (m) |
//! | `mag` | field in {B} (G) |
//! | `landed` | 1 on the ground, 0 in the air |
//! | `armed` | 1 if the motors turn, 0 if not; without such lines they turn in the air |
//!
//! Lines of other sensors are counted, and not used.

use std::collections::BTreeMap;

use shared_types::gnss::FixKind;
use shared_types::sample::Sample;
use shared_types::samples::{BaroAltitude, GnssFix, ImuSample, MagField};
use zerocopy::FromZeros;

/// Kinds of lines that the estimator has no use for.
const UNUSED: [&str; 5] = ["airspeed", "range", "flow", "vio", "drag"];

/// Latest time of a line, µs: a hundred years.
const LATEST_US: u64 = 3_155_760_000_000_000;

/// Wrong line of a table.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct WrongLine {
    /// Number of the line, from 1.
    pub line: usize,
    /// What is wrong, and the fix.
    pub reason: String,
}

impl WrongLine {
    pub(crate) fn new(line: usize, reason: impl Into<String>) -> Self {
        let reason = reason.into();
        Self { line, reason }
    }
}

/// Longest time without a line of any kind, ns: a longer one is a step of the recorder's clock, and not a gap.
const LONGEST_SILENCE_NS: u64 = 60_000_000_000;

/// Value of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timed<T> {
    /// Time of the line, ns of the recorder's clock.
    pub time_ns: u64,
    /// Number of the line, from 1.
    pub line: usize,
    pub value: T,
}

impl<T> Timed<T> {
    /// Returns the time, ns of the recorder's clock, and the number of the line.
    fn place(&self) -> (u64, usize) {
        (self.time_ns, self.line)
    }
}

/// Samples of a recorded flight, of each kind in the order of time. Times of measurements within them are not filled in.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    pub imu: Vec<Timed<ImuSample>>,
    pub fixes: Vec<Timed<GnssFix>>,
    /// Altitudes as recorded, above an origin of their own.
    pub altitudes: Vec<Timed<BaroAltitude>>,
    pub fields: Vec<Timed<MagField>>,
    /// `true` on the ground.
    pub landed: Vec<Timed<bool>>,
    /// `true` if the motors turn.
    pub armed: Vec<Timed<bool>>,
    /// Number of lines of each kind that is not used.
    pub unused: BTreeMap<&'static str, u64>,
}

impl Recording {
    /// Reads a table.
    ///
    /// # Errors
    /// The first wrong line; line 0 if the table lacks a sensor.
    pub fn read(text: &str) -> Result<Self, WrongLine> {
        let mut recording = Self::default();
        for (line, text) in lines(text)? {
            recording
                .add(line, text)
                .map_err(|reason| WrongLine::new(line, reason))?;
        }
        let sensors = [
            ("imu", recording.imu.is_empty()),
            ("gps", recording.fixes.is_empty()),
            ("baro", recording.altitudes.is_empty()),
            ("mag", recording.fields.is_empty()),
            ("landed", recording.landed.is_empty()),
        ];
        match sensors.into_iter().find(|(_, is_missing)| *is_missing) {
            Some((kind, _)) => Err(WrongLine::new(
                0,
                format!("there is no line of `{kind}`, and the estimator needs such"),
            )),
            None => {
                recording.check_times()?;
                recording.check_clock()?;
                recording.check_units()?;
                Ok(recording)
            }
        }
    }

    /// Checks that the recorder's clock does not step forward: a single such line would make a flight of hours.
    fn check_clock(&self) -> Result<(), WrongLine> {
        let mut times: Vec<_> = (self.imu.iter().map(Timed::place))
            .chain(self.fixes.iter().map(Timed::place))
            .chain(self.altitudes.iter().map(Timed::place))
            .chain(self.fields.iter().map(Timed::place))
            .chain(self.landed.iter().map(Timed::place))
            .chain(self.armed.iter().map(Timed::place))
            .collect();
        times.sort_unstable();
        let is_step = |pair: &&[(u64, usize)]| pair[1].0 - pair[0].0 > LONGEST_SILENCE_NS;
        let Some(&[(from_ns, before), (to_ns, line)]) = times.windows(2).find(is_step) else {
            return Ok(());
        };
        Err(WrongLine::new(
            line,
            format!(
                "between {} µs (line {before}) and {} µs there is no line for {:.0} s: if the recorder's clock was set, correct the \
                 times on one side, and if these are two flights, import each alone",
                from_ns / 1000,
                to_ns / 1000,
                (to_ns - from_ns) as f64 * 1e-9
            ),
        ))
    }

    fn add(&mut self, line: usize, text: &str) -> Result<(), String> {
        let mut words = text.split(',').map(str::trim);
        let time = words.next().unwrap_or_default();
        let time_us: u64 = time
            .parse()
            .ok()
            .filter(|time| *time <= LATEST_US)
            .ok_or_else(|| format!("`{time}` is no time in whole µs"))?;
        let kind = words.next().ok_or("there is no kind of sample behind the time")?;
        if let Some(unused) = UNUSED.into_iter().find(|unused| *unused == kind) {
            *self.unused.entry(unused).or_default() += 1;
            return Ok(());
        }
        let numbers = words.map(number).collect::<Result<Vec<f64>, _>>()?;
        let at = At {
            time_ns: time_us * 1000,
            line,
            kind,
        };
        match kind {
            "imu" => at.push(&mut self.imu, imu(numbers_of(kind, &numbers)?)),
            "gps" => at.push(&mut self.fixes, fix(&numbers)?),
            "baro" => at.push(&mut self.altitudes, altitude(numbers_of(kind, &numbers)?)),
            "mag" => at.push(&mut self.fields, field(numbers_of(kind, &numbers)?)),
            "landed" => at.push(&mut self.landed, switch(kind, &numbers)?),
            "armed" => at.push(&mut self.armed, switch(kind, &numbers)?),
            _ => Err(format!(
                "`{kind}` is no kind of sample; there are imu, gps, baro, mag, landed, armed, and unused: {}",
                UNUSED.join(", ")
            )),
        }
    }
}

/// Returns the lines of a table with their numbers, without empty ones.
pub(crate) fn lines(text: &str) -> Result<impl Iterator<Item = (usize, &str)>, WrongLine> {
    // A number of a line that was cut off may be another one.
    if !text.is_empty() && !text.ends_with('\n') {
        let line = text.lines().count();
        return Err(WrongLine::new(
            line,
            "the file ends within this line: copy it again, or remove the line",
        ));
    }
    Ok((1..)
        .zip(text.lines())
        .filter(|(_, text)| !text.trim().is_empty()))
}

/// Returns a finite number.
pub(crate) fn number(word: &str) -> Result<f64, String> {
    let number = word.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("`{word}` is no finite number"))
}

/// Place of a line in a table.
struct At<'a> {
    time_ns: u64,
    line: usize,
    kind: &'a str,
}

impl At<'_> {
    /// Adds a value, which must be later than the last one of its kind.
    fn push<T>(&self, values: &mut Vec<Timed<T>>, value: T) -> Result<(), String> {
        let &Self { time_ns, line, kind } = self;
        if let Some(last) = values.last()
            && last.time_ns >= time_ns
        {
            return Err(format!(
                "the time of `{kind}` goes from {} µs (line {}) to {} µs; sort the lines by time",
                last.time_ns / 1000,
                last.line,
                time_ns / 1000
            ));
        }
        values.push(Timed { time_ns, line, value });
        Ok(())
    }
}

fn numbers_of<const N: usize>(kind: &str, numbers: &[f64]) -> Result<[f64; N], String> {
    numbers
        .try_into()
        .map_err(|_| format!("`{kind}` has {N} numbers, and here are {}", numbers.len()))
}

fn imu(numbers: [f64; 6]) -> ImuSample {
    let [fx, fy, fz, wx, wy, wz] = numbers;
    ImuSample {
        angular_velocity_body: [wx, wy, wz],
        specific_force_body: [fx, fy, fz],
        measured: true.into(),
        ..ImuSample::new_zeroed()
    }
}

fn altitude([altitude]: [f64; 1]) -> BaroAltitude {
    BaroAltitude {
        altitude,
        measured: true.into(),
        ..BaroAltitude::new_zeroed()
    }
}

fn field(field_body: [f64; 3]) -> MagField {
    MagField {
        field_body,
        measured: true.into(),
        ..MagField::new_zeroed()
    }
}

/// Returns a fix. One without accuracies reports none: the estimator then assumes those of its scenario.
fn fix(numbers: &[f64]) -> Result<GnssFix, String> {
    let [height, longitude, latitude, north, east, down] =
        numbers_of("gps", numbers.get(..6).unwrap_or(numbers))?;
    let [kind, horizontal, vertical, speed] = match numbers.len() {
        6 => [0.0; 4],
        10 => numbers_of("gps", &numbers[6..])?,
        count => return Err(format!("`gps` has 6 or 10 numbers, and here are {count}")),
    };
    let kind = FixKind::ALL
        .into_iter()
        .find(|known| f64::from(*known as u8) == kind)
        .ok_or_else(|| format!("{kind} is no kind of fix: 0 single point, 1 RTK float, 2 RTK fixed"))?;
    let fix = GnssFix {
        latitude: latitude * 1e-7,
        longitude: longitude * 1e-7,
        height: height * 1e-3,
        velocity_ned: [north, east, down],
        horizontal_accuracy: horizontal,
        vertical_accuracy: vertical,
        speed_accuracy: speed,
        kind: kind as u8,
        measured: true.into(),
        ..GnssFix::new_zeroed()
    };
    if fix.latitude.abs() > 90.0 || fix.longitude.abs() > 180.0 {
        return Err(format!(
            "{}° north, {}° east is no place; the order is height (mm), longitude, latitude (1e-7°)",
            fix.latitude, fix.longitude
        ));
    }
    if [horizontal, vertical, speed]
        .iter()
        .any(|accuracy| *accuracy < 0.0)
    {
        return Err("an accuracy of `gps` is below 0".to_owned());
    }
    Ok(fix)
}

fn switch(kind: &str, numbers: &[f64]) -> Result<bool, String> {
    match numbers_of(kind, numbers)? {
        [0.0] => Ok(false),
        [1.0] => Ok(true),
        [other] => Err(format!("`{kind}` is 0 or 1, and not {other}")),
    }
}

/// Sample of a sensor with the time of its measurement.
pub trait Measured: Sample {
    /// Sets the time of the measurement, ns since the start of the flight.
    fn set_measured_ns(&mut self, time_ns: u64);
}

impl Measured for ImuSample {
    fn set_measured_ns(&mut self, time_ns: u64) {
        self.measured_ns = time_ns;
    }
}

impl Measured for GnssFix {
    fn set_measured_ns(&mut self, time_ns: u64) {
        self.valid_ns = time_ns;
    }
}

impl Measured for BaroAltitude {
    fn set_measured_ns(&mut self, time_ns: u64) {
        self.measured_ns = time_ns;
    }
}

impl Measured for MagField {
    fn set_measured_ns(&mut self, time_ns: u64) {
        self.measured_ns = time_ns;
    }
}
