//! `gerono import`: a recorded flight as a log on which the estimator can be replayed.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use clap::Args;
use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::output::print;
use host::in_process::{FlightError, InProcess, TickSink};
use metrics::summary::innovations::{self, SourceInnovations};
use metrics::summary::{FlightSummary, RunFacts};
use run_log::run_folder::RunFolder;
use run_log::{Compression, LogError, Manifest, RunLogWriter};
use scenario::Scenario;
use scenario_file::values::between;
use serde::Serialize;
use shared_types::geodesy::Geodetic;
use shared_types::samples::{GnssFix, VehicleState};
use shared_types::service::{ErasedService, nanoseconds, seconds};
use shared_types::{GRAVITY, Schedule, ServiceId, Topic};
use zerocopy::FromBytes;

use crate::publication::{Publications, Rule};
use crate::recording::{Measured, Recording, Timed, WrongLine};
use crate::services::{RecordedEstimate, RecordedMotors, RecordedSensors};
use crate::track::{self, Differences, Track};

/// Distance of the first fix from the datum above which the datum is that of another place, m.
const FARTHEST: f64 = 1000.0;

/// The same for the height alone, m.
const FARTHEST_HEIGHT: f64 = 100.0;

/// Topics that nothing publishes in a recorded flight, or that would be those of a controller that did not fly.
const LEFT_OUT: &str =
    "\"vehicle/truth\", \"path/reference\", \"control/command\", \"control/adaptation\", \"control/errors\"";
/// Topics that the log of the recording's own estimate lacks besides.
const LEFT_OUT_OF_REFERENCE: &str = "\"rc/frame\", \"imu/sample\", \"gnss/fix\", \"baro/altitude\", \"mag/field\", \
     \"navigation/innovations\"";

/// Arguments of `gerono import`.
#[derive(Debug, Args)]
pub struct Import {
    /// The recorded samples: a table in the format of PX4's EKF2 (docs/recorded_flights.md).
    #[arg(value_name = "FILE.csv")]
    pub file: PathBuf,
    /// The scenario with `[navigation]`, `[datum]` and the schedule of the sensors.
    #[arg(long, value_name = "FILE.toml")]
    pub scenario: PathBuf,
    /// Setting that changes the scenario; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
    /// The folder to write into, which must be empty or missing [default: runs/NAME-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// The recording's own estimate, a table of EKF2's states: compare the estimator with it.
    #[arg(long, value_name = "FILE.csv")]
    pub reference: Option<PathBuf>,
    /// Compare from this time on, s since the first sample [default: the start].
    #[arg(long, value_name = "S", requires = "reference", value_parser = between(0.0, 1e6, "s"))]
    pub from: Option<f64>,
    /// Compare up to this time, s [default: the end].
    #[arg(long, value_name = "S", requires = "reference", value_parser = between(0.0, 1e6, "s"))]
    pub to: Option<f64>,
    /// Of fixes, altitudes and fields that come more often than their topics, import the newest ones only.
    #[arg(long)]
    pub thin: bool,
    /// Print JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

impl Import {
    /// The end of `gerono import --help`.
    pub const EXAMPLES: &str = "Examples:\n  \
        gerono import flight.csv --scenario field.toml --out runs/field\n  \
        gerono import flight.csv --scenario field.toml --thin --reference states.csv\n  \
        gerono replay runs/field --service estimator --set navigation.field_white=0.02\n\n\
        Exit codes: 0 imported; 2 a wrong line, or a scenario that does not fit; 4 the log cannot be written.";
}

/// What was imported of a sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Source {
    /// Topic.
    pub topic: &'static str,
    /// Samples in the log.
    pub samples: u64,
    /// Samples that were left out, because they come more often than the topic.
    pub left_out: u64,
    /// Longest time between two recorded samples, s.
    pub longest_gap: f64,
    /// Line of the sample behind it.
    pub gap_ends_at_line: usize,
}

