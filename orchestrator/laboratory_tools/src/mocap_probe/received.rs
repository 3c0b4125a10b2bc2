//! Statistics of the packets that `gerono mocap probe` has received, by body.

use std::collections::BTreeMap;
use std::fmt::Write;

use comfy_table::{Table, presets};
use motion_capture::diagnosis::FAR;
use motion_capture::figures::Moments;
use motion_capture::transport::CaptureSource;
use motion_capture::wire::{Frame, Name, PoseError, WireBody};
use nalgebra::{Matrix3, Vector3};
use scenario::{BodyNumbers, CaptureSystem};
use shared_types::rotation::orthonormalized;

use super::AT_REST;

/// Standard deviation of the position of a body at rest that is below the noise of any camera, m.
const NO_NOISE: f64 = 1e-6;

/// Maximum number of stored bodies and delays.
const BODIES: usize = 1000;
const DELAYS: usize = 1 << 20;

/// The poses of a body.
pub(super) struct Body {
    /// Last name received; Motive sends names only after the first frames.
    pub(super) name: Name,
    pub(super) number: i32,
    refused: u64,
    reason: Option<PoseError>,
    frames: u64,
    tracked: u64,
    coordinates: [Moments; 3],
    rotation: Matrix3<f64>,
}

impl Body {
    fn new(number: i32) -> Self {
        Self {
            name: Name::EMPTY,
            number,
            refused: 0,
            reason: None,
            frames: 0,
            tracked: 0,
            coordinates: [Moments::default(); 3],
            rotation: Matrix3::zeros(),
        }
    }

    /// Returns the reason why the body's poses are implausible, if so.
    fn implausibility(&self) -> Option<String> {
        if let Some(reason) = self.reason {
            return Some(format!("{} times {reason}", self.refused));
        }
        if self.tracked > 1 && self.position().norm() > FAR {
            let distance = self.position().norm();
            return Some(format!(
                "{distance:.0} m from the origin: centimetres or millimetres?"
            ));
        }
        (self.tracked > 1 && self.deviation() < NO_NOISE).then(|| {
            "noise below 1 µm, less than any camera's: metres for millimetres, or a frozen pose?".to_owned()
        })
    }

    fn add(&mut self, body: &WireBody) {
        self.frames += 1;
        if body.name != Name::EMPTY {
            self.name = body.name;
        }
        let Some(pose) = &body.pose else {
            return;
        };
        self.tracked += 1;
        for (moments, coordinate) in self.coordinates.iter_mut().zip(pose.position.iter()) {
            moments.push(*coordinate);
        }
        self.rotation += pose.capture_from_markers;
    }

    /// Returns the mean position in the capture frame, m.
    pub(super) fn position(&self) -> Vector3<f64> {
        Vector3::from(self.coordinates.map(|moments| moments.mean()))
    }

    /// Returns the largest standard deviation of a coordinate, m.
    pub(super) fn deviation(&self) -> f64 {
        self.coordinates
            .iter()
            .map(Moments::deviation)
            .fold(0.0, f64::max)
    }

    /// Returns the mean of the rotation matrices, which is no rotation.
    fn mean_matrix(&self) -> Matrix3<f64> {
        #[expect(clippy::cast_precision_loss, reason = "an hour of frames is exact")]
        let tracked = self.tracked.max(1) as f64;
        self.rotation / tracked
    }

    pub(super) fn mean_rotation(&self) -> Matrix3<f64> {
        (0..8).fold(self.mean_matrix(), |rotation, _| orthonormalized(&rotation))
    }

    /// Returns the standard deviation of the attitude about each axis, root mean square, rad.
    fn attitude_deviation(&self) -> f64 {
        // For small angles θ about the mean rotation, tr(R̄ᵀ R) = 3 − |θ|².
        let square = 3.0 - (self.mean_rotation().transpose() * self.mean_matrix()).trace();
        (square.max(0.0) / 3.0).sqrt()
    }
}

/// Statistics of the received packets.
#[derive(Default)]
pub(super) struct ReceivedPackets {
    pub(super) frames: u64,
    first_ns: u64,
    last_ns: u64,
    /// Times between frames, s.
    intervals: Moments,
    /// Times from stamp to arrival, ns, up to the unknown offset of the clocks.
    delays_ns: Vec<i64>,
    /// Bodies by id, if the system has ids, or else by name and sensor.
    pub(super) bodies: BTreeMap<(Vec<u8>, i32), Body>,
    has_ids: bool,
}

impl ReceivedPackets {
    pub(super) fn new(system: CaptureSystem) -> Self {
        Self {
            has_ids: system.properties().numbers == BodyNumbers::Body,
            ..Self::default()
        }
    }

