//! Orchestrator watchdog: the reaction of a service in real time to the loss of the orchestrator.
//!
//! The orchestrator renews a time stamp in the control block. If it is older than [`SILENCE_NS`], a service checks its
//! control channel: an orchestrator that is only stopped or slow still holds the other end. If the channel is closed, the
//! services land the vehicle or continue to the end of the scenario, as the scenario states. Without flight phases they
//! cannot land, and end. Meanwhile they poll for an orchestrator that takes over.

use std::sync::atomic::Ordering;

use scenario::{OrchestratorLoss, Scenario};

use crate::control::Channel;
use crate::shared_page::ControlBlock;
use crate::take_over::HandOver;

/// Age of the orchestrator's time stamp from which a service checks the control channel, ns.
pub const SILENCE_NS: u64 = 500_000_000;

/// Timeout of a landing without an orchestrator, ns.
const LANDING_NS: u64 = 60_000_000_000;

/// Watchdog of one service over the orchestrator.
#[derive(Debug)]
pub struct OrchestratorWatchdog {
    channel: Channel,
    hand_over: HandOver,
    reaction: Reaction,
    /// Time at which the orchestrator was found to be gone, ns of `CLOCK_MONOTONIC`.
    orphaned_since: Option<u64>,
    /// Time of the next check, ns of `CLOCK_MONOTONIC`.
    next_check_ns: u64,
}

/// Reaction to the loss of the orchestrator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reaction {
    End,
    Land,
    Continue,
}

impl OrchestratorWatchdog {
    /// Makes the watchdog for a flight of `scenario` by the orchestrator at the other end of `channel`. An orchestrator
    /// that takes over receives `hand_over`.
    #[must_use]
    pub fn new(scenario: &Scenario, channel: Channel, hand_over: HandOver) -> Self {
        let stated = scenario.real_time.unwrap_or_default().orchestrator_loss;
        Self {
            channel,
            hand_over,
            reaction: match (stated, &scenario.flight) {
                (OrchestratorLoss::Continue, _) => Reaction::Continue,
                (OrchestratorLoss::Land, Some(_)) => Reaction::Land,
                (OrchestratorLoss::Land, None) => Reaction::End,
            },
            orphaned_since: None,
            next_check_ns: 0,
        }
    }

    /// Returns whether the loss of the orchestrator requires a landing.
    #[must_use]
    #[inline]
    pub fn requires_landing(&self) -> bool {
        self.orphaned_since.is_some() && self.reaction == Reaction::Land
    }

    /// Returns the control channel to the current orchestrator.
    #[must_use]
    pub fn channel(&self) -> &Channel {
        &self.channel
    }

    /// Checks for the orchestrator at time `now`, ns of `CLOCK_MONOTONIC`. Returns whether its loss ends the service.
    #[inline]
    pub fn has_ended(&mut self, block: &ControlBlock, now: u64) -> bool {
        // Relaxed: the time stamp publishes no other data. An old value only makes the check of the channel earlier.
        let alive = block.orchestrator_alive_ns.load(Ordering::Relaxed);
        if now.saturating_sub(alive) < SILENCE_NS || now < self.next_check_ns {
            return false;
        }
        self.check_channel(now)
    }

    #[cold]
    fn check_channel(&mut self, now: u64) -> bool {
        self.next_check_ns = now + SILENCE_NS;
        if !self.channel.is_closed() {
            return false;
        }
        if let Some(channel) = self.hand_over.offer() {
            self.channel = channel;
            self.orphaned_since = None;
            return false;
        }
        let since = *self.orphaned_since.get_or_insert(now);
        match self.reaction {
            Reaction::End => true,
            Reaction::Land => now - since > LANDING_NS,
            Reaction::Continue => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Host, Start};
    use crate::deployment::Scheduler;
    use crate::flight_clock::monotonic_ns;
    use crate::take_over::{FILES, Hello, TakeOverListener};
    use scenario::{Curve, Hover, Path, Vehicle};
    use shared_types::ServiceId;
    use std::os::fd::AsFd;

    fn scenario() -> Scenario {
        let vehicle = Vehicle::new(0.2, [0.1e-3; 3]);
        let hover = Curve::Hover(Hover {
            position: [0.0, 0.0, -1.0],
        });
        Scenario::new(10.0, vehicle, Path::new(hover))
    }

    fn hand_over(place: &std::path::Path) -> HandOver {
        let hello = Hello {
            service: ServiceId::Plant,
            start: Start {
                scenario: scenario(),
                iceoryx2_configuration: place.join("iceoryx2.toml"),
                core: None,
                scheduler: Scheduler::Fair,
                role: None,
                host: Host::RealTime,
            },
        };
        HandOver::new(place, &hello, [std::io::stdin().as_fd(); FILES]).unwrap()
    }

    fn alone(loss: OrchestratorLoss, with_phases: bool) -> OrchestratorWatchdog {
        let mut scenario = scenario();
        scenario.real_time = Some(scenario::RealTime {
            orchestrator_loss: loss,
            ..Default::default()
        });
        scenario.flight = with_phases.then(Default::default);
        let (orchestrator, service) = Channel::pair().unwrap();
        drop(orchestrator);
        OrchestratorWatchdog::new(
            &scenario,
            Channel::inherited(service),
            hand_over(std::path::Path::new("nowhere")),
        )
    }

    #[test]
    fn an_orphaned_service_lands_flies_on_or_ends_as_the_scenario_says() {
        let block = ControlBlock::default();
        let mut landing = alone(OrchestratorLoss::Land, true);
        assert!(!landing.requires_landing());
        assert!(!landing.has_ended(&block, monotonic_ns()) && landing.requires_landing());
        let mut flying_on = alone(OrchestratorLoss::Continue, true);
        assert!(!flying_on.has_ended(&block, monotonic_ns()) && !flying_on.requires_landing());
        assert!(alone(OrchestratorLoss::Land, false).has_ended(&block, monotonic_ns()));
    }

    #[test]
    fn a_silent_orchestrator_with_an_open_channel_is_not_lost() {
        let (_orchestrator, service) = Channel::pair().unwrap();
        let mut flight = OrchestratorWatchdog::new(
            &scenario(),
            Channel::inherited(service),
            hand_over(std::path::Path::new("nowhere")),
        );
        assert!(!flight.has_ended(&ControlBlock::default(), monotonic_ns()));
        assert_eq!(flight.orphaned_since, None);
    }

    #[test]
    fn a_take_over_ends_the_landing_of_an_orphaned_service() {
        let place = tempfile::tempdir().unwrap();
        let mut flight = alone(OrchestratorLoss::Land, true);
        flight.hand_over = hand_over(place.path());
        let block = ControlBlock::default();
        assert!(!flight.has_ended(&block, monotonic_ns()) && flight.requires_landing());
        let listener = TakeOverListener::listen(place.path()).unwrap();
        assert!(!flight.has_ended(&block, monotonic_ns() + 2 * SILENCE_NS));
        assert!(!flight.requires_landing());
        let inherited = listener
            .accept(std::time::Duration::from_secs(10))
            .unwrap()
            .unwrap();
        assert_eq!(inherited.hello.service, ServiceId::Plant);
        assert!(!flight.channel().is_closed());
    }

    #[test]
    fn the_channel_is_not_checked_while_the_orchestrator_is_alive() {
        let mut flight = alone(OrchestratorLoss::Land, false);
        let block = ControlBlock::default();
        block
            .orchestrator_alive_ns
            .store(monotonic_ns(), Ordering::Relaxed);
        assert!(!flight.has_ended(&block, monotonic_ns()));
    }
}