/// Results of an import.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Imported {
    /// Path of the log.
    pub log: PathBuf,
    /// Duration, s.
    pub duration: f64,
    /// Sensors.
    pub sources: Vec<Source>,
    /// Number of lines of each kind that is not used.
    pub unused: BTreeMap<&'static str, u64>,
    /// m, subtracted from the recorded altitudes: the first one is that of the first fix.
    pub altitude_offset: f64,
    /// Time from which the estimator tracked the vehicle, s; `None` if it never did.
    pub tracked_from: Option<f64>,
    /// What became of the measurements of each source in the estimator.
    pub innovations: Vec<SourceInnovations>,
    /// Differences of the estimator from the recording's own estimate; `None` if no row of it could be compared.
    pub differences: Option<Differences>,
    /// Rows of that estimate at which the estimator did not track the vehicle; `None` without one.
    pub untracked_rows: Option<u64>,
}

/// `gerono import`.
///
/// # Errors
/// [`Failure`] if a file cannot be read or has a wrong line, the scenario does not fit, or the log cannot be written.
pub fn import(arguments: &Import) -> Result<Exit, Failure> {
    let imported = run(arguments)?;
    if arguments.json {
        let text = serde_json::to_string_pretty(&imported).map_err(Failure::trouble)?;
        print(text + "\n");
    } else {
        print(shown(&imported));
    }
    Ok(Exit::Success)
}

pub(crate) fn run(arguments: &Import) -> Result<Imported, Failure> {
    let text = text_of(&arguments.file)?;
    let wrong = |path: &Path, error: &WrongLine| match error.line {
        0 => Failure::bad_input(format!("{}: {}", path.display(), error.reason)),
        _ => Failure::bad_input(format!("{}, {error}", path.display())),
    };
    let mut recording = Recording::read(&text).map_err(|error| wrong(&arguments.file, &error))?;
    let stated = load(arguments, &[])?;
    let clock = Clock::new(&recording, &stated).map_err(Failure::bad_input)?;
    let altitude_offset = level_altitudes(&mut recording, &stated)?;
    let placed = Placed::new(&recording, &stated, &clock, arguments.thin)
        .map_err(|error| wrong(&arguments.file, &error))?;
    let duration = clock.duration(&placed);
    let span = [
        arguments.from.unwrap_or(0.0),
        arguments.to.unwrap_or(f64::INFINITY).min(duration),
    ];
    let reference = match &arguments.reference {
        None => None,
        Some(path) => {
            let text = text_of(path)?;
            let frame = stated.datum_or_default().frame();
            let track = track::read(&text, &frame, place(&recording.fixes[0]), |time_ns| {
                time_ns.checked_sub(clock.start_ns)
            });
            let track = track.map_err(|error| wrong(path, &error))?;
            check_overlap(&track, span, path)?;
            Some(track)
        }
    };

    let program = program(&arguments.file);
    let set = |estimator: &str, left_out: &str| {
        [
            format!("duration={duration:?}"),
            format!("programs={{plant={program}, rc_output={program}{estimator}}}"),
            format!("record.leave_out=[{LEFT_OUT}{left_out}]"),
        ]
    };
    let scenario = load(arguments, &set("", ""))?;
    let reference = match reference {
        None => None,
        Some(track) => {
            let set = set(
                &format!(", estimator={program}"),
                &format!(", {LEFT_OUT_OF_REFERENCE}"),
            );
            Some((load(arguments, &set)?, track))
        }
    };
    let motors = motors(&recording, &clock, &scenario);
    let Placed { sensors, sources, .. } = placed;

    // Nothing is written before all is known to fit.
    let name = arguments.file.file_stem().unwrap_or_default().to_string_lossy();
    let folder = RunFolder::create(arguments.out.as_deref(), &name).map_err(Failure::not_written)?;
    let log = folder.run_log();
    let Flown { states, innovations } =
        fly(&scenario, &log, vec![Box::new(sensors), Box::new(motors.clone())])?;
    let (mut differences, mut untracked_rows) = (None, None);
    if let Some((scenario, track)) = reference {
        let (found, untracked) = Differences::of(&states, &track, span);
        (differences, untracked_rows) = (found, Some(untracked));
        let beside = RunFolder::create(Some(&folder.path().join("reference")), &name);
        let beside = beside.map_err(Failure::not_written)?;
        let services: Vec<Box<dyn ErasedService>> = vec![
            Box::new(RecordedSensors::default()),
            Box::new(motors),
            Box::new(RecordedEstimate(track)),
        ];
        fly(&scenario, &beside.run_log(), services)?;
    }
    Ok(Imported {
        log,
        duration,
        sources,
        unused: recording.unused,
        altitude_offset,
        tracked_from: states.0.first().map(|(time_ns, _)| seconds(*time_ns)),
        innovations,
        differences,
        untracked_rows,
    })
}

