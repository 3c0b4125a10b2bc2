//! State of the laboratory's devices: obstacles to arming, changes of cameras, receivers and radio link, and the vehicle's battery.

mod receivers;

use runtime::shared_page::ControlBlock;
use scenario::{
    CaptureSystem, LinkBattery, LowVoltageAction, MotionCapture, RadioProtocol, Receivers, Scenario,
    VoltageSource,
};
use shared_types::Schedule;
use shared_types::battery::BatteryReading;
use shared_types::receiver_figures::ReceiverFigures;
use shared_types::samples::RcFrame;
use shared_types::service::seconds;

use crate::battery;
use metrics::summary::laboratory::LaboratoryReport;
use run_client::Snapshot;
use run_client::snapshot::{BatterySnapshot, CamerasSnapshot, LinkSnapshot, ReceiversSnapshot};
use run_log::{CaptureFigures, LinkFigures};

/// Maximum age of the last pose or sample for arming, s.
const STALE: f64 = 0.5;

/// Messages when the link, the cameras and the receivers become ready.
const READY: [&str; 3] = [
    "the radio link is open",
    "the cameras see the vehicle",
    "the receivers measure the vehicle",
];

/// Time without a radio link after which a vehicle that has not taken off is killed, s.
const LONG_LOST: f64 = 0.5;

/// Number of checks of the battery, one a second, below its lowest voltage after which it is low: a manoeuvre is shorter.
const LOW_CHECKS: u32 = 3;

/// Time between two checks, s: an older voltage was counted by the one before.
const BETWEEN_CHECKS: f64 = 1.0;

/// State of a measured battery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BatteryState {
    /// It has a recent voltage above the lowest.
    Good,
    /// It has never sent a voltage.
    Unknown,
    /// Its last voltage is old.
    Old,
    /// It is below the lowest voltage; in flight for good.
    Low,
}

