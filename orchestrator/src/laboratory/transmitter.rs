//! The transmitter with a radio link behind it: what every frame says leaves on the link, from a thread of the link's own.
//!
//! The step logic is the simulated one's, and so is what it publishes: nothing that the link does comes back to it.

use std::sync::Arc;

use radio_link::link::RadioLink;
use radio_link::sender::{Condition, Report, Sender};
use radio_link::sticks::Sticks;
use runtime::shared_page::SharedPage;
use shared_types::sample::Field;
use shared_types::scenario::RcLink;
use shared_types::service::{ErasedService, InputView, OutputSlot, Outputs, nanoseconds, seconds};
use shared_types::wiring::RcOutputOutputs;
use shared_types::{Now, ServiceId};
use zerocopy::FromZeros;

use super::is_under_way;
use crate::log::LinkFigures;

/// The transmitter's step logic, and who sends what it says. Dropping it lets the motors rest.
pub(super) struct Transmitter {
    service: Box<dyn ErasedService>,
    /// There until it is stopped.
    sender: Option<Sender>,
    page: Arc<SharedPage>,
}

impl Transmitter {
    /// Opens the link of a scenario that has been checked, and begins to send.
    ///
    /// # Errors
    /// What cannot be used before the flight, with the fix.
    pub(super) fn open(
        service: Box<dyn ErasedService>,
        link: &RcLink,
        page: Arc<SharedPage>,
    ) -> Result<Self, String> {
        let opened = if is_under_way(&page) {
            RadioLink::reopen(link)
        } else {
            RadioLink::open(link).map_err(|error| error.to_string())?
        };
        let transmitter = link.transmitter.as_ref();
        let (opened, transmitter) = opened
            .zip(transmitter)
            .ok_or_else(|| format!("nothing says where frames of `{}` go", link.link.name()))?;
        let period_ns = nanoseconds(1.0 / transmitter.frame_rate_on(link.link));
        let sender = Sender::start(opened, period_ns).map_err(|error| error.to_string())?;
        let figures = in_flight(&sender.condition());
        let transmitter = Self {
            service,
            sender: Some(sender),
            page,
        };
        transmitter.tell(&figures);
        Ok(transmitter)
    }

    fn tell(&self, figures: &LinkFigures) {
        self.page.words().notices[ServiceId::RcOutput.index()].tell(figures);
    }
}

impl ErasedService for Transmitter {
    fn id(&self) -> ServiceId {
        self.service.id()
    }

    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        self.service.step(now, inputs, outputs);
        let Some(sender) = &self.sender else { return };
        let mut outputs = RcOutputOutputs::from_slots(outputs);
        // What is not finite is not published either.
        if let Some(frame) = outputs.frame.due().filter(|frame| frame.is_finite()) {
            sender.put(&Sticks::of(frame));
        }
        self.tell(&in_flight(&sender.condition()));
    }

    fn state_size(&self) -> usize {
        self.service.state_size()
    }

    fn save(&self, bytes: &mut [u8]) {
        self.service.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) {
        self.service.restore(bytes);
    }
}

impl Drop for Transmitter {
    fn drop(&mut self) {
        let Some(sender) = self.sender.take() else { return };
        sender.put(&Sticks::AT_REST);
        if let Ok(report) = sender.stop() {
            self.tell(&at_the_end(&report));
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
        ..LinkFigures::new_zeroed()
    }
}

fn at_the_end(report: &Report) -> LinkFigures {
    let late = |quantile| seconds(report.lateness_ns.value_at_quantile(quantile));
    let counts = &report.counts;
    LinkFigures {
        state: state(counts.losses == counts.recoveries),
        sent: counts.sent,
        dropped: counts.busy + counts.closed,
        silent: report.silent,
        left_out: report.left_out,
        losses: counts.losses,
        recoveries: counts.recoveries,
        late_p50: late(0.5),
        late_p99: late(0.99),
        late_max: late(1.0),
        ..LinkFigures::new_zeroed()
    }
}
