//! Performance of a laboratory's cameras and radio link in a flight.

use std::collections::BTreeMap;
use std::fmt::{Display, Formatter, Result};

use serde::Serialize;

use run_log::{CaptureFigures, LinkFigures};
use shared_types::receiver_figures::ReceiverFigures;

/// The performance of a laboratory's equipment, as far as it is there. All counts are since the start of the last
/// process that was connected to it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LaboratoryReport {
    /// The cameras.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion_capture: Option<CaptureReport>,
    /// The receivers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub receivers: Option<ReceiverReport>,
    /// The radio link.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radio_link: Option<LinkReport>,
}

/// The performance of the cameras.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaptureReport {
    /// Frames a second in the last whole second in which any came, Hz.
    pub rate: f64,
    /// Mean time from capture to arrival in that second, s.
    pub latency: f64,
    /// Standard deviation of the time between frames in that second, s.
    pub jitter: f64,
    /// Frames that contain the vehicle or may contain it.
    pub frames: u64,
    /// Frames whose pose was accepted.
    pub believed: u64,
    /// Number of other events, by their names in docs/capture_validation.md; only those that occurred.
    pub happened: BTreeMap<&'static str, u64>,
    /// Reasons of refused packets and poses in words, each with its count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// The performance of the receivers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReceiverReport {
    /// Samples of each sensor that sent any.
    pub samples: BTreeMap<&'static str, u64>,
    /// Samples of each of them in the last whole second, Hz.
    pub rates: BTreeMap<&'static str, f64>,
    /// Packets that were read.
    pub packets: u64,
    /// Number of other events, by their names in docs/receivers.md; only those that occurred.
    pub happened: BTreeMap<&'static str, u64>,
    /// Reasons of refused packets in words, each with its count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// The performance of the radio link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LinkReport {
    /// Sent frames.
    pub sent: u64,
    /// Frames dropped because of a full queue or without a device.
    pub dropped: u64,
    /// Frames that were not sent, so that the receiver's failsafe acts.
    pub silent: u64,
    /// Frames skipped because the sender woke up too late.
    pub left_out: u64,
    /// Number of losses of the device or connection.
    pub losses: u64,
    /// Number of reconnections.
    pub recoveries: u64,
    /// The battery, if the vehicle has sent a voltage.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub battery: Option<BatteryReport>,
    /// Median, 99 % quantile and maximum of the lateness of sent frames, s; `None` if the sender did not finish.
    pub late: Option<[f64; 3]>,
}

/// The battery of the vehicle, as the radio link has measured it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BatteryReport {
    /// Last voltage, V.
    pub voltage: f64,
    /// Age of that voltage at the end, s; 25.5 for any larger one.
    pub age: f64,
    /// Last factor of the thrust; `None` without a correction.
    pub factor: Option<f64>,
    /// `true` if it fell below its lowest voltage.
    pub was_low: bool,
}

impl LaboratoryReport {
    /// Makes the report of the last figures, if any.
    #[must_use]
    pub fn of(
        capture: Option<&CaptureFigures>,
        receivers: Option<&ReceiverFigures>,
        link: Option<&LinkFigures>,
    ) -> Option<Self> {
        let is_there = capture.is_some() || receivers.is_some() || link.is_some();
        is_there.then(|| Self {
            motion_capture: capture.map(CaptureReport::of),
            receivers: receivers.map(ReceiverReport::of),
            radio_link: link.map(LinkReport::of),
        })
    }
}

impl CaptureReport {
    fn of(figures: &CaptureFigures) -> Self {
        let of_packets = [
            ("malformed", figures.malformed),
            ("refused", figures.refused),
            ("others refused", figures.others_refused),
            ("foreign", figures.foreign),
            ("failures", figures.failures),
        ];
        // Events of every flight are reported elsewhere or not at all.
        let is_reported =
            |(name, count): &(&str, u64)| *count > 0 && !["frames", "believed", "settled"].contains(name);
        let happened = figures.named().into_iter().chain(of_packets);
        Self {
            rate: figures.rate,
            latency: figures.latency,
            jitter: figures.jitter,
            frames: figures.frames,
            believed: figures.believed,
            happened: happened.filter(is_reported).collect(),
            refused: Some(figures.reason().into_owned()).filter(|reason| !reason.is_empty()),
        }
    }
}

impl ReceiverReport {
    fn of(figures: &ReceiverFigures) -> Self {
        let sensors = || {
            (0..)
                .zip(ReceiverFigures::SENSORS)
                .filter(|(index, _)| figures.samples[*index] > 0)
        };
        Self {
            samples: sensors()
                .map(|(index, name)| (name, figures.samples[index]))
                .collect(),
            rates: sensors()
                .map(|(index, name)| (name, figures.rates[index]))
                .collect(),
            packets: figures.packets,
            happened: figures.happened().collect(),
            refused: Some(figures.reason().into_owned()).filter(|reason| !reason.is_empty()),
        }
    }
}