/// Requires rows of a reference within `[from, to]`, s since the first sample.
fn check_overlap(track: &Track, span: [f64; 2], path: &Path) -> Result<(), Failure> {
    if track.within(span).next().is_some() {
        return Ok(());
    }
    let [from, to] = span;
    let has = match (track.0.first(), track.0.last()) {
        (Some((first_ns, _)), Some((last_ns, _))) => format!(
            "its rows are from {:.1} s to {:.1} s",
            *first_ns as f64 * 1e-9,
            *last_ns as f64 * 1e-9
        ),
        _ => "it has none after the first sample that is aligned".to_owned(),
    };
    Err(Failure::bad_input(format!(
        "{}: no row is between {from:.1} s and {to:.1} s of the recording: {has}; both tables need the same clock, and --from and --to \
         must lie within",
        path.display()
    )))
}

fn text_of(path: &Path) -> Result<String, Failure> {
    let text = std::fs::read_to_string(path);
    text.map_err(|error| Failure::bad_input(format!("cannot read {}: {error}", path.display())))
}

/// Returns the command line that stands for the recording in the scenario of the log.
fn program(file: &Path) -> String {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    serde_json::json!(["gerono", "import", name]).to_string()
}

fn load(arguments: &Import, further: &[String]) -> Result<Scenario, Failure> {
    let sets = [&arguments.sets, further].concat();
    let (scenario, _) = scenario_file::load_shortened(&arguments.scenario, &sets, None)?;
    if scenario.navigation.is_none() || scenario.datum.is_none() {
        return Err(Failure::bad_input(format!(
            "{} has no `[navigation]` or no `[datum]`: take an outdoor scenario, with the place and the magnetic field of the recording",
            arguments.scenario.display()
        )));
    }
    match registry::problem_of_services(&scenario) {
        Some(problem) => Err(scenario_file::refusal(&arguments.scenario, &sets, &problem).into()),
        None => Ok(scenario),
    }
}

fn place(fix: &Timed<GnssFix>) -> Geodetic {
    Geodetic {
        latitude: fix.value.latitude,
        longitude: fix.value.longitude,
        height: fix.value.height,
    }
}

/// Makes the altitudes heights above the datum: the first one is that of the first fix. Returns the recorded one of the datum.
fn level_altitudes(recording: &mut Recording, scenario: &Scenario) -> Result<f64, Failure> {
    let datum = scenario.datum_or_default();
    let first = place(&recording.fixes[0]);
    let from_datum = datum.frame().to_world(first);
    if from_datum.norm() > FARTHEST {
        let is_there = |latitude: f64, longitude: f64| {
            let place = Geodetic {
                latitude,
                longitude,
                ..first
            };
            latitude.abs() <= 90.0 && datum.frame().to_world(place).norm() <= FARTHEST
        };
        let order = "the order is height (mm), longitude, latitude (1e-7°)";
        if is_there(first.longitude, first.latitude) {
            let reason = format!("longitude and latitude of `gps` are exchanged: {order}");
            return Err(Failure::bad_input(reason));
        }
        if is_there(1e7 * first.latitude, 1e7 * first.longitude) {
            let reason =
                format!("longitude and latitude of `gps` look like degrees: multiply by 1e7; {order}");
            return Err(Failure::bad_input(reason));
        }
        return Err(Failure::bad_input(format!(
            "the first fix is {:.0} m from `[datum]`: state latitude = {:.7}, longitude = {:.7}, height = {:.3} there, and the \
             magnetic field of that place",
            from_datum.norm(),
            first.latitude,
            first.longitude,
            first.height
        )));
    }
    if from_datum.z.abs() > FARTHEST_HEIGHT {
        let in_metres = first.height * 1e3 - datum.height;
        let fix = if in_metres.abs() <= FARTHEST_HEIGHT {
            "heights of `gps` are in mm: multiply them by 1000".to_owned()
        } else {
            format!(
                "state height = {:.3} there, or the heights of `gps` in mm",
                first.height
            )
        };
        return Err(Failure::bad_input(format!(
            "the first fix is at {:.3} m and `[datum]` at {:.3} m; {fix}",
            first.height, datum.height
        )));
    }
    let offset = recording.altitudes[0].value.altitude + from_datum.z;
    for altitude in &mut recording.altitudes {
        altitude.value.altitude -= offset;
    }
    Ok(offset)
}

