//! `gerono-bench recorder`: cost of recording a sample, compared with the MCAP library alone, and growth of memory.
//!
//! Both write the same messages of a flight of Fig. 1 to files in memory, in turn, uncompressed, on one thread. The library
//! receives each message ready-made, with its header, and is used as documented. CPU time is compared, which a busy machine
//! disturbs less than wall time.

use std::convert::Infallible;
use std::fs::File;
use std::io::BufWriter;
use std::ops::{ControlFlow, Range};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::time::{Duration, Instant};

use comfy_table::{Table, presets};
use host::in_process::TickSink;
use mcap::records::MessageHeader;
use mcap::{McapResult, WriteOptions, Writer};
use rustix::time::{ClockId, clock_gettime};
use scenario::Scenario;
use serde::Serialize;
use shared_types::Topic;
use shared_types::sample::CDR_HEADER;
use shared_types::service::header_of;

use super::clipped;
use super::measure::{Result, Scratch, median, progress_of};
use crate::arguments::BenchRecorder;
use command_line::failure::Failure;
use command_line::output::{print, write_json};
use flight::interrupt::Interrupt;
use flight::{Outcome, in_process};
use run_log::{Compression, LogError, Manifest, RunLogWriter, partial_path};
use supervisor::RunFailure;

/// Duration of the flight whose samples are written repeatedly, s.
const FLIGHT_SECONDS: f64 = 2.0;

/// Number of times that its samples are written in one measurement.
const ROUNDS: u64 = 15;

/// Results of the measurement: medians of the repetitions.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    /// Samples in a measurement.
    samples: u64,
    /// Median of the pairwise ratios of the recorder's CPU time to the library's.
    ratio: Option<f64>,
    /// CPU time per sample, s.
    recorder_cpu_seconds_per_sample: Option<f64>,
    library_cpu_seconds_per_sample: Option<f64>,
    /// Samples per second of wall time.
    recorder_samples_per_second: Option<f64>,
    library_samples_per_second: Option<f64>,
    memory: Memory,
}

/// The memory of this process while it recorded a long flight, bytes.
#[derive(Clone, Copy, Debug, Serialize)]
struct Memory {
    samples: u64,
    /// Peak over the first tenth of the flight.
    peak_of_first_tenth: u64,
    /// Peak over the whole flight.
    peak: u64,
}

/// `gerono-bench recorder`.
///
/// # Errors
/// [`Failure`].
pub(super) fn recorder(scenario: &Scenario, arguments: &BenchRecorder) -> std::result::Result<(), Failure> {
    let measured = measure(scenario, arguments).map_err(Failure::trouble)?;
    print(format!("{}\n", table(&measured)));
    if let Some(path) = &arguments.json {
        write_json(path, &measured)?;
    }
    Ok(())
}

fn measure(scenario: &Scenario, arguments: &BenchRecorder) -> Result<Measured> {
    let flight = Scenario {
        duration: FLIGHT_SECONDS,
        ..scenario.clone()
    };
    let flight = Scenario {
        vehicle: clipped(&flight),
        ..flight
    };
    let messages = Messages::fly(&flight)?;
    let folder = Scratch::create()?;
    let path = folder.path().join("run.mcap");
    let manifest = Manifest::new(&flight);
    // Measured first, so that no earlier measurement has left memory for reuse.
    let memory = memory(&path, &manifest, &messages, arguments.minutes)?;

    let [mut ours, mut library] = [Series::default(), Series::default()];
    let samples = ROUNDS * messages.all.len() as u64;
    let bar = progress_of("repetition", u64::from(arguments.repetitions));
    for repetition in 0..arguments.repetitions {
        let record = || messages.record(RunLogWriter::create(&path, &manifest, Compression::None)?, ROUNDS);
        let write = || {
            messages
                .write_by_library(&path, ROUNDS)
                .map_err(RunFailure::setup)
        };
        // The order alternates: the second writer benefits from the warm memory of the file.
        if repetition.is_multiple_of(2) {
            ours.measure(|| Ok(record()?))?;
            library.measure(write)?;
        } else {
            library.measure(write)?;
            ours.measure(|| Ok(record()?))?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let ratios = ours.cpu_seconds.iter().zip(&library.cpu_seconds);
    Ok(Measured {
        samples,
        ratio: median(ratios.map(|(ours, library)| ours / library).collect()),
        recorder_cpu_seconds_per_sample: ours.cpu_seconds_per(samples),
        library_cpu_seconds_per_sample: library.cpu_seconds_per(samples),
        recorder_samples_per_second: ours.per_wall_second(samples),
        library_samples_per_second: library.per_wall_second(samples),
        memory,
    })
}

/// Times of repeated measurements, s.
#[derive(Default)]
struct Series {
    cpu_seconds: Vec<f64>,
    wall_seconds: Vec<f64>,
}

impl Series {
    fn measure(&mut self, work: impl FnOnce() -> Result<()>) -> Result<()> {
        let (wall, cpu) = (Instant::now(), cpu_time());
        work()?;
        self.cpu_seconds.push((cpu_time() - cpu).as_secs_f64());
        self.wall_seconds.push(wall.elapsed().as_secs_f64());
        Ok(())
    }

    fn cpu_seconds_per(&self, samples: u64) -> Option<f64> {
        median(self.cpu_seconds.clone()).map(|seconds| seconds / samples as f64)
    }

    fn per_wall_second(&self, samples: u64) -> Option<f64> {
        median(self.wall_seconds.clone()).map(|seconds| samples as f64 / seconds)
    }
}

/// Returns the CPU time of this thread.
fn cpu_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.cast_unsigned(), time.tv_nsec as u32)
}

