//! Orchestrator watchdog: the reaction of a service in real time to the loss of the orchestrator.
//!
//! The orchestrator renews a time in the control block. A service that sees it unchanged for [`SILENCE_NS`] checks its
//! control channel: an orchestrator that is only stopped or slow still holds the other end. If it is gone, the services
//! land the vehicle or fly on to the end of the scenario, as the scenario says. Without flight phases they cannot land,
//! and end. Meanwhile they look for an orchestrator that takes over.

use std::sync::atomic::Ordering;

use scenario::{OrchestratorLoss, Scenario};

use crate::control::Channel;
use crate::shared_page::ControlBlock;
use crate::take_over::HandOver;

/// Silence of the orchestrator after which a service checks whether it is gone, ns.
pub const SILENCE_NS: u64 = 500_000_000;

/// Longest landing without the orchestrator, ns.
const LANDING_NS: u64 = 60_000_000_000;

/// Watchdog of one service over the orchestrator.
#[derive(Debug)]
pub struct OrchestratorWatchdog {
    channel: Channel,
    hand_over: HandOver,
    then: Then,
    /// Time at which the orchestrator was found to be gone, ns of `CLOCK_MONOTONIC`.
    alone_since: Option<u64>,
    /// Time of the next check, ns of `CLOCK_MONOTONIC`.
    look_at: u64,
}

/// Reaction to the loss of the orchestrator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Then {
    End,
    Land,
    FlyOn,
}

impl OrchestratorWatchdog {
    /// Makes the watchdog for a flight of `scenario` by an orchestrator at the other end of `channel`. An orchestrator
    /// that takes over gets `hand_over`.
    #[must_use]
    pub fn new(scenario: &Scenario, channel: Channel, hand_over: HandOver) -> Self {
        let wanted = scenario.real_time.unwrap_or_default().orchestrator_loss;
        Self {
            channel,
            hand_over,
            then: match (wanted, &scenario.flight) {
                (OrchestratorLoss::Continue, _) => Then::FlyOn,
                (OrchestratorLoss::Land, Some(_)) => Then::Land,
                (OrchestratorLoss::Land, None) => Then::End,
            },
            alone_since: None,
            look_at: 0,
        }
    }

    /// Returns whether the vehicle is to land because the orchestrator is gone.
    #[must_use]
    #[inline]
    pub fn is_to_land(&self) -> bool {
        self.alone_since.is_some() && self.then == Then::Land
    }

    /// Returns the control channel to the orchestrator, or to the one that has taken over.
    #[must_use]
    pub fn channel(&self) -> &Channel {
        &self.channel
    }

    /// Checks for the orchestrator at time `now`, ns of `CLOCK_MONOTONIC`. Returns whether the service is to end
    /// because the orchestrator is gone.
    #[inline]
    pub fn has_ended(&mut self, block: &ControlBlock, now: u64) -> bool {
        // Relaxed: a time and nothing else. An old value only makes the check of the channel come earlier.
        let alive = block.orchestrator_alive_ns.load(Ordering::Relaxed);
        if now.saturating_sub(alive) < SILENCE_NS || now < self.look_at {
            return false;
        }
        self.look(now)
    }

    #[cold]
    fn look(&mut self, now: u64) -> bool {
        self.look_at = now + SILENCE_NS;
        if !self.channel.is_closed() {
            return false;
        }
        if let Some(channel) = self.hand_over.offer() {
            self.channel = channel;
            self.alone_since = None;
            return false;
        }
        let since = *self.alone_since.get_or_insert(now);
        match self.then {
            Then::End => true,
            Then::Land => now - since > LANDING_NS,
            Then::FlyOn => false,
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
        assert!(!landing.is_to_land());
        assert!(!landing.has_ended(&block, monotonic_ns()) && landing.is_to_land());
        let mut flying_on = alone(OrchestratorLoss::Continue, true);
        assert!(!flying_on.has_ended(&block, monotonic_ns()) && !flying_on.is_to_land());
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
        assert_eq!(flight.alone_since, None);
    }

    #[test]
    fn a_take_over_ends_the_landing_of_an_orphaned_service() {
        let place = tempfile::tempdir().unwrap();
        let mut flight = alone(OrchestratorLoss::Land, true);
        flight.hand_over = hand_over(place.path());
        let block = ControlBlock::default();
        assert!(!flight.has_ended(&block, monotonic_ns()) && flight.is_to_land());
        let listener = TakeOverListener::listen(place.path()).unwrap();
        assert!(!flight.has_ended(&block, monotonic_ns() + 2 * SILENCE_NS));
        assert!(!flight.is_to_land());
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