/// Times of a recording as times of the flight.
struct Clock {
    schedule: Schedule,
    /// Start of the flight by the recorder's clock, ns.
    start_ns: u64,
    /// Latest time of a sample, ns since the start of the flight.
    end_ns: u64,
    /// Time from a measurement to the estimator, ns, of fixes.
    fix_latency_ns: u64,
}

/// Returns the time from the publication of a topic to the estimator, ns.
fn latency_ns(schedule: &Schedule, topic: Topic) -> u64 {
    schedule.time_ns(schedule.latency_of(ServiceId::Estimator, topic))
}

impl Clock {
    fn new(recording: &Recording, scenario: &Scenario) -> Result<Self, String> {
        let schedule = flight::schedule_of(scenario).map_err(|error| error.to_string())?;
        let fix_latency_ns = latency_ns(&schedule, Topic::GnssFix);
        let firsts = [
            recording.imu[0].time_ns,
            recording.altitudes[0].time_ns,
            recording.fields[0].time_ns,
        ];
        let first_fix_ns = recording.fixes[0].time_ns;
        let start_ns = firsts
            .into_iter()
            .chain([first_fix_ns.saturating_sub(fix_latency_ns)])
            .min();
        let start_ns = start_ns.unwrap_or_default();
        let lasts = [
            recording.imu.last().map(|sample| sample.time_ns),
            recording.fixes.last().map(|sample| sample.time_ns),
            recording.altitudes.last().map(|sample| sample.time_ns),
            recording.fields.last().map(|sample| sample.time_ns),
        ];
        let end_ns = lasts.into_iter().flatten().max().unwrap_or_default() - start_ns;
        if first_fix_ns - start_ns < fix_latency_ns {
            return Err(format!(
                "the first fix is valid {:.3} s before it was recorded, when the recorder's clock had not begun: remove its line",
                fix_latency_ns as f64 * 1e-9
            ));
        }
        Ok(Self {
            schedule,
            start_ns,
            end_ns,
            fix_latency_ns,
        })
    }

    /// Returns the duration of the flight up to its last sample, s.
    fn duration(&self, placed: &Placed) -> f64 {
        let last = placed
            .last_tick
            .max(self.end_ns.div_ceil(self.schedule.tick_ns()));
        self.schedule.time_ns(last) as f64 / 1e9
    }
}

/// Samples at the ticks at which they are published.
struct Placed {
    sensors: RecordedSensors,
    sources: Vec<Source>,
    last_tick: u64,
}

impl Placed {
    fn new(
        recording: &Recording,
        scenario: &Scenario,
        clock: &Clock,
        thins: bool,
    ) -> Result<Self, WrongLine> {
        let navigation = scenario.navigation.clone().unwrap_or_default();
        let mut placing = Placing {
            clock,
            horizon_ns: nanoseconds(navigation.horizon),
            thins,
            sources: Vec::new(),
            last_tick: 0,
        };
        let sensors = RecordedSensors {
            imu: placing.place(Topic::ImuSample, 0, &recording.imu)?,
            fixes: placing.place(Topic::GnssFix, clock.fix_latency_ns, &recording.fixes)?,
            altitudes: placing.place(Topic::BaroAltitude, 0, &recording.altitudes)?,
            fields: placing.place(Topic::MagField, 0, &recording.fields)?,
        };
        Ok(Self {
            sensors,
            sources: placing.sources,
            last_tick: placing.last_tick,
        })
    }
}