/// A recorded sample, with the fields that the library requires.
struct Message {
    topic: Topic,
    sequence: u32,
    time_ns: u64,
    /// Range of its bytes, including the CDR header.
    range: Range<usize>,
}

/// The samples of a flight, tick by tick.
#[derive(Default)]
struct Messages {
    bytes: Vec<u8>,
    all: Vec<Message>,
    /// Number of samples up to the end of each tick.
    ticks: Vec<usize>,
}

impl Messages {
    /// Flies a scenario and collects its samples.
    fn fly(flight: &Scenario) -> Result<Self> {
        let mut messages = Self::default();
        let ending = in_process::fly(flight, &mut messages, &Interrupt::never())?;
        match ending.outcome {
            Outcome::Completed => Ok(messages),
            outcome => Err(RunFailure::setup(format!(
                "the flight to be recorded ended early: {outcome}"
            ))),
        }
    }

    fn bytes(&self, message: &Message) -> &[u8] {
        &self.bytes[message.range.clone()]
    }

    /// Writes the samples `rounds` times with the writer of a run's log.
    fn record(&self, mut log: RunLogWriter, rounds: u64) -> std::result::Result<(), LogError> {
        let ticks_per_round = self.ticks.len() as u64;
        for round in 0..rounds {
            self.record_once(&mut log, round * ticks_per_round)?;
        }
        log.finish().map(drop)
    }

    /// Writes the samples once, with ticks from `first_tick` on.
    fn record_once(&self, log: &mut RunLogWriter, first_tick: u64) -> std::result::Result<(), LogError> {
        let mut begin = 0;
        for (tick, &end) in (first_tick..).zip(&self.ticks) {
            for message in &self.all[begin..end] {
                log.write(message.topic, &self.bytes(message)[CDR_HEADER.len()..])?;
            }
            log.end_tick(tick)?;
            begin = end;
        }
        Ok(())
    }

    /// Writes the samples `rounds` times with the library alone.
    fn write_by_library(&self, path: &Path, rounds: u64) -> McapResult<()> {
        // A new file each time, as for the recorder.
        let _earlier = std::fs::remove_file(path);
        let file = BufWriter::new(result_file::new_file(path)?);
        let mut writer: Writer<_> = WriteOptions::new().compression(None).create(file)?;
        let mut channels = [0; Topic::ALL.len()];
        for topic in Topic::ALL {
            let definition = topic.msg_definition();
            let schema = writer.add_schema(topic.msg_name(), "ros2msg", definition.as_bytes())?;
            channels[topic.index()] =
                writer.add_channel(schema, topic.name(), "cdr", &std::collections::BTreeMap::new())?;
        }
        for _ in 0..rounds {
            for message in &self.all {
                let header = MessageHeader {
                    channel_id: channels[message.topic.index()],
                    sequence: message.sequence,
                    log_time: message.time_ns,
                    publish_time: message.time_ns,
                };
                writer.write_to_known_channel(&header, self.bytes(message))?;
            }
        }
        writer.finish().map(drop)
    }
}