impl LinkReport {
    fn of(figures: &LinkFigures) -> Self {
        let late = [figures.late_p50, figures.late_p99, figures.late_max];
        Self {
            sent: figures.sent,
            dropped: figures.dropped,
            silent: figures.silent,
            left_out: figures.left_out,
            losses: figures.losses,
            recoveries: figures.recoveries,
            battery: figures.battery().map(|reading| BatteryReport {
                voltage: reading.voltage,
                age: reading.age,
                factor: reading.factor,
                was_low: false,
            }),
            late: (figures.late_max > 0.0).then_some(late),
        }
    }
}

impl Display for LaboratoryReport {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let lines = [
            self.motion_capture.as_ref().map(ToString::to_string),
            self.receivers.as_ref().map(ToString::to_string),
            self.radio_link.as_ref().map(ToString::to_string),
        ];
        let lines: Vec<_> = lines.into_iter().flatten().collect();
        formatter.write_str(&lines.join("\n"))
    }
}

impl Display for CaptureReport {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        write!(
            formatter,
            "Motion capture: {} frames, {} believed; at last {:.1} Hz, {:.1} ms old on arrival, jitter {:.2} ms.",
            self.frames,
            self.believed,
            self.rate,
            1e3 * self.latency,
            1e3 * self.jitter
        )?;
        write_happened(formatter, &self.happened, self.refused.as_deref())
    }
}

impl Display for ReceiverReport {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        write!(formatter, "Receivers: {} packets", self.packets)?;
        let mut separator = ";";
        for (name, count) in &self.samples {
            let rate = self.rates.get(name).copied().unwrap_or_default();
            write!(formatter, "{separator} {name} {count}, at last {rate:.1} Hz")?;
            separator = ",";
        }
        write!(formatter, ".")?;
        write_happened(formatter, &self.happened, self.refused.as_deref())
    }
}

/// Writes other events with their counts, and the reasons of refusals.
fn write_happened(
    formatter: &mut Formatter<'_>,
    happened: &BTreeMap<&'static str, u64>,
    refused: Option<&str>,
) -> Result {
    let happened = happened.iter().map(|(what, count)| format!("{what} {count}"));
    let happened: Vec<_> = happened.collect();
    if !happened.is_empty() {
        write!(formatter, " {}.", happened.join(", "))?;
    }
    if let Some(reason) = refused {
        write!(formatter, " Reasons: {reason}.")?;
    }
    Ok(())
}

impl Display for LinkReport {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        write!(
            formatter,
            "Radio link: {} frames sent, {} dropped, {} held back for the receiver's failsafe, {} left out; lost {} times, \
             found again {}.",
            self.sent, self.dropped, self.silent, self.left_out, self.losses, self.recoveries
        )?;
        if let Some([half, most, all]) = self.late.map(|late| late.map(|time| 1e3 * time)) {
            write!(
                formatter,
                " Late by {half:.3} ms (half of them), {most:.3} ms (99 of 100), {all:.3} ms at most."
            )?;
        }
        if let Some(battery) = &self.battery {
            write!(
                formatter,
                " Battery: {:.2} V at last, {:.1} s old",
                battery.voltage, battery.age
            )?;
            if let Some(factor) = battery.factor {
                write!(formatter, "; thrust sent times {factor:.2}")?;
            }
            formatter.write_str(".")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    #[test]
    fn only_what_is_there_and_has_happened_is_told() {
        assert_eq!(LaboratoryReport::of(None, None, None), None);
        let figures = CaptureFigures {
            frames: 12,
            believed: 10,
            occluded: 2,
            rate: 100.0,
            ..CaptureFigures::new_zeroed()
        };
        let text = LaboratoryReport::of(Some(&figures), None, None)
            .unwrap()
            .to_string();
        assert!(
            text.contains("12 frames, 10 believed") && text.ends_with(" occluded 2."),
            "{text}"
        );
        assert!(!text.contains("Radio link") && !text.contains("Reasons"));
        let mut spoilt = figures;
        let reason = b"packets refused: 3 times Motive sends NatNet 2.8; 3.x and 4.x are supported";
        spoilt.reason[..reason.len()].copy_from_slice(reason);
        spoilt.reason_length = reason.len() as u32;
        let text = LaboratoryReport::of(Some(&spoilt), None, None)
            .unwrap()
            .to_string();
        assert!(
            text.ends_with("Motive sends NatNet 2.8; 3.x and 4.x are supported."),
            "{text}"
        );
        let receivers = ReceiverFigures {
            samples: [250, 10, 0, 50],
            rates: [249.6, 9.9, 0.0, 50.0],
            packets: 262,
            refused: 2,
            ..ReceiverFigures::new_zeroed()
        };
        let text = LaboratoryReport::of(None, Some(&receivers), None)
            .unwrap()
            .to_string();
        assert_eq!(
            text,
            "Receivers: 262 packets; fields 50, at last 50.0 Hz, fixes 10, at last 9.9 Hz, inertial 250, at last 249.6 Hz. refused 2."
        );
        let link = LinkFigures {
            sent: 7,
            ..LinkFigures::new_zeroed()
        };
        let text = LaboratoryReport::of(None, None, Some(&link)).unwrap().to_string();
        assert!(
            text.contains("7 frames sent") && !text.contains("Late by"),
            "{text}"
        );
    }
}