/// Samples that are being placed.
struct Placing<'a> {
    clock: &'a Clock,
    horizon_ns: u64,
    thins: bool,
    sources: Vec<Source>,
    last_tick: u64,
}

impl Placing<'_> {
    /// Places the samples of a topic, recorded `age_ns` after their measurement.
    fn place<T: Measured>(
        &mut self,
        topic: Topic,
        age_ns: u64,
        samples: &[Timed<T>],
    ) -> Result<Publications<T>, WrongLine> {
        let Self {
            clock, horizon_ns, ..
        } = *self;
        let schedule = &clock.schedule;
        let rate = schedule.topic_rate(topic);
        let imu_period_ns = schedule.time_ns(schedule.topic_rate(Topic::ImuSample).period);
        let rule = Rule {
            rate,
            tick_ns: schedule.tick_ns(),
            latest_ns: horizon_ns.saturating_sub(latency_ns(schedule, topic) + imu_period_ns),
            // Motion is the sum of all of its samples.
            thins: self.thins && topic != Topic::ImuSample,
        };
        let flight_ns = |time_ns: u64| time_ns - age_ns - clock.start_ns;
        let (placed, left_out) = rule.place(samples, flight_ns).map_err(|error| {
            let fix = format!(
                "{}: give `schedule.period.\"{topic}\"` another period than {:?} s, or `navigation.horizon` a longer time{}",
                error.reason,
                schedule.time_ns(rate.period) as f64 / 1e9,
                if topic == Topic::ImuSample { "" } else { ", or use --thin" }
            );
            WrongLine::new(error.line, fix)
        })?;
        let gaps = samples
            .windows(2)
            .map(|pair| (pair[1].time_ns - pair[0].time_ns, pair[1].line));
        let (gap_ns, gap_ends_at_line) = gaps.max_by_key(|(gap_ns, _)| *gap_ns).unwrap_or_default();
        self.sources.push(Source {
            topic: topic.name(),
            samples: placed.len() as u64,
            left_out,
            longest_gap: gap_ns as f64 / 1e9,
            gap_ends_at_line,
        });
        self.last_tick = self.last_tick.max(placed.last().map_or(0, |(tick, _)| *tick));
        Ok(placed)
    }
}

/// Returns when the motors turned.
fn motors(recording: &Recording, clock: &Clock, scenario: &Scenario) -> RecordedMotors {
    let mut changes = Vec::new();
    let (mut flies, mut turn) = (false, None);
    let landed = recording
        .landed
        .iter()
        .map(|change| (change.time_ns, Some(!change.value), None));
    let armed = recording
        .armed
        .iter()
        .map(|change| (change.time_ns, None, Some(change.value)));
    let mut recorded: Vec<_> = landed.chain(armed).collect();
    recorded.sort_by_key(|(time_ns, ..)| *time_ns);
    for (time_ns, now_flies, now_turn) in recorded {
        flies = now_flies.unwrap_or(flies);
        turn = now_turn.or(turn);
        changes.push((
            time_ns.saturating_sub(clock.start_ns),
            turn.unwrap_or(flies),
            flies,
        ));
    }
    let mass = scenario
        .model
        .as_ref()
        .map_or(scenario.vehicle.mass, |model| model.mass);
    RecordedMotors {
        changes,
        weight: mass * GRAVITY,
    }
}

/// Writes samples to the log, and collects the states and what became of measurements.
struct Sink {
    log: RunLogWriter,
    states: Track,
    summary: FlightSummary,
}

/// What an estimator made of a recording.
struct Flown {
    /// The tracked states.
    states: Track,
    innovations: Vec<SourceInnovations>,
}