impl TickSink for Messages {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> std::result::Result<(), Infallible> {
        let header = header_of(bytes);
        let begin = self.bytes.len();
        self.bytes.extend_from_slice(&CDR_HEADER);
        self.bytes.extend_from_slice(bytes);
        self.all.push(Message {
            topic,
            sequence: header.seq as u32,
            time_ns: header.stamp_ns,
            range: begin..self.bytes.len(),
        });
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> std::result::Result<ControlFlow<()>, Infallible> {
        self.ticks.push(self.all.len());
        Ok(ControlFlow::Continue(()))
    }
}

/// Records `minutes` of flight to `/dev/null` and measures the memory of this process.
fn memory(path: &Path, manifest: &Manifest, messages: &Messages, minutes: f64) -> Result<Memory> {
    symlink("/dev/null", partial_path(path)).map_err(RunFailure::setup)?;
    let nowhere = File::options().write(true).open("/dev/null");
    let nowhere = nowhere.map_err(RunFailure::setup)?;
    let mut log = RunLogWriter::over(nowhere, path, manifest, Compression::None)?;
    let ticks_per_round = messages.ticks.len() as u64;
    let rounds = ((60.0 * minutes / FLIGHT_SECONDS) as u64).max(10);
    let [mut peak_of_first_tenth, mut peak] = [0; 2];
    let bar = progress_of("round", rounds);
    for round in 0..rounds {
        messages.record_once(&mut log, round * ticks_per_round)?;
        peak = resident_bytes()?.max(peak);
        if round < rounds / 10 {
            peak_of_first_tenth = peak;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    log.finish()?;
    std::fs::remove_file(path).map_err(RunFailure::setup)?;
    Ok(Memory {
        samples: rounds * messages.all.len() as u64,
        peak_of_first_tenth,
        peak,
    })
}

/// Returns the resident memory of this process, bytes.
fn resident_bytes() -> Result<u64> {
    const KIB: u64 = 1024;
    let status = std::fs::read_to_string("/proc/self/status").map_err(RunFailure::setup)?;
    let stated = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = stated.and_then(|stated| stated.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    kib.map(|kib| KIB * kib)
        .ok_or_else(|| RunFailure::setup("/proc/self/status does not state VmRSS"))
}

fn table(measured: &Measured) -> Table {
    let shown = |value: Option<f64>, scale: f64, digits: usize| {
        value.map_or_else(|| "–".to_owned(), |value| format!("{:.digits$}", scale * value))
    };
    let mib = |bytes: u64| format!("{:.1}", bytes as f64 / f64::from(1 << 20));
    let memory = &measured.memory;
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
        "recording Fig. 1, uncompressed".to_owned(),
        "recorder".to_owned(),
        "library alone".to_owned(),
        "ratio".to_owned(),
    ]);
    table.add_row([
        "CPU time per sample, ns".to_owned(),
        shown(measured.recorder_cpu_seconds_per_sample, 1e9, 0),
        shown(measured.library_cpu_seconds_per_sample, 1e9, 0),
        shown(measured.ratio, 1.0, 2),
    ]);
    table.add_row([
        "thousand samples per second".to_owned(),
        shown(measured.recorder_samples_per_second, 1e-3, 0),
        shown(measured.library_samples_per_second, 1e-3, 0),
        String::new(),
    ]);
    table.add_row([
        format!(
            "peak memory in the first tenth of {} samples, MiB",
            memory.samples
        ),
        mib(memory.peak_of_first_tenth),
        String::new(),
        String::new(),
    ]);
    table.add_row([
        "peak memory over all samples, MiB".to_owned(),
        mib(memory.peak),
        String::new(),
        format!("{:.2}", memory.peak as f64 / memory.peak_of_first_tenth as f64),
    ]);
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario_of_own_controller as scenario;

    #[test]
    fn the_library_writes_the_same_messages_as_the_recorder() {
        let folder = tempfile::tempdir().unwrap();
        let [ours, plain] = ["ours", "plain"].map(|name| folder.path().join(name));
        let flight = scenario(0.01, 0.5);
        let messages = Messages::fly(&flight).unwrap();
        let manifest = Manifest::new(&flight);
        let log = RunLogWriter::create(&ours, &manifest, Compression::None).unwrap();
        messages.record(log, 3).unwrap();
        messages.write_by_library(&plain, 3).unwrap();
        let [ours, plain] = [ours, plain].map(|path| {
            let file = std::fs::read(path).unwrap();
            let messages = mcap::MessageStream::new(&file).unwrap().map(|message| {
                let message = message.unwrap();
                let data = message.data.into_owned();
                (
                    message.channel.topic.clone(),
                    message.sequence,
                    message.log_time,
                    data,
                )
            });
            messages.collect::<Vec<_>>()
        });
        assert_eq!(ours.len(), 3 * messages.all.len());
        assert!(ours == plain);
    }
}