    /// Adds a frame.
    pub(super) fn add(&mut self, frame: &Frame, now_ns: u64) {
        if self.frames == 0 {
            self.first_ns = now_ns;
        } else {
            self.intervals.push(seconds(now_ns - self.last_ns));
        }
        self.frames += 1;
        self.last_ns = now_ns;
        // Limits memory: a server may send any number of frames and names.
        if let Some(stamp) = frame.stamp.filter(|_| self.delays_ns.len() < DELAYS) {
            let delay_ns = now_ns.cast_signed().saturating_sub(stamp.sent_ns);
            self.delays_ns.push(delay_ns);
        }
        for body in frame.bodies() {
            let key = self.key(body);
            if self.bodies.len() < BODIES || self.bodies.contains_key(&key) {
                let entry = self.bodies.entry(key).or_insert_with(|| Body::new(body.number));
                entry.add(body);
            }
        }
        for (body, reason) in frame.refused() {
            if let Some(entry) = self.bodies.get_mut(&self.key(body)) {
                entry.refused += 1;
                entry.reason = Some(reason);
            }
        }
    }

    fn key(&self, body: &WireBody) -> (Vec<u8>, i32) {
        let name = if self.has_ids { &[] } else { body.name.as_bytes() };
        (name.to_vec(), body.number)
    }

    /// Returns the frame rate, Hz.
    pub(super) fn rate(&self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "an hour of frames is exact")]
        let frames = self.frames.saturating_sub(1) as f64;
        frames / seconds(self.last_ns - self.first_ns).max(1e-9)
    }

    pub(super) fn describe(&self, source: &dyn CaptureSource, has_time: bool) -> String {
        let counts = source.counts();
        let mut text = format!(
            "packets {}, frames {}, malformed {}, from strangers {}, connections {}, failures {}\n",
            counts.packets,
            counts.frames,
            counts.malformed.total(),
            counts.foreign,
            counts.connections,
            counts.failures
        );
        if let Some(server) = source.server() {
            writeln!(text, "{server}").expect("a String takes all");
        }
        if counts.continued > 0 {
            writeln!(
                text,
                "{} datagrams continued a previous frame: choose a larger block in Tracker",
                counts.continued
            )
            .expect("a String takes all");
        }
        let mut announced = Vec::new();
        source.announced(&mut |body| announced.push(format!("`{}`", body.name)));
        if !announced.is_empty() {
            writeln!(text, "announced: {}", announced.join(", ")).expect("a String takes all");
        }
        if self.frames > 1 {
            writeln!(
                text,
                "{:.2} packets of poses per second, arrival jitter {:.3} ms (one standard deviation)",
                self.rate(),
                1e3 * self.intervals.deviation()
            )
            .expect("a String takes all");
        }
        if let (Some([p50, p99, max]), true) = (self.excess_delays(), has_time) {
            writeln!(
                text,
                "delay in excess of the minimum, by the stamps: p50 {:.3} ms, p99 {:.3} ms, at most {:.3} ms",
                1e3 * p50,
                1e3 * p99,
                1e3 * max
            )
            .expect("a String takes all");
        }
        if !self.bodies.is_empty() {
            writeln!(text, "{}", self.table()).expect("a String takes all");
            for body in self.bodies.values() {
                text.push_str(&self.warnings(body));
            }
        }
        text
    }

    /// Returns the median, the 99th percentile and the maximum of the delays in excess of the minimum, s; `None` without
    /// stamps.
    fn excess_delays(&self) -> Option<[f64; 3]> {
        let mut delays_ns = self.delays_ns.clone();
        delays_ns.sort_unstable();
        let (first_ns, last) = (*delays_ns.first()?, delays_ns.len() - 1);
        let indices = [last / 2, last - last / 100, last];
        Some(indices.map(|index| seconds(delays_ns[index].abs_diff(first_ns))))
    }

    /// Returns warnings about a body.
    fn warnings(&self, body: &Body) -> String {
        let label = if body.name == Name::EMPTY {
            format!("#{}", body.number)
        } else {
            body.name.to_string()
        };
        let mut text = String::new();
        if let Some(warning) = body.implausibility() {
            writeln!(text, "`{label}`: {warning}").expect("a String takes all");
        }
        if std::str::from_utf8(body.name.as_bytes()).is_err() {
            let fix = if self.has_ids {
                format!("choose it by `#{}`", body.number)
            } else {
                "rename it".to_owned()
            };
            writeln!(
                text,
                "`{label}` is not UTF-8 and cannot be written in a scenario: {fix}"
            )
            .expect("a String takes all");
        }
        text
    }

    fn table(&self) -> Table {
        let mut table = Table::new();
        table.load_style(presets::UTF8_HORIZONTAL_ONLY);
        table.set_header([
            "body",
            "number",
            "rate [Hz]",
            "tracked [%]",
            "position, capture frame [m]",
            "position σ [mm]",
            "attitude σ [mrad]",
        ]);
        for body in self.bodies.values() {
            #[expect(clippy::cast_precision_loss, reason = "an hour of frames is exact")]
            let (frames, tracked) = (body.frames as f64, body.tracked as f64);
            let position = body.position();
            let is_at_rest = body.deviation() <= AT_REST;
            let noise = if is_at_rest {
                format!("{:.3}", 1e3 * body.deviation())
            } else {
                "moves".to_owned()
            };
            let turned = if is_at_rest {
                format!("{:.2}", 1e3 * body.attitude_deviation())
            } else {
                String::new()
            };
            table.add_row([
                if body.name == Name::EMPTY {
                    "no name".to_owned()
                } else {
                    format!("`{}`", body.name)
                },
                body.number.to_string(),
                format!("{:.1}", frames / seconds(self.last_ns - self.first_ns).max(1e-9)),
                format!("{:.1}", 100.0 * tracked / frames),
                format!("{:.3} {:.3} {:.3}", position.x, position.y, position.z),
                noise,
                turned,
            ]);
        }
        table
    }
}

