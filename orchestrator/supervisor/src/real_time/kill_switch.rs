//! The kill switch of a flight: presses, losses, and their consequences.

use std::os::fd::AsFd;
use std::time::Instant;

use crate::kill_switch::device::Device;
use crate::kill_switch::watch::{self, SwitchEvent, Watch};
use runtime::shared_page::{Request, SharedPage, ask_in};
use scenario::{KillSwitchLoss, OperatorDevices, Scenario};
use shared_types::samples::RunEvent;

use super::Flight;
use crate::RunFailure;

/// Kill switch of the scenario.
pub(super) struct KillSwitch {
    watch: Watch,
    /// Reason of the loss, while it is lost.
    lost: Option<String>,
}

/// Opens the kill switch of a scenario, if it has one: no flight starts without it.
///
/// # Errors
/// [`RunFailure::setup`], with the fix.
pub(super) fn open(scenario: &Scenario) -> Result<Option<Device>, RunFailure> {
    let device = scenario.operator.as_ref().map(watch::open).transpose();
    device.map_err(|error| RunFailure::setup(format!("operator.kill_device: {error}")))
}

impl KillSwitch {
    /// Starts to watch the kill switch. After a take-over it may be missing at first.
    pub(super) fn start(
        stated: &OperatorDevices,
        device: Option<Device>,
        page: &SharedPage,
    ) -> std::io::Result<Self> {
        let page = page.file().try_clone_to_owned()?;
        // The thread writes to the control block itself: services obey at their next step, also while this process
        // waits for its disk.
        let kill = move || {
            // If it fails, the flight repeats the request when it handles the event.
            let _ = ask_in(page.as_fd(), Request::Kill);
        };
        Ok(Self {
            watch: Watch::start(stated, device, kill)?,
            lost: None,
        })
    }

    /// Returns the reason of its loss, if it is lost.
    pub(super) fn loss(&self) -> Option<&str> {
        self.lost.as_deref()
    }
}

impl Flight<'_> {
    /// After a take-over, starts to watch the kill switch. A missing device counts as lost.
    pub(super) fn inherit_kill_switch(&mut self) {
        let Some(stated) = &self.scenario.operator else {
            return;
        };
        let opened = watch::open(stated);
        let missing = opened.as_ref().err().map(ToString::to_string);
        match KillSwitch::start(stated, opened.ok(), self.supervisor.page()) {
            Ok(switch) => self.kill_switch = Some(switch),
            Err(error) => self.fail(RunFailure::setup(error)),
        }
        if missing.is_some() {
            self.note_kill_switch(missing);
        }
    }

    /// Handles presses and losses of the kill switch.
    pub(super) fn handle_kill_switch(&mut self) {
        let Some(switch) = &self.kill_switch else { return };
        let news: Vec<_> = switch.watch.events().collect();
        for news in news {
            match news {
                SwitchEvent::Pressed(signal, at) => self.kill_by(&signal, at),
                SwitchEvent::Lost(reason) => self.note_kill_switch(Some(reason)),
                SwitchEvent::Reopened => self.note_kill_switch(None),
            }
        }
        self.react_to_lost_kill_switch();
    }

    /// Kills like `gerono kill`, and records the signal of the kill switch.
    fn kill_by(&mut self, signal: &str, at: Instant) {
        let event = format!("kill switch: {signal}, {}", self.kill_device());
        // The services may have obeyed already: the event is dated before their reaction.
        let age_ns = u64::try_from(at.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let tick = self.clock.elapsed_ns().saturating_sub(age_ns) / self.clock.tick_ns;
        self.ask_at(tick, Request::Kill, RunEvent::KIND_OPERATOR_KILLS, event.clone());
        self.announce_kill(&event);
    }

    /// Handles the loss of the kill switch, with its reason, or its return.
    fn note_kill_switch(&mut self, lost: Option<String>) {
        let device = self.kill_device();
        let (text, event) = match &lost {
            Some(reason) => (
                format!("the kill switch is lost: {reason}"),
                format!("kill switch lost: {device}"),
            ),
            None => (
                format!("the kill switch {device} is connected again"),
                format!("kill switch found: {device}"),
            ),
        };
        let tick = self.clock.tick().min(self.schedule.last_tick());
        self.pending_events
            .push((tick, RunEvent::KIND_KILL_SWITCH, event.into()));
        self.announce(text);
        self.conduct.note_kill_switch(lost.is_some());
        if let Some(switch) = &mut self.kill_switch {
            switch.lost = lost;
        }
    }

    /// Executes `operator.on_loss` once for each loss, while the vehicle is armed.
    fn react_to_lost_kill_switch(&mut self) {
        let may_fly = self.is_armed() && !self.operator().killed;
        let Some(reaction) = self.conduct.reaction_to_loss(may_fly) else {
            return;
        };
        let event = format!("kill switch lost: {}", self.kill_device());
        let text = match reaction {
            KillSwitchLoss::Ignore => {
                "The flight continues without its kill switch, as `operator.on_loss` states.".to_owned()
            }
            KillSwitchLoss::Land => self.request_end(event),
            KillSwitchLoss::Kill => {
                self.ask(Request::Kill, RunEvent::KIND_OPERATOR_KILLS, event);
                "killed: the motors rest until the end of the run (the kill switch is lost)".to_owned()
            }
        };
        self.announce(text);
    }

    fn kill_device(&self) -> String {
        let stated = self.scenario.operator.as_ref();
        stated.map_or_else(String::new, |stated| stated.kill_device.clone())
    }
}