impl TickSink for Sink {
    type Error = LogError;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), LogError> {
        if topic == Topic::VehicleState {
            let state = VehicleState::read_from_bytes(bytes).expect("a sample of this topic");
            self.states.add(&state);
        }
        self.summary.observe(topic, bytes);
        self.log.write(topic, bytes)
    }

    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, LogError> {
        self.log.end_tick(tick)?;
        Ok(ControlFlow::Continue(()))
    }
}

/// Flies a scenario with some services replaced, into a log.
fn fly(scenario: &Scenario, log: &Path, services: Vec<Box<dyn ErasedService>>) -> Result<Flown, Failure> {
    let schedule = flight::schedule_of(scenario).map_err(Failure::bad_input)?;
    let built = registry::build_all(scenario).map_err(Failure::trouble)?;
    let summary = FlightSummary::new(scenario, &schedule);
    let mut host = InProcess::new(schedule, built);
    for service in services {
        host.replace(service);
    }
    let manifest = Manifest::new(scenario);
    let log = RunLogWriter::create(log, &manifest, Compression::None).map_err(Failure::not_written)?;
    let mut sink = Sink {
        log,
        states: Track::default(),
        summary,
    };
    host.fly(&mut sink).map_err(|error| match error {
        FlightError::NonFinite(found) => Failure::trouble(found.to_string()),
        FlightError::Sink(error) => Failure::not_written(error),
    })?;
    sink.log.finish().map_err(Failure::not_written)?;
    Ok(Flown {
        states: sink.states,
        innovations: sink.summary.finish(RunFacts::default()).innovations,
    })
}

pub(crate) fn shown(imported: &Imported) -> String {
    let mut text = format!("{}: {:.3} s\n", imported.log.display(), imported.duration);
    for source in &imported.sources {
        text += &format!(
            "{:14} {:7} samples, {:7.2} Hz, longest gap {:.3} s before line {}",
            source.topic,
            source.samples,
            source.samples as f64 / imported.duration.max(1e-9),
            source.longest_gap,
            source.gap_ends_at_line
        );
        if source.left_out > 0 {
            text += &format!("; {} left out (--thin)", source.left_out);
        }
        text += "\n";
    }
    for (kind, count) in &imported.unused {
        text += &format!("{count} lines of `{kind}` are not used\n");
    }
    text += &format!(
        "altitudes: {:.2} m subtracted, so that the first is the height of the first fix\n",
        imported.altitude_offset
    );
    text += &match imported.tracked_from {
        Some(time) => format!("the estimator tracked the vehicle from {time:.3} s on\n"),
        None => "the estimator never tracked the vehicle: it aligns at rest, with fixes, altitudes and fields that agree\n"
            .to_owned(),
    };
    if !imported.innovations.is_empty() {
        text += &format!("{}\n", innovations::in_words(&imported.innovations));
    }
    for problem in imported.innovations.iter().filter_map(SourceInnovations::problem) {
        text += &format!("NAVIGATION: {problem}\n");
    }
    if let Some(rows) = imported.untracked_rows.filter(|rows| *rows > 0) {
        let compared = if imported.differences.is_none() {
            "nothing"
        } else {
            "not all"
        };
        text += &format!(
            "{compared} of the reference was compared: at {rows} of its rows the estimator did not track the vehicle\n"
        );
    }
    if let Some(found) = &imported.differences {
        let [from, to] = found.span;
        text += &format!(
            "differences from the reference in {} rows, {from:.1} s to {to:.1} s: largest of a component, root mean square\n",
            found.rows
        );
        for (name, unit, factor, found) in [
            ("velocity", "m/s", 1.0, &found.velocity),
            ("position", "m", 1.0, &found.position),
            ("attitude", "°", 1f64.to_degrees(), &found.attitude),
        ] {
            text += &format!(
                "{name:14} {:7.3} {unit}, {:7.3} {unit}\n",
                factor * found.largest,
                factor * found.rms
            );
        }
    }
    text
}
