//! Radio link: sticks in, frames out, with failsafe.

use std::convert::Infallible;

use scenario::RcLink;
use shared_types::battery::BatteryReading;
use shared_types::service::nanoseconds;

use crate::battery::BatteryMonitor;
use crate::encoder::Encoder;
use crate::frame::Frame;
use crate::port::{OpenError, Port, Sent, Target};
use crate::sticks::Sticks;
use crate::telemetry::Telemetry;

/// Maximum number of reads with a frame: an autopilot sends some packets for each of ours.
const READS: usize = 16;

/// Radio link of a laboratory.
#[derive(Debug)]
pub struct RadioLink {
    encoder: Encoder,
    port: Port,
    frame: Frame,
    loss: Loss,
    /// `true` if the process replaces a dead one, whose last frame stays in effect at the receiver until a newer one.
    is_replacement: bool,
    /// Frames withheld to trigger the receiver's failsafe.
    silent: u64,
    /// Buffer for responses.
    responses: [u8; 512],
    telemetry: Telemetry,
    battery: BatteryMonitor,
}

/// Timer of a lost command.
#[derive(Clone, Copy, Debug)]
struct Loss {
    silence_after_ns: u64,
    since_ns: Option<u64>,
}

/// Sticks to send, and whether to use the link's failsafe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct LinkAssessment {
    sticks: Sticks,
    /// `true` to use the link's own failsafe as well.
    link_failsafe: bool,
}

impl Loss {
    /// Assesses the newest sticks. Lost sticks and stale sticks stop the motors. The link's failsafe is used after
    /// `silence_after` of lost sticks, and immediately with stale sticks: the transmitter no longer runs its own failsafe.
    #[inline]
    fn assess(&mut self, newest: Option<(Sticks, u64)>, now_ns: u64) -> LinkAssessment {
        let Some((sticks, written_at_ns)) = newest else {
            return LinkAssessment {
                sticks: Sticks::MOTORS_OFF,
                link_failsafe: false,
            };
        };
        if now_ns.saturating_sub(written_at_ns) > self.silence_after_ns {
            self.since_ns.get_or_insert(written_at_ns);
            return LinkAssessment {
                sticks: Sticks {
                    is_lost: true,
                    is_killed: sticks.is_killed,
                    rests: sticks.rests,
                    ..Sticks::MOTORS_OFF
                },
                link_failsafe: true,
            };
        }
        if !sticks.is_lost {
            self.since_ns = None;
        }
        let since = sticks.is_lost.then(|| *self.since_ns.get_or_insert(now_ns));
        LinkAssessment {
            sticks,
            link_failsafe: since.is_some_and(|since| now_ns.saturating_sub(since) >= self.silence_after_ns),
        }
    }
}

impl RadioLink {
    /// Opens the link of a checked scenario; `None` for the simulated link.
    ///
    /// # Errors
    /// [`OpenError`], with the fix.
    pub fn open(link: &RcLink) -> Result<Option<Self>, OpenError> {
        Self::with_port(link, false, Port::open)
    }

    /// Opens the link of a process that replaces a dead one in flight. If it cannot be opened now, this counts as any other
    /// loss. It sends nothing before the first sticks: a frame that stops the motors would disarm a vehicle in the air, and
    /// many flight controllers cannot be rearmed there.
    #[must_use]
    pub fn reopen(link: &RcLink) -> Option<Self> {
        let Ok(link) = Self::with_port(link, true, |target| Ok::<_, Infallible>(Port::lost(target)));
        link
    }

    fn with_port<E>(
        link: &RcLink,
        is_replacement: bool,
        port: impl FnOnce(Target) -> Result<Port, E>,
    ) -> Result<Option<Self>, E> {
        let Some(transmitter) = &link.transmitter else {
            return Ok(None);
        };
        let encoder = Encoder::new(link, transmitter);
        let Some((encoder, target)) = encoder.zip(Target::new(link.link, transmitter)) else {
            return Ok(None);
        };
        Ok(Some(Self {
            encoder,
            port: port(target)?,
            frame: Frame::default(),
            loss: Loss {
                silence_after_ns: nanoseconds(transmitter.silence_after),
                since_ns: None,
            },
            is_replacement,
            silent: 0,
            responses: [0; 512],
            telemetry: Telemetry::default(),
            battery: BatteryMonitor::new(link),
        }))
    }

    /// Sends the frame of the newest sticks, given with their time; times are those of `CLOCK_MONOTONIC`. Returns `None` if
    /// the frame was withheld: to trigger the receiver's failsafe, or because a replacement has no sticks yet.
    #[inline]
    pub fn transmit(&mut self, newest: Option<(Sticks, u64)>, now_ns: u64) -> Option<Sent> {
        if newest.is_none() && self.is_replacement {
            return None;
        }
        let sent = self.transmit_frame(newest, now_ns);
        // After the frame, which may stop the motors.
        self.read_telemetry(now_ns);
        sent
    }

