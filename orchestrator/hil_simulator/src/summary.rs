//! Texts of a simulation, and its summary.

use std::fmt::{Display, Formatter};

use scenario::Scenario;
use serde::Serialize;
use shared_types::capture_figures::LATE_NS;
use shared_types::service::seconds;

use super::cameras::LateCaptures;
use super::{HilReport, Timing};

/// Returns the text at the start of a simulation.
#[must_use]
pub fn introduction(scenario: &Scenario, timing: &Timing, is_betaflight: bool) -> String {
    let Timing {
        capture_rate,
        capture_latency,
        radio_latency,
    } = timing;
    let link = scenario.radio_link().map_or("", |link| link.name());
    let onboard = if is_betaflight {
        "on board: Betaflight, by its simulator's UDP ports".to_owned()
    } else {
        format!(
            "receiver: `{link}`, frames act {:.1} ms after their arrival",
            1e3 * radio_latency
        )
    };
    let receivers = scenario.real_receivers().map(|receivers| {
        format!(
            "receivers: NAV-PVT {:.1} ms after a fix, HIGHRES_IMU after {:.1} ms, to {}\n",
            1e3 * receivers.fix_latency,
            1e3 * receivers.latency,
            receivers.sources.join(", ")
        )
    });
    let cameras = scenario.capture_system().map(|(system, _)| {
        format!(
            "cameras: `{}`, {capture_rate:.1} poses per second, {:.1} ms after their exposure\n",
            system.name(),
            1e3 * capture_latency
        )
    });
    let [cameras, receivers] = [cameras, receivers].map(Option::unwrap_or_default);
    format!(
        "{cameras}{receivers}{onboard}\nthe simulation starts now; fly with the same settings, and end it with Ctrl-C\n"
    )
}

/// Returns the warning at the first pose, or packet of receivers, that is sent late.
#[must_use]
pub fn warning(scenario: &Scenario, late: LateCaptures, is_fifo: bool) -> String {
    let what = match (scenario.capture_system(), scenario.real_receivers()) {
        (Some(_), Some(_)) => "cameras or receivers are late: a pose or packet",
        (None, Some(_)) => "receivers are late: a packet",
        (_, None) => "cameras are late: a pose",
    };
    let remedy = if is_fifo {
        "give the simulator a core of its own (`taskset`)"
    } else {
        "`gerono world --fifo` puts the simulator above ordinary processes"
    };
    format!(
        "the {what} was sent {:.1} ms after it was due; the flight is not to blame for what follows from it; \
         {remedy}",
        1e3 * seconds(late.worst_ns)
    )
}

/// Summary of a simulation, printed and written as JSON.
#[derive(Serialize)]
pub struct Summary {
    /// Simulated time, s.
    seconds: f64,
    /// Poses, or packets of receivers, sent.
    poses: u64,
    /// Those of them that were sent more than 5 ms late.
    late_poses: u64,
    /// Maximum lateness of one, s.
    latest_pose: f64,
    /// Frames with commands, or packets of motors.
    frames: u64,
    /// Bytes outside of valid frames.
    skipped: u64,
    /// Link losses.
    losses: u64,
    /// Lateness of ticks: median, 99th percentile and maximum, s.
    late: [f64; 3],
}

impl Summary {
    /// Makes the summary of a report; `tick_ns` is the duration of a tick.
    #[must_use]
    pub fn new(report: &HilReport, tick_ns: u64) -> Self {
        let late = |quantile| seconds(report.lateness_ns.value_at_quantile(quantile));
        Self {
            seconds: seconds(report.ticks * tick_ns),
            poses: report.poses,
            late_poses: report.late.count,
            latest_pose: seconds(report.late.worst_ns),
            frames: report.received.frames,
            skipped: report.received.skipped,
            losses: report.received.losses,
            late: [late(0.5), late(0.99), late(1.0)],
        }
    }
}

impl Display for Summary {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        let [p50, p99, max] = self.late.map(|late| 1e3 * late);
        writeln!(
            formatter,
            "{:.3} s simulated; {} poses or packets sent, {} frames received, {} bytes outside of frames, {} link losses\n\
             lateness of ticks: median {p50:.3} ms, p99 {p99:.3} ms, maximum {max:.3} ms\n\
             {} of {} poses or packets sent more than {:.0} ms late, the latest by {:.3} ms",
            self.seconds,
            self.poses,
            self.frames,
            self.skipped,
            self.losses,
            self.late_poses,
            self.poses,
            1e3 * seconds(LATE_NS),
            1e3 * self.latest_pose
        )
    }
}