#[expect(clippy::cast_precision_loss, reason = "an hour in ns is exact")]
fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;
    use motion_capture::wire::{CapturePose, Stamp};
    use shared_types::noise::{Noise, Stream};
    use shared_types::rotation::exp;

    /// Returns the warnings about the bodies after a hundred frames with each at its position, with this noise.
    fn warnings(system: CaptureSystem, bodies: &[(&[u8], f64)], noise: f64) -> String {
        let mut received = ReceivedPackets::new(system);
        let mut frame = Frame::new();
        for number in 0..100_u32 {
            frame.clear();
            for (index, (name, x)) in (1..).zip(bodies) {
                // The first frames of Motive have no names yet.
                let is_named = number > 3 || system != CaptureSystem::Natnet;
                let name = if is_named { name } else { &b""[..] };
                let off = if number.is_multiple_of(2) { noise } else { -noise };
                frame
                    .push(WireBody {
                        name: Name::new(name).unwrap(),
                        number: index,
                        pose: Some(CapturePose::new([x + off, 0.0, 1.0], Matrix3::identity()).unwrap()),
                    })
                    .unwrap();
            }
            received.add(&frame, u64::from(number) * 10_000_000);
        }
        assert_eq!(received.bodies.len(), bodies.len(), "a row for each body");
        received
            .bodies
            .values()
            .map(|body| received.warnings(body))
            .collect()
    }

    #[test]
    fn the_noise_of_an_attitude_is_that_about_an_axis() {
        let (mut noise, deviation) = (Noise::new(1, Stream::CameraNoise), 2e-3);
        let at_rest = exp(&Vector3::new(0.3, -0.2, 1.0));
        let mut body = Body::new(1);
        for number in 0..4000 {
            let turned = at_rest * exp(&(noise.at(number).normal3() * deviation));
            body.add(&WireBody {
                name: Name::EMPTY,
                number: 1,
                pose: Some(CapturePose::new([0.0; 3], turned).unwrap()),
            });
        }
        let found = body.attitude_deviation();
        assert!((found / deviation - 1.0).abs() < 0.03, "{found}");
    }

    #[test]
    fn delays_are_in_excess_of_the_least_also_of_a_later_one() {
        let mut received = ReceivedPackets::new(CaptureSystem::Natnet);
        assert_eq!(received.excess_delays(), None);
        let mut frame = Frame::new();
        for (sent_ns, delay_ns) in [(0, 10_000_000), (20_000_000, 2_000_000), (40_000_000, 5_000_000)] {
            frame.stamp = Some(Stamp {
                exposed_ns: sent_ns,
                sent_ns,
            });
            received.add(&frame, sent_ns.unsigned_abs() + delay_ns);
        }
        assert_eq!(received.excess_delays(), Some([3e-3, 8e-3, 8e-3]));
    }

    #[test]
    fn a_body_that_is_as_it_should_be_has_no_line() {
        assert_eq!(warnings(CaptureSystem::Natnet, &[(b"quad", 1.0)], 1e-4), "");
    }

    #[test]
    fn units_that_cannot_be_right_are_named() {
        let far = warnings(CaptureSystem::Vrpn, &[(b"quad", 118.0)], 1e-4);
        assert!(
            far.starts_with("`quad`: 118 m from the origin: centimetres"),
            "{far}"
        );
        let metres = warnings(CaptureSystem::ViconUdp, &[(b"quad ", 1e-3)], 1e-7);
        assert!(metres.starts_with("`quad `: noise below 1 µm"), "{metres}");
    }

    #[test]
    fn a_name_that_is_not_utf_8_is_chosen_by_its_number_where_there_are_numbers() {
        let motive = warnings(
            CaptureSystem::Natnet,
            &[(b"quad", 1.0), (b"Drohne-\xc4rger", 1.0)],
            1e-4,
        );
        assert!(motive.ends_with("choose it by `#2`\n"), "{motive}");
        let vrpn = warnings(CaptureSystem::Vrpn, &[(b"Drohne-\xc4rger", 1.0)], 1e-4);
        assert!(vrpn.ends_with("rename it\n"), "{vrpn}");
    }
}
