//! Requirements of a flight.

use scenario::{CrazyflieUri, Curve, Hover, Path, Scenario, ServiceDeployment, Vehicle};
use shared_types::{Schedule, ServiceId};

use run_log::predicted_bytes;
use supervisor::reserve;

/// Requirements of a flight on the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Needs {
    /// `true` if a scenario was given; otherwise the needs are those of an ordinary flight.
    pub has_scenario: bool,
    /// `true` if the scenario's deployment is strict.
    pub is_strict: bool,
    /// The cores that the scenario sets.
    pub cores: Vec<u32>,
    /// The highest priority that the scenario sets.
    pub priority: Option<u32>,
    /// `true` if any service locks its memory.
    pub lock_memory: bool,
    /// Deployment of the service of highest priority.
    pub highest_priority: ServiceDeployment,
    /// Duration of the flight, s.
    pub duration: f64,
    /// Predicted size of the log, bytes.
    pub log_bytes: u64,
    pub shared_memory: u64,
    /// Index of the USB dongle that reaches a Crazyflie.
    pub dongle: Option<usize>,
    /// Timeout of a step for inputs that are due, s.
    pub grace: f64,
}

impl Needs {
    /// Returns the needs of a scenario.
    #[must_use]
    pub fn of(scenario: &Scenario, schedule: &Schedule) -> Self {
        let uses = ServiceId::ALL.map(|service| scenario.deployment_of(service));
        let mut cores: Vec<u32> = uses.iter().filter_map(|settings| settings.core).collect();
        cores.sort_unstable();
        cores.dedup();
        let highest_priority = uses.iter().max_by_key(|settings| settings.priority);
        Self {
            has_scenario: true,
            is_strict: scenario.deployment.as_ref().is_some_and(|stated| stated.strict),
            cores,
            priority: uses.iter().filter_map(|settings| settings.priority).max(),
            lock_memory: uses.iter().any(|settings| settings.lock_memory == Some(true)),
            highest_priority: highest_priority.copied().unwrap_or_default(),
            duration: scenario.duration,
            log_bytes: predicted_bytes(scenario, schedule),
            shared_memory: reserve::needed(schedule),
            dongle: dongle(scenario),
            grace: scenario.real_time.unwrap_or_default().grace,
        }
    }

    /// Returns the needs of an ordinary flight: 60 s in which every service steps at 1 kHz.
    #[must_use]
    pub fn ordinary() -> Self {
        let hover = Curve::Hover(Hover {
            position: [0.0, 0.0, -1.0],
        });
        let vehicle = Vehicle::new(0.2, [6.5e-4, 6.5e-4, 13.0e-4]);
        let scenario = Scenario::new(60.0, vehicle, Path::new(hover));
        let last_tick = (scenario.duration / scenario.schedule.tick).round() as u64;
        let schedule = Schedule::ideal(
            shared_types::service::nanoseconds(scenario.schedule.tick),
            last_tick,
        );
        Self {
            has_scenario: false,
            ..Self::of(&scenario, &schedule)
        }
    }

    /// Returns the growth of the log of a flight in real time, bytes/s.
    #[must_use]
    pub fn log_rate(&self) -> f64 {
        self.log_bytes as f64 / self.duration.max(f64::MIN_POSITIVE)
    }
}

fn dongle(scenario: &Scenario) -> Option<usize> {
    let uri = scenario.rc_output.as_ref()?.transmitter.as_ref()?.uri.as_ref()?;
    match uri.parse().ok()? {
        CrazyflieUri::Radio(address) => Some(address.dongle),
        CrazyflieUri::Udp(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needs(sets: &[&str]) -> Needs {
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        let hover = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/hover.toml");
        let scenario = scenario_file::load(&hover, &sets, None).unwrap();
        Needs::of(&scenario, &scenario.schedule().unwrap())
    }

    #[test]
    fn the_highest_priority_and_all_cores_count() {
        let needs = needs(&[
            "deployment={core=1, priority=10, strict=true, rc_output={core=0, priority=30}, plant={lock_memory=true}}",
            "real_time.grace=0.001",
        ]);
        assert_eq!((needs.cores, needs.priority), (vec![0, 1], Some(30)));
        assert!(needs.is_strict && needs.lock_memory && needs.has_scenario);
        assert_eq!(
            (needs.highest_priority.core, needs.highest_priority.priority),
            (Some(0), Some(30))
        );
        assert_eq!(needs.grace, 0.001);
    }

    #[test]
    fn a_longer_flight_writes_more_at_the_same_rate() {
        let [short, long] = ["duration=10.0", "duration=40.0"].map(|set| needs(&[set]));
        let ratio = long.log_bytes as f64 / short.log_bytes as f64;
        assert!((3.9..=4.1).contains(&ratio), "{ratio}");
        assert!((long.log_rate() / short.log_rate() - 1.0).abs() < 0.01);
        assert_eq!(long.shared_memory, short.shared_memory);
        assert_eq!(long.priority, None);
    }

    #[test]
    fn only_a_crazyflie_on_the_air_needs_a_dongle() {
        let [air, simulator] = ["radio://2/80", "udp://127.0.0.1:19850"].map(|uri| {
            let crazyflie = "../../scenarios/laboratory_crazyflie.toml";
            let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(crazyflie);
            let sets = [format!("rc_output.transmitter.uri={uri:?}")];
            let scenario = scenario_file::load(&path, &sets, None).unwrap();
            Needs::of(&scenario, &scenario.schedule().unwrap()).dongle
        });
        assert_eq!((air, simulator), (Some(2), None));
    }

    #[test]
    fn an_ordinary_flight_asks_for_nothing() {
        let ordinary = Needs::ordinary();
        assert!(!ordinary.has_scenario && !ordinary.is_strict && !ordinary.lock_memory);
        assert_eq!((ordinary.priority, ordinary.cores), (None, vec![]));
    }
}