    #[inline]
    fn transmit_frame(&mut self, newest: Option<(Sticks, u64)>, now_ns: u64) -> Option<Sent> {
        let mut assessment = self.loss.assess(newest, now_ns);
        if assessment.link_failsafe && !self.encoder.has_failsafe_flag() {
            self.silent += 1;
            return None;
        }
        self.battery.correct(&mut assessment.sticks);
        self.encoder.encode(
            &assessment.sticks,
            assessment.link_failsafe,
            now_ns,
            &mut self.frame,
        );
        let sent = self.port.send(self.frame.bytes(), now_ns);
        self.send_request(&assessment.sticks, now_ns);
        Some(sent)
    }

    /// Reads what the vehicle has sent back.
    fn read_telemetry(&mut self, now_ns: u64) {
        for _ in 0..READS {
            let count = self.port.receive(&mut self.responses, now_ns);
            if count == 0 {
                return;
            }
            let bytes = &self.responses[..count];
            if let Some(voltage) = self.telemetry.push(self.encoder.format(), bytes) {
                self.battery.add(voltage, now_ns);
            }
        }
    }

    /// Sends the format's request that is due beside a frame, if any: to the vehicle first, then for its battery's voltage.
    fn send_request(&mut self, sticks: &Sticks, now_ns: u64) {
        let frame_length = self.frame.bytes().len();
        self.encoder.request(sticks, &mut self.frame);
        if self.frame.bytes().is_empty() && self.battery.asks() {
            self.encoder
                .format()
                .request_voltage(now_ns, sticks.codes.is_none(), &mut self.frame);
        }
        if !self.frame.bytes().is_empty() {
            self.port.request(self.frame.bytes(), frame_length);
        }
    }

    /// Continues with the last voltage that a dead process has read.
    pub fn continue_from(&mut self, reading: &BatteryReading, now_ns: u64) {
        self.battery.continue_from(reading, now_ns);
    }

    /// Returns the newest voltage of the vehicle's battery, if there has been one.
    #[must_use]
    pub fn battery(&self, now_ns: u64) -> Option<BatteryReading> {
        self.battery.reading(now_ns)
    }

    /// Returns the encoder.
    #[must_use]
    pub fn encoder(&self) -> &Encoder {
        &self.encoder
    }

    /// Returns the port.
    #[must_use]
    pub fn port(&self) -> &Port {
        &self.port
    }

    /// Returns the number of frames withheld to trigger the receiver's failsafe.
    #[must_use]
    pub fn silent(&self) -> u64 {
        self.silent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::{RadioProtocol, Transmitter};

    const MS: u64 = 1_000_000;

    fn loss() -> Loss {
        Loss {
            silence_after_ns: 500 * MS,
            since_ns: None,
        }
    }

    const FLYING: Sticks = Sticks::flying([1000; 4]);
    const LOST: Sticks = Sticks {
        is_lost: true,
        rests: false,
        ..Sticks::MOTORS_OFF
    };

    #[test]
    fn before_the_first_sticks_frames_keep_the_motors_off() {
        let assessment = loss().assess(None, 10_000 * MS);
        assert_eq!(
            (assessment.sticks, assessment.link_failsafe),
            (Sticks::MOTORS_OFF, false)
        );
    }

    #[test]
    fn a_disarmed_link_stays_so_without_the_links_failsafe() {
        let mut loss = loss();
        for now_ns in (0..10_000).map(|ms| ms * MS) {
            assert!(
                !loss
                    .assess(Some((Sticks::MOTORS_OFF, now_ns)), now_ns)
                    .link_failsafe
            );
        }
    }

    #[test]
    fn a_lost_command_uses_the_links_failsafe_after_the_stated_time_and_until_it_is_back() {
        let mut loss = loss();
        let mut own = |sticks, ms: u64| loss.assess(Some((sticks, ms * MS)), ms * MS).link_failsafe;
        assert!(!own(FLYING, 0));
        assert!(!own(LOST, 10));
        assert!(!own(LOST, 509));
        assert!(own(LOST, 510));
        assert!(!own(FLYING, 520));
        assert!(!own(LOST, 530), "a new loss starts its time again");
    }

    #[test]
    fn sticks_without_renewal_are_not_sent_for_ever() {
        let mut loss = loss();
        let mut assess = |ms: u64| loss.assess(Some((FLYING, 0)), ms * MS);
        assert_eq!(assess(500).sticks, FLYING);
        let assessment = assess(501);
        assert_eq!((assessment.sticks, assessment.link_failsafe), (LOST, true));
        let killed = Sticks {
            is_killed: true,
            ..Sticks::MOTORS_OFF
        };
        assert!(loss.assess(Some((killed, 0)), 501 * MS).sticks.is_killed);
    }

    #[test]
    fn a_successor_sends_nothing_before_it_has_sticks() {
        let link = RcLink {
            link: RadioProtocol::Crsf,
            transmitter: Some(Transmitter {
                device: Some("/dev/null".to_owned()),
                ..Transmitter::default()
            }),
            ..RcLink::default()
        };
        let mut link = RadioLink::reopen(&link).unwrap();
        assert_eq!(link.transmit(None, 0), None);
        assert_eq!((link.silent(), link.port().counts().closed), (0, 0));
        assert_eq!(
            link.transmit(Some((FLYING, MS)), MS),
            Some(Sent::Closed),
            "what there is no device for"
        );
    }
}
