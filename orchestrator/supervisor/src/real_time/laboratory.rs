//! State of the laboratory's devices: obstacles to arming, and changes of cameras and radio link.

use runtime::shared_page::ControlBlock;
use scenario::{CaptureSystem, MotionCapture, RadioProtocol, Scenario};
use shared_types::ServiceId;
use shared_types::service::seconds;

use metrics::summary::laboratory::LaboratoryReport;
use run_client::snapshot::{CamerasSnapshot, LinkSnapshot};
use run_log::{CaptureFigures, LinkFigures};

/// Maximum age of the last pose for arming, s.
const STALE: f64 = 0.5;

/// Messages when the link and the cameras become ready.
const READY: [&str; 2] = ["the radio link is open", "the cameras see the vehicle"];

/// Devices of the laboratory in the scenario.
pub struct Laboratory<'a> {
    cameras: Option<(CaptureSystem, &'a MotionCapture)>,
    link: Option<RadioProtocol>,
    /// `true` if link and cameras were ready at the last report.
    were_ready: [Option<bool>; 2],
}

impl<'a> Laboratory<'a> {
    /// Returns the devices of a scenario; none if the world is simulated.
    #[must_use]
    pub fn of(scenario: &'a Scenario) -> Self {
        Self {
            cameras: scenario.capture_system(),
            link: scenario.radio_link(),
            were_ready: [None; 2],
        }
    }

    /// Returns the figures of the cameras, if there are any.
    #[must_use]
    pub fn capture(&self, block: &ControlBlock) -> Option<CaptureFigures> {
        let status = &block.hardware_status[ServiceId::Plant.index()];
        self.cameras.map(|_| status.read())
    }

    /// Returns the figures of the radio link, if there is one.
    #[must_use]
    pub fn link(&self, block: &ControlBlock) -> Option<LinkFigures> {
        let status = &block.hardware_status[ServiceId::RcOutput.index()];
        self.link.map(|_| status.read())
    }

    /// Returns the state of link and cameras for clients, at a time since the start of the flight.
    #[must_use]
    pub fn snapshot(
        &self,
        block: &ControlBlock,
        elapsed_ns: u64,
    ) -> (Option<LinkSnapshot>, Option<CamerasSnapshot>) {
        let [link_trouble, cameras_trouble] = self.failures(block, elapsed_ns);
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
        (link, cameras)
    }

    /// Returns the figures for the summary; `None` without a laboratory.
    #[must_use]
    pub fn report(&self, block: &ControlBlock) -> Option<LaboratoryReport> {
        LaboratoryReport::of(self.capture(block).as_ref(), self.link(block).as_ref())
    }

    /// Returns the failure of the radio link or of the cameras at a time since the start of the flight, if there is one.
    #[must_use]
    pub fn failure(&self, block: &ControlBlock, elapsed_ns: u64) -> Option<String> {
        self.failures(block, elapsed_ns).into_iter().flatten().next()
    }

    /// Returns the changes since the last call, as sentences.
    pub fn news(&mut self, block: &ControlBlock, elapsed_ns: u64) -> Vec<String> {
        let is_there = [self.link.is_some(), self.cameras.is_some()];
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

    /// Returns the failures of the link and of the cameras.
    fn failures(&self, block: &ControlBlock, elapsed_ns: u64) -> [Option<String>; 2] {
        let link = self.link.zip(self.link(block));
        let cameras = self.cameras.zip(self.capture(block));
        [
            link.and_then(|(link, figures)| link_failure(link, &figures)),
            cameras
                .and_then(|((system, stated), figures)| camera_failure(system, stated, &figures, elapsed_ns)),
        ]
    }
}

/// Returns why no frame can be sent, if so.
fn link_failure(link: RadioProtocol, figures: &LinkFigures) -> Option<String> {
    let name = link.name();
    match figures.state {
        LinkFigures::STATE_OPEN => None,
        LinkFigures::STATE_LOST => Some(format!(
            "the radio link `{name}` is lost: its device or peer is gone; it reconnects in the background"
        )),
        _ => Some(format!("the radio link `{name}` has not been opened yet")),
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
        _ if figures.rate == 0.0 => Some("the rate of frames has not been measured yet".to_owned()),
        _ if !(least..=most).contains(&figures.rate) => Some(format!(
            "{:.1} frames come a second, and `motion_capture.rate` states {least} to {most}",
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
            link: Some(RadioProtocol::Crsf),
            were_ready: [None; 2],
        }
    }

    /// Returns a control block with these cameras and a link in this state.
    fn told(figures: &CaptureFigures, state: u32) -> ControlBlock {
        let block = ControlBlock::default();
        block.hardware_status[ServiceId::Plant.index()].write(figures);
        let link = LinkFigures {
            state,
            ..LinkFigures::new_zeroed()
        };
        block.hardware_status[ServiceId::RcOutput.index()].write(&link);
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
        assert_eq!(news(LinkFigures::STATE_OPEN), READY);
        assert_eq!(news(LinkFigures::STATE_OPEN), [""; 0]);
        let lost = news(LinkFigures::STATE_LOST);
        assert!(lost.len() == 1 && lost[0].contains("`crsf` is lost"), "{lost:?}");
        assert_eq!(news(LinkFigures::STATE_OPEN), READY[..1]);
    }

    #[test]
    fn who_looks_sees_how_both_are() {
        let stated = stated();
        let block = told(&good(), LinkFigures::STATE_LOST);
        let (link, cameras) = laboratory(&stated).snapshot(&block, NOW_NS);
        assert!(link.unwrap().trouble.unwrap().contains("`crsf` is lost"));
        let cameras = cameras.unwrap();
        assert_eq!((cameras.trouble, cameras.rate), (None, 100.0));
        let nothing = Laboratory {
            cameras: None,
            link: None,
            were_ready: [None; 2],
        };
        assert_eq!(nothing.snapshot(&block, NOW_NS), (None, None));
    }

    #[test]
    fn with_cameras_that_are_believed_and_a_link_that_is_open_everybody_may_arm() {
        assert_eq!(refusal(&good(), LinkFigures::STATE_OPEN), None);
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
}
