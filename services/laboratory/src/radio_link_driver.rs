//! Transmitter with a radio link: a separate thread sends every frame on the link.
//!
//! Step logic and published samples are those of the simulated transmitter: the link has no feedback to it.

use std::sync::Arc;

use radio_link::link::RadioLink;
use radio_link::sender::{Condition, LinkReport, Sender, monotonic_ns};
use radio_link::sticks::{Sticks, StoppedMotors, ThrustRest};
use runtime::shared_page::SharedPage;
use scenario::RcLink;
use shared_types::battery::BatteryReading;
use shared_types::sample::Field;
use shared_types::service::{
    BuildError, ErasedService, InputView, OutputSlot, Outputs, nanoseconds, seconds,
};
use shared_types::wiring::RcOutputOutputs;
use shared_types::{Now, ServiceId};
use zerocopy::FromZeros;

use super::is_under_way;
use run_log::LinkFigures;

/// Step logic of the transmitter, and the sender of its frames. Only the end of the flight stops the motors: after the
/// death of a process the receiver holds the last sticks until the next process sends.
pub(super) struct RadioLinkDriver {
    service: Box<dyn ErasedService>,
    /// `None` after it was stopped.
    sender: Option<Sender>,
    rest: ThrustRest,
    stopped: StoppedMotors,
    page: Arc<SharedPage>,
}

impl RadioLinkDriver {
    /// Opens the link of a checked scenario, and begins to send.
    ///
    /// # Errors
    /// If hardware cannot be used before the flight, with the fix.
    pub(super) fn open(
        service: Box<dyn ErasedService>,
        link: &RcLink,
        page: Arc<SharedPage>,
    ) -> Result<Self, BuildError> {
        let opened = if is_under_way(&page) {
            // A correction of the thrust continues where the dead process was.
            let last: LinkFigures = page.control_block().link_status.read();
            RadioLink::reopen(link).map(|mut link| {
                if let Some(reading) = BatteryReading::from_word(last.pad0) {
                    link.continue_from(&reading, monotonic_ns());
                }
                link
            })
        } else {
            RadioLink::open(link)?
        };
        let transmitter = link.transmitter.as_ref();
        let (opened, transmitter) = opened
            .zip(transmitter)
            .ok_or_else(|| format!("nothing says where frames of `{}` go", link.link.name()))?;
        let period_ns = nanoseconds(1.0 / transmitter.frame_rate_on(link.link));
        let sender = Sender::start(opened, period_ns)?;
        let figures = in_flight(&sender.condition());
        let transmitter = Self {
            service,
            sender: Some(sender),
            rest: ThrustRest::new(link),
            stopped: StoppedMotors::default(),
            page,
        };
        transmitter.write_status(&figures);
        Ok(transmitter)
    }

    fn write_status(&self, figures: &LinkFigures) {
        self.page.control_block().link_status.write(figures);
    }
}

impl ErasedService for RadioLinkDriver {
    fn id(&self) -> ServiceId {
        self.service.id()
    }

    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        self.service.step(now, inputs, outputs);
        let Some(sender) = &self.sender else { return };
        let mut outputs = RcOutputOutputs::from_slots(outputs);
        if let Some(frame) = outputs.frame.due() {
            // A frame that is not finite is not published either.
            if frame.is_finite() {
                let mut sticks = self.rest.sticks(frame);
                self.stopped.mark(now, &mut sticks);
                sender.set(&sticks);
            }
        }
        self.write_status(&in_flight(&sender.condition()));
    }

    fn has_trials(&self) -> bool {
        self.service.has_trials()
    }

    fn try_saved_state(&mut self) -> Result<(), String> {
        self.service.try_saved_state()
    }

    fn finish(&mut self) {
        if let Some(sender) = &self.sender {
            sender.set(&Sticks::MOTORS_OFF);
        }
    }

    fn state_size(&self) -> usize {
        self.service.state_size()
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        self.service.save_with(keep);
    }

    fn restore(&mut self, bytes: &[u8]) {
        self.service.restore(bytes);
    }
}

impl Drop for RadioLinkDriver {
    fn drop(&mut self) {
        if let Some(Ok(report)) = self.sender.take().map(Sender::stop) {
            self.write_status(&at_the_end(&report));
        }
    }
}

fn state(is_open: bool) -> u32 {
    if is_open {
        LinkFigures::STATE_OPEN
    } else {
        LinkFigures::STATE_LOST
    }
}