/// Devices of the laboratory in the scenario.
pub struct Laboratory<'a> {
    cameras: Option<(CaptureSystem, &'a MotionCapture)>,
    /// Receivers, with the scheduled rates of their topics, Hz.
    receivers: Option<(&'a Receivers, [f64; 4])>,
    link: Option<RadioProtocol>,
    /// `true` if link, cameras and receivers were ready at the last report.
    were_ready: [Option<bool>; 3],
    /// Time since the start of the flight since which the radio link is lost, ns.
    link_lost_since_ns: Option<u64>,
    /// The battery that the link measures, if the scenario states one.
    battery: Option<&'a LinkBattery>,
    battery_state: BatteryState,
    /// Consecutive checks below the lowest voltage.
    low_checks: u32,
    /// `true` if it was low once.
    was_low: bool,
}

impl<'a> Laboratory<'a> {
    /// Returns the devices of a scenario; none if the world is simulated.
    #[must_use]
    pub fn of(scenario: &'a Scenario, schedule: &Schedule) -> Self {
        let rate = |topic| 1.0 / seconds(schedule.time_ns(schedule.topic_rate(topic).period));
        Self {
            cameras: scenario.capture_system(),
            receivers: scenario
                .real_receivers()
                .map(|stated| (stated, ReceiverFigures::TOPICS.map(rate))),
            link: scenario.radio_link(),
            were_ready: [None; 3],
            link_lost_since_ns: None,
            battery: scenario
                .radio_link()
                .and(scenario.rc_output.as_ref())
                .and_then(|link| link.battery.as_ref())
                .filter(|battery| battery.source == VoltageSource::Measured),
            battery_state: BatteryState::Good,
            low_checks: 0,
            was_low: false,
        }
    }

    /// Checks the measured battery; called once a second. Returns a message when its state has changed. In flight a low battery
    /// is low for good: without load its voltage recovers.
    pub fn check_battery(&mut self, block: &ControlBlock, flies: bool) -> Option<String> {
        let stated = self.battery?;
        let reading = self.voltage(block);
        self.low_checks = match reading {
            // Counted before.
            Some(reading) if reading.age >= BETWEEN_CHECKS => self.low_checks,
            reading if is_below(stated, reading.as_ref()) => self.low_checks.saturating_add(1),
            _ => 0,
        };
        let stays_low = flies && self.battery_state == BatteryState::Low;
        let state = match reading {
            _ if stays_low || self.low_checks >= LOW_CHECKS => BatteryState::Low,
            None => BatteryState::Unknown,
            Some(reading) if reading.age > stated.max_age.min(BatteryReading::OLDEST - 0.1) => {
                BatteryState::Old
            }
            Some(_) => BatteryState::Good,
        };
        self.was_low |= state == BatteryState::Low;
        if std::mem::replace(&mut self.battery_state, state) == state {
            return None;
        }
        let text = self.battery_trouble(reading.as_ref());
        let good = || reading.map(|reading| format!("the battery has {:.2} V", reading.voltage));
        text.or_else(good)
    }

    /// Returns whether the measured battery is low and the vehicle must land for it.
    #[must_use]
    pub fn demands_landing(&self) -> bool {
        let is_stated = |battery: &LinkBattery| battery.below == LowVoltageAction::Land;
        self.battery_state == BatteryState::Low && self.battery.is_some_and(is_stated)
    }

    /// Returns the battery for clients: measured, or modelled as in the newest frame.
    #[must_use]
    pub fn battery(&self, block: &ControlBlock, frame: Option<&RcFrame>) -> Option<BatterySnapshot> {
        if let Some(modelled) = battery::modelled(frame) {
            return Some(modelled);
        }
        let reading = self.voltage(block)?;
        Some(BatterySnapshot {
            voltage: reading.voltage,
            age: Some(reading.age),
            factor: reading.factor,
            trouble: self.battery_trouble(Some(&reading)),
        })
    }

    /// Returns the newest voltage that the link has measured.
    fn voltage(&self, block: &ControlBlock) -> Option<BatteryReading> {
        self.link(block)?.battery()
    }

    /// Returns the warning of the measured battery in its present state, if there is one.
    fn battery_trouble(&self, reading: Option<&BatteryReading>) -> Option<String> {
        battery_trouble(self.battery?, self.battery_state, reading)
    }

    /// Returns the figures of the cameras, if there are any.
    #[must_use]
    pub fn capture(&self, block: &ControlBlock) -> Option<CaptureFigures> {
        let status = &block.cameras_status;
        self.cameras.map(|_| status.read())
    }

    /// Returns the figures of the receivers, if there are any.
    fn received(&self, block: &ControlBlock) -> Option<ReceiverFigures> {
        let status = &block.receivers_status;
        self.receivers.map(|_| status.read())
    }

    /// Returns the figures of the radio link, if there is one.
    #[must_use]
    pub fn link(&self, block: &ControlBlock) -> Option<LinkFigures> {
        let status = &block.link_status;
        self.link.map(|_| status.read())
    }

    /// Returns whether the radio link is lost now.
    #[must_use]
    pub fn is_link_lost(&self, block: &ControlBlock) -> bool {
        self.link(block)
            .is_some_and(|figures| figures.state == LinkFigures::STATE_LOST)
    }

    /// Returns whether the radio link is lost, if that has changed since the last call; time since the start of the flight in ns.
    pub fn link_change(&mut self, block: &ControlBlock, elapsed_ns: u64) -> Option<bool> {
        let is_lost = self.is_link_lost(block);
        let since_ns = is_lost.then(|| self.link_lost_since_ns.unwrap_or(elapsed_ns));
        let before = std::mem::replace(&mut self.link_lost_since_ns, since_ns);
        (before.is_some() != is_lost).then_some(is_lost)
    }

    /// Returns whether the radio link had been lost for long at the last [`link_change`](Self::link_change): longer than a process that is
    /// started again needs to open it.
    #[must_use]
    pub fn is_link_long_lost(&self, elapsed_ns: u64) -> bool {
        let lost_for = |since_ns: u64| seconds(elapsed_ns.saturating_sub(since_ns));
        self.link_lost_since_ns
            .is_some_and(|since_ns| lost_for(since_ns) >= LONG_LOST)
    }

    /// Returns a snapshot for clients with the state of link, cameras and receivers, at a time since the start of the flight.
    #[must_use]
    pub fn snapshot(&self, block: &ControlBlock, elapsed_ns: u64) -> Snapshot {
        let [link_trouble, cameras_trouble, receivers_trouble] = self.failures(block, elapsed_ns);
        let link = self.link(block).map(|figures| LinkSnapshot {
            trouble: link_trouble,
            sent: figures.sent,
            lost: figures.dropped + figures.left_out,
        });
        let cameras = self.capture(block).map(|figures| CamerasSnapshot {
            trouble: cameras_trouble,
            rate: figures.rate,
            latency: figures.latency,
            jitter: figures.jitter,
            frames: figures.frames,
            believed: figures.believed,
            refused: Some(figures.reason().into_owned()).filter(|reason| !reason.is_empty()),
        });
        let receivers = self.received(block).map(|figures| ReceiversSnapshot {
            trouble: receivers_trouble,
            rates: figures.rates,
            packets: figures.packets,
            refused: Some(figures.reason().into_owned()).filter(|reason| !reason.is_empty()),
        });
        Snapshot {
            radio_link: link,
            cameras,
            receivers,
            ..Snapshot::default()
        }
    }

    /// Returns the figures for the summary; `None` without a laboratory.
    #[must_use]
    pub fn report(&self, block: &ControlBlock) -> Option<LaboratoryReport> {
        let (capture, received) = (self.capture(block), self.received(block));
        let link = self.link(block);
        let mut report = LaboratoryReport::of(capture.as_ref(), received.as_ref(), link.as_ref())?;
        let battery = report.radio_link.as_mut().and_then(|link| link.battery.as_mut());
        if let Some(battery) = battery {
            battery.was_low = self.was_low;
        }
        Some(report)
    }

    /// Returns why the laboratory cannot fly at a time since the start of the flight, if so: a low battery, or a failure of the
    /// radio link, of the cameras or of the receivers. Of cameras and receivers together one measures the position.
    #[must_use]
    pub fn failure(&self, block: &ControlBlock, elapsed_ns: u64) -> Option<String> {
        let voltage = self.voltage(block);
        if let Some(stated) = self.battery
            && (self.battery_state == BatteryState::Low || is_below(stated, voltage.as_ref()))
        {
            return battery_trouble(stated, BatteryState::Low, voltage.as_ref());
        }
        let [link, cameras, receivers] = self.failures(block, elapsed_ns);
        if self.cameras.is_none() || self.receivers.is_none() {
            return link.or(cameras).or(receivers);
        }
        link.or_else(|| self.receiver_failure(block, elapsed_ns, false))
            .or_else(|| {
                let (cameras, receivers) = cameras.zip(receivers)?;
                Some(format!(
                    "neither poses nor fixes measure the position: {cameras}; {receivers}"
                ))
            })
    }

    /// Returns the changes since the last call, as sentences.
    pub fn news(&mut self, block: &ControlBlock, elapsed_ns: u64) -> Vec<String> {
        let is_there = [
            self.link.is_some(),
            self.cameras.is_some(),
            self.receivers.is_some(),
        ];
        let failures = self.failures(block, elapsed_ns).into_iter();
        let mut news = Vec::new();
        for (place, trouble) in failures.enumerate().filter(|(place, _)| is_there[*place]) {
            let is_ready = Some(trouble.is_none());
            if std::mem::replace(&mut self.were_ready[place], is_ready) != is_ready {
                news.push(trouble.unwrap_or_else(|| READY[place].to_owned()));
            }
        }
        news
    }

    /// Returns the failures of the link, of the cameras and of the receivers.
    fn failures(&self, block: &ControlBlock, elapsed_ns: u64) -> [Option<String>; 3] {
        let link = self.link.zip(self.link(block));
        let cameras = self.cameras.zip(self.capture(block));
        [
            link.and_then(|(link, figures)| link_failure(link, &figures)),
            cameras
                .and_then(|((system, stated), figures)| camera_failure(system, stated, &figures, elapsed_ns)),
            self.receiver_failure(block, elapsed_ns, true),
        ]
    }

    /// Returns the failure of the receivers, of which fixes are needed or not.
    fn receiver_failure(&self, block: &ControlBlock, elapsed_ns: u64, needs_fixes: bool) -> Option<String> {
        let ((stated, scheduled), figures) = self.receivers.zip(self.received(block))?;
        receivers::failure(stated, &scheduled, &figures, elapsed_ns, needs_fixes)
    }
}

/// Returns why no frame can be sent, if so.
fn link_failure(link: RadioProtocol, figures: &LinkFigures) -> Option<String> {
    let name = link.name();
    match figures.state {
        LinkFigures::STATE_OPEN => None,
        LinkFigures::STATE_LOST => Some(format!(
            "the radio link `{name}` is lost: its device or peer is gone, or takes no frames; it is tried again in the background"
        )),
        _ => Some(format!("the radio link `{name}` has not been opened yet")),
    }
}

/// Returns whether a recent voltage is below the lowest one. In flight one alone may be that of a manoeuvre; on the ground it is not.
fn is_below(stated: &LinkBattery, reading: Option<&BatteryReading>) -> bool {
    stated
        .lowest
        .zip(reading)
        .is_some_and(|(lowest, reading)| reading.voltage < lowest && reading.age <= stated.max_age)
}

/// Returns the warning of a measured battery, if there is one.
fn battery_trouble(
    stated: &LinkBattery,
    state: BatteryState,
    reading: Option<&BatteryReading>,
) -> Option<String> {
    let corrects = stated.calibrated.is_some();
    match (state, reading) {
        (BatteryState::Good, _) => None,
        (BatteryState::Low, reading) => {
            let now = reading.map_or(String::new(), |reading| format!(", {:.2} V", reading.voltage));
            let lowest = stated.lowest.unwrap_or_default();
            Some(format!(
                "the battery is low{now}: below `rc_output.battery.lowest` = {lowest:?}"
            ))
        }
        (BatteryState::Old, Some(reading)) => {
            let thrust = if corrects {
                "; the thrust keeps its correction"
            } else {
                ""
            };
            Some(format!(
                "the vehicle has sent no voltage of its battery for {:.0} s{thrust}",
                reading.age
            ))
        }
        (BatteryState::Unknown | BatteryState::Old, _) => {
            let thrust = if corrects {
                "; the thrust is not corrected"
            } else {
                ""
            };
            Some(format!(
                "the vehicle has sent no voltage of its battery yet{thrust}"
            ))
        }
    }
}

/// Returns why the poses of the cameras are not trusted, if so.
fn camera_failure(
    system: CaptureSystem,
    stated: &MotionCapture,
    figures: &CaptureFigures,
    elapsed_ns: u64,
) -> Option<String> {
    let (name, server, object) = (system.name(), &stated.server, &stated.object);
    let age = seconds(elapsed_ns.saturating_sub(figures.believed_at_ns));
    let [least, most] = stated.rate;
    let found = [figures.reason().into_owned(), figures.drops_in_words()];
    let found: Vec<_> = found.into_iter().filter(|words| !words.is_empty()).collect();
    let because = if found.is_empty() {
        String::new()
    } else {
        format!("; so far {}", found.join("; "))
    };
    match figures.health {
        CaptureFigures::HEALTH_UNKNOWN | CaptureFigures::HEALTH_SILENT if figures.malformed > 0 => {
            Some(format!(
                "packets come from the `{name}` server {server}, and no frame of them can be read{because}"
            ))
        }
        CaptureFigures::HEALTH_UNKNOWN | CaptureFigures::HEALTH_SILENT => Some(format!(
            "nothing has come from the `{name}` server {server} yet; `gerono mocap probe` shows what comes"
        )),
        CaptureFigures::HEALTH_ABSENT => Some(format!(
            "`{name}` frames come from {server}, but none has seen a body `{object}` yet{because}"
        )),
        CaptureFigures::HEALTH_SETTLING => Some(format!(
            "poses of `{object}` come, but are not accepted yet{because}"
        )),
        _ if age > STALE => Some(format!(
            "the last pose of `{object}` that can be believed is {age:.1} s old{because}"
        )),
        CaptureFigures::HEALTH_DOUBTFUL => Some(format!(
            "the last frame has no pose of `{object}` that can be believed{because}"
        )),
        _ if figures.rate == 0.0 => {
            Some("frames come, and their rate is known after a second of them: wait".to_owned())
        }
        _ if !(least..=most).contains(&figures.rate) => Some(format!(
            "{:.1} frames come a second, and `motion_capture.rate` states {least} to {most}: set the system to that rate, or state its \
             own; `gerono mocap probe` shows whether the network loses frames",
            figures.rate
        )),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;
    use zerocopy::FromZeros;

    const NOW_NS: u64 = 10_000_000_000;

    fn good() -> CaptureFigures {
        CaptureFigures {
            health: CaptureFigures::HEALTH_GOOD,
            believed_at_ns: NOW_NS - 10_000_000,
            rate: 100.0,
            ..CaptureFigures::new_zeroed()
        }
    }

    fn stated() -> MotionCapture {
        MotionCapture::new(CaptureSystem::Vrpn, Ipv4Addr::LOCALHOST, "quad")
    }

    fn laboratory(stated: &MotionCapture) -> Laboratory<'_> {
        Laboratory {
            cameras: Some((CaptureSystem::Vrpn, stated)),
            receivers: None,
            link: Some(RadioProtocol::Crsf),
            were_ready: [None; 3],
            link_lost_since_ns: None,
            battery: None,
            battery_state: BatteryState::Good,
            low_checks: 0,
            was_low: false,
        }
    }

    /// Returns a control block with these cameras and a link in this state.
    fn told(figures: &CaptureFigures, state: u32) -> ControlBlock {
        let block = ControlBlock::default();
        block.cameras_status.write(figures);
        let link = LinkFigures {
            state,
            ..LinkFigures::new_zeroed()
        };
        block.link_status.write(&link);
        block
    }

    /// Returns the reason for which arming is refused with them.
    fn refusal(figures: &CaptureFigures, state: u32) -> Option<String> {
        laboratory(&stated()).failure(&told(figures, state), NOW_NS)
    }

    #[test]
    fn what_changes_is_told_once() {
        let stated = stated();
        let mut laboratory = laboratory(&stated);
        let mut news = |state| laboratory.news(&told(&good(), state), NOW_NS);
        assert_eq!(news(LinkFigures::STATE_OPEN), READY[..2]);
        assert_eq!(news(LinkFigures::STATE_OPEN), [""; 0]);
        let lost = news(LinkFigures::STATE_LOST);
        assert!(lost.len() == 1 && lost[0].contains("`crsf` is lost"), "{lost:?}");
        assert_eq!(news(LinkFigures::STATE_OPEN), READY[..1]);
    }

    #[test]
    fn a_snapshot_has_the_state_of_all_devices() {
        let stated = stated();
        let block = told(&good(), LinkFigures::STATE_LOST);
        let shown = laboratory(&stated).snapshot(&block, NOW_NS);
        assert!(
            shown
                .radio_link
                .unwrap()
                .trouble
                .unwrap()
                .contains("`crsf` is lost")
        );
        let cameras = shown.cameras.unwrap();
        assert_eq!((cameras.trouble, cameras.rate), (None, 100.0));
        let nothing = Laboratory {
            cameras: None,
            receivers: None,
            link: None,
            were_ready: [None; 3],
            link_lost_since_ns: None,
            battery: None,
            battery_state: BatteryState::Good,
            low_checks: 0,
            was_low: false,
        };
        assert_eq!(nothing.snapshot(&block, NOW_NS), Snapshot::default());

        let receivers = Receivers {
            sources: vec!["udp:0.0.0.0:14550".to_owned()],
            ..Receivers::default()
        };
        let outdoors = Laboratory {
            receivers: Some((&receivers, [250.0, 10.0, 25.0, 50.0])),
            ..nothing
        };
        let figures = ReceiverFigures {
            rates: [249.6, 4.9, 25.0, 50.0],
            arrived_ns: [NOW_NS; 4],
            samples: [9; 4],
            packets: 36,
            open: 1,
            ..ReceiverFigures::new_zeroed()
        };
        block.receivers_status.write(&figures);
        let shown = outdoors.snapshot(&block, NOW_NS).receivers.unwrap();
        assert_eq!((shown.rates, shown.packets), (figures.rates, 36));
        assert!(
            shown
                .trouble
                .unwrap()
                .contains("4.9 samples for `gnss/fix` come a second")
        );
    }

    #[test]
    fn with_cameras_that_are_believed_and_a_link_that_is_open_everybody_may_arm() {
        assert_eq!(refusal(&good(), LinkFigures::STATE_OPEN), None);
    }

    /// In flight three checks have to find it, for a manoeuvre lowers the voltage; `gerono arm` may come before the first.
    #[test]
    fn a_battery_that_is_low_when_it_is_first_read_is_not_armed() {
        let (stated, battery) = (
            stated(),
            LinkBattery {
                lowest: Some(3.2),
                ..LinkBattery::default()
            },
        );
        let laboratory = Laboratory {
            battery: Some(&battery),
            ..laboratory(&stated)
        };
        for (voltage, is_low) in [(3.1, true), (3.7, false)] {
            let block = measured(voltage, 0.1);
            block.cameras_status.write(&good());
            let refusal = laboratory.failure(&block, NOW_NS);
            assert_eq!(
                refusal
                    .as_ref()
                    .is_some_and(|reason| reason.contains("the battery is low")),
                is_low,
                "{refusal:?}"
            );
        }
    }

    /// Each loss and each return is an event of the log, which says that no command reached the vehicle.
    #[test]
    fn a_link_that_is_lost_is_an_event_once() {
        let stated = stated();
        let mut laboratory = laboratory(&stated);
        let states = [
            LinkFigures::STATE_UNKNOWN,
            LinkFigures::STATE_OPEN,
            LinkFigures::STATE_LOST,
            LinkFigures::STATE_LOST,
            LinkFigures::STATE_OPEN,
        ];
        let mut elapsed_ns = 0;
        let changes = states.map(|state| {
            elapsed_ns += 400_000_000;
            let change = laboratory.link_change(&told(&good(), state), elapsed_ns);
            (change, laboratory.is_link_long_lost(elapsed_ns + 100_000_000))
        });
        let expected = [None, None, Some(true), None, Some(false)]
            .into_iter()
            .zip([false, false, false, true, false]);
        assert!(changes.into_iter().eq(expected), "{changes:?}");
    }

    #[test]
    fn each_reason_not_to_arm_is_named() {
        let with = |spoil: &dyn Fn(&mut CaptureFigures)| {
            let mut figures = good();
            spoil(&mut figures);
            refusal(&figures, LinkFigures::STATE_OPEN).unwrap()
        };
        for (health, piece) in [
            (CaptureFigures::HEALTH_UNKNOWN, "nothing has come"),
            (CaptureFigures::HEALTH_SILENT, "nothing has come"),
            (CaptureFigures::HEALTH_ABSENT, "none has seen a body `quad`"),
            (CaptureFigures::HEALTH_SETTLING, "not accepted yet"),
            (CaptureFigures::HEALTH_DOUBTFUL, "the last frame has no pose"),
        ] {
            let reason = with(&|figures| figures.health = health);
            assert!(reason.contains(piece), "{reason}");
        }
        let old = with(&|figures| figures.believed_at_ns = NOW_NS - 2_000_000_000);
        assert!(old.contains("is 2.0 s old"), "{old}");
        let words = "packets refused: 9 times Motive sends NatNet 2.8; 3.x and 4.x are supported";
        let refused = with(&|figures| {
            figures.health = CaptureFigures::HEALTH_SILENT;
            figures.malformed = 9;
            figures.reason[..words.len()].copy_from_slice(words.as_bytes());
            figures.reason_length = words.len() as u32;
        });
        assert!(
            refused.starts_with("packets come") && refused.ends_with(words),
            "{refused}"
        );
        let still = with(&|figures| {
            figures.health = CaptureFigures::HEALTH_SETTLING;
            (figures.frozen, figures.jumped) = (1671, 2);
        });
        assert!(
            still.ends_with("not accepted yet; so far frozen 1671, jumped 2"),
            "{still}"
        );
        let slow = with(&|figures| figures.rate = 20.0);
        assert!(slow.contains("20.0 frames come a second"), "{slow}");
        for (state, piece) in [
            (LinkFigures::STATE_LOST, "is lost"),
            (LinkFigures::STATE_UNKNOWN, "not been opened"),
        ] {
            assert!(refusal(&good(), state).unwrap().contains(piece));
        }
    }

    /// Returns figures of receivers that measure at these rates of inertial samples and fixes, Hz.
    fn received(inertial: f64, fixes: f64) -> ReceiverFigures {
        let rates = [inertial, fixes, 25.0, 50.0];
        ReceiverFigures {
            rates,
            arrived_ns: [NOW_NS; 4],
            samples: rates.map(|rate| u64::from(rate > 0.0)),
            packets: 36,
            open: 1,
            ..ReceiverFigures::new_zeroed()
        }
    }

    #[test]
    fn of_cameras_and_receivers_one_measures_the_position() {
        let (stated, receivers) = (
            stated(),
            Receivers {
                sources: vec!["udp:0.0.0.0:14550".to_owned()],
                ..Receivers::default()
            },
        );
        let mut laboratory = laboratory(&stated);
        laboratory.receivers = Some((&receivers, [250.0, 10.0, 25.0, 50.0]));
        let (silent, good) = (CaptureFigures::new_zeroed(), good());
        for (capture, receiver, words) in [
            (good, received(250.0, 10.0), ""),
            (good, received(250.0, 0.0), ""),
            (silent, received(250.0, 10.0), ""),
            (
                silent,
                received(250.0, 0.0),
                "neither poses nor fixes measure the position: nothing has come from the `vrpn`",
            ),
            (
                silent,
                received(250.0, 0.0),
                "; no sample for `gnss/fix` has come",
            ),
            (good, received(0.0, 10.0), "no sample for `imu/sample` has come"),
        ] {
            let block = told(&capture, LinkFigures::STATE_OPEN);
            block.receivers_status.write(&receiver);
            let failure = laboratory.failure(&block, NOW_NS).unwrap_or_default();
            assert!(
                failure.contains(words) && failure.is_empty() == words.is_empty(),
                "{failure}"
            );
            // Each is shown as it is.
            let shown = laboratory.snapshot(&block, NOW_NS);
            let troubles = [shown.cameras.unwrap().trouble, shown.receivers.unwrap().trouble];
            let is_wrong = [
                capture.health != good.health,
                receiver.rates != [250.0, 10.0, 25.0, 50.0],
            ];
            assert_eq!(troubles.map(|trouble| trouble.is_some()), is_wrong);
        }
        let block = told(&good, LinkFigures::STATE_LOST);
        block.receivers_status.write(&received(250.0, 10.0));
        assert!(
            laboratory
                .failure(&block, NOW_NS)
                .is_some_and(|failure| failure.contains("`crsf` is lost"))
        );
    }

    /// Returns a control block of a link that has measured a voltage, V, this long ago, s.
    fn measured(voltage: f64, age: f64) -> ControlBlock {
        let block = ControlBlock::default();
        let reading = BatteryReading {
            voltage,
            age,
            factor: None,
        };
        let link = LinkFigures {
            state: LinkFigures::STATE_OPEN,
            pad0: reading.to_word(),
            ..LinkFigures::new_zeroed()
        };
        block.link_status.write(&link);
        block
    }

    #[test]
    fn a_battery_is_told_when_it_is_unknown_found_old_and_low_for_longer_than_a_manoeuvre() {
        let (stated, battery) = (
            stated(),
            LinkBattery {
                calibrated: Some(7.6),
                lowest: Some(7.0),
                ..LinkBattery::default()
            },
        );
        let mut laboratory = Laboratory {
            battery: Some(&battery),
            ..laboratory(&stated)
        };
        let mut look = |block: &ControlBlock| laboratory.check_battery(block, true).unwrap_or_default();
        let unknown = look(&ControlBlock::default());
        assert!(unknown.ends_with("yet; the thrust is not corrected"), "{unknown}");
        assert_eq!(look(&ControlBlock::default()), "");
        assert_eq!(look(&measured(7.81, 0.2)), "the battery has 7.81 V");
        let old = look(&measured(7.81, 9.0));
        assert!(old.ends_with("for 9 s; the thrust keeps its correction"), "{old}");
        assert_eq!(look(&measured(7.41, 0.1)), "the battery has 7.41 V");
        // A sag of two seconds, and then one whose last voltage is looked at again and again.
        for (voltage, age) in [
            (6.9, 0.1),
            (6.9, 0.1),
            (7.3, 0.1),
            (6.9, 0.1),
            (6.9, 0.1),
            (6.9, 1.1),
            (6.9, 2.1),
        ] {
            assert_eq!(look(&measured(voltage, age)), "");
        }
        let low = look(&measured(6.9, 0.1));
        assert_eq!(
            low,
            "the battery is low, 6.90 V: below `rc_output.battery.lowest` = 7.0"
        );
        assert_eq!(
            look(&measured(7.3, 0.1)),
            "",
            "without load it recovers, and stays low"
        );
        let block = measured(7.3, 0.1);
        let shown = laboratory.battery(&block, None).unwrap();
        assert!(shown.voltage == 7.3 && shown.trouble.unwrap().contains("is low"));
        let refusal = laboratory.failure(&block, 0);
        assert!(refusal.is_some_and(|reason| reason.contains("is low")));
        // On the ground another battery may be put in.
        assert_eq!(
            laboratory.check_battery(&block, false).unwrap(),
            "the battery has 7.30 V"
        );
    }

    #[test]
    fn a_modelled_battery_is_that_of_the_newest_frame() {
        let stated = stated();
        let mut frame = RcFrame::new_zeroed();
        let block = ControlBlock::default();
        let laboratory = laboratory(&stated);
        assert_eq!(laboratory.battery(&block, Some(&frame)), None);
        frame.set_battery(7.4, Some(1.25));
        let shown = laboratory.battery(&block, Some(&frame)).unwrap();
        assert_eq!(
            (shown.voltage, shown.age, shown.factor, shown.trouble),
            (7.4, None, Some(1.25), None)
        );
        frame.limit = RcFrame::LIMIT_BATTERY;
        assert!(
            laboratory
                .battery(&block, Some(&frame))
                .unwrap()
                .trouble
                .is_some()
        );
    }
}