fn in_flight(condition: &Condition) -> LinkFigures {
    LinkFigures {
        state: state(condition.is_open),
        sent: condition.sent,
        dropped: condition.dropped,
        silent: condition.silent,
        left_out: condition.left_out,
        losses: condition.losses,
        recoveries: condition.recoveries,
        pad0: condition.battery,
        ..LinkFigures::new_zeroed()
    }
}

fn at_the_end(report: &LinkReport) -> LinkFigures {
    let late = |quantile| seconds(report.lateness_ns.value_at_quantile(quantile));
    let counts = &report.counts;
    LinkFigures {
        state: state(!counts.is_lost()),
        sent: counts.sent,
        dropped: counts.busy + counts.closed,
        silent: report.silent,
        left_out: report.left_out,
        losses: counts.losses,
        recoveries: counts.recoveries,
        pad0: report.battery,
        late_p50: late(0.5),
        late_p99: late(0.99),
        late_max: late(1.0),
        ..LinkFigures::new_zeroed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radio_link::crsf;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use scenario::{RadioProtocol, Transmitter as Stated};
    use shared_types::samples::RcFrame;
    use shared_types::service::Operator;
    use zerocopy::IntoBytes;

    /// Step logic that sends frames of these thrusts, N, one a step.
    struct Says(Vec<f64>);

    impl ErasedService for Says {
        fn id(&self) -> ServiceId {
            ServiceId::RcOutput
        }

        fn step(&mut self, _now: &Now, _inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
            let mut outputs = RcOutputOutputs::from_slots(outputs);
            let frame = outputs.frame.due().unwrap();
            frame.mode = RcFrame::MODE_RATES;
            frame.channels = [1000; 16];
            frame.thrust = self.0.remove(0);
        }

        fn state_size(&self) -> usize {
            0
        }

        fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
            keep(&[]);
        }

        fn restore(&mut self, _bytes: &[u8]) {}
    }

    /// Returns the last frame that a receiver gets of a transmitter with frames of these thrusts, whose process is there at
    /// the end of the flight or not.
    fn last_frame(thrusts: &[f64], reversed: &str, until_the_end: bool) -> radio_link::ChannelCodes {
        let receiver = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&receiver).unwrap();
        unlockpt(&receiver).unwrap();
        let device = ptsname(&receiver, Vec::new()).unwrap().into_string().unwrap();
        let link = RcLink {
            link: RadioProtocol::Crsf,
            transmitter: Some(Stated {
                device: Some(device),
                arming_channel: Some(5),
                reversed: reversed.to_owned(),
                ..Stated::default()
            }),
            ..RcLink::default()
        };
        let page = Arc::new(SharedPage::create().unwrap());
        let service = Box::new(Says(thrusts.to_vec()));
        let mut transmitter = RadioLinkDriver::open(service, &link, Arc::clone(&page)).unwrap();
        for _ in thrusts {
            let mut frame = RcFrame::new_zeroed();
            let mut outputs = [OutputSlot {
                bytes: Some(frame.as_mut_bytes()),
            }];
            let now = Now {
                tick: 0,
                time_ns: 0,
                elapsed_ns: 0,
                operator: Operator::FLYING,
            };
            transmitter.step(&now, &[], &mut outputs);
        }
        if until_the_end {
            transmitter.finish();
        }
        drop(transmitter);
        let figures: LinkFigures = page.control_block().link_status.read();
        let mut bytes = vec![0; crsf::LENGTH * usize::try_from(figures.sent).unwrap()];
        let mut filled = 0;
        while filled < bytes.len() {
            filled += rustix::io::read(&receiver, &mut bytes[filled..]).unwrap();
        }
        crsf::decode(&bytes[bytes.len() - crsf::LENGTH..]).unwrap()
    }

    #[test]
    fn at_the_end_the_motors_rest() {
        assert_eq!(last_frame(&[2.0, 2.1], "", true)[..5], [992, 992, 172, 992, 172]);
        assert_eq!(
            last_frame(&[2.0, 2.1], "T", true)[..5],
            [992, 992, 1811, 992, 172]
        );
    }

    #[test]
    fn a_transmitter_that_ends_before_the_flight_leaves_the_sticks_to_its_successor() {
        for thrusts in [[2.0, 2.1], [2.0, f64::NAN]] {
            let last = last_frame(&thrusts, "", false);
            assert_eq!(last[4], crsf::ENDS[1], "still armed");
        }
    }
}
