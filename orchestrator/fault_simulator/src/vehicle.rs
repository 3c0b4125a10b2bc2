//! A vehicle in the air, flown by the services themselves.

use std::path::Path;

use host::newest_wins::{NewestWins, Presence, RealTimeState, Start};
use scenario::Scenario;
use shared_types::samples::{PathReference, RcFrame, VehicleTruth};
use shared_types::service::{Operator, nanoseconds};
use shared_types::{FlightPhase, ServiceId};

use crate::world::{Present, Request, World};

/// The flight: take-off, the eight, landing, within an envelope.
const SCENARIO: &str = include_str!("../../../scenarios/takeoff_and_land.toml");

/// Time at which the vehicle is on its path, s.
const ON_THE_PATH: f64 = 14.0;

/// Time for which the vehicle is followed from there, s: its planned landing is over then.
const FOLLOWED: f64 = 25.0;

/// Absence of services up to which the vehicle must not fall, s: a hang at the default limit, and a restart. Absences that
/// follow each other count together, less half of the time between them.
const SURVIVED: f64 = 0.25;

/// Speed of a touch-down above which the vehicle is lost, m/s: 1 m/s above that of the landing.
const FALL: f64 = 1.3;

/// Cosine of the tilt at which the envelope stops the motors, 1 rad.
const UPRIGHT: f64 = 0.54;

/// Time from a kill until the motors rest, s.
const KILLED_WITHIN: f64 = 0.05;

/// Longest time from a request to land until the motors rest, ns: a vehicle without a state descends until the controller
/// stops its motors after 10 s, which begin when the state ends.
const LANDING_NS: u64 = 12_000_000_000;

/// A vehicle on its path, from which any number of histories begin.
pub struct Vehicle {
    flight: NewestWins,
    on_the_path: RealTimeState,
    base_tick: u64,
}

impl Vehicle {
    /// Flies the vehicle to its path.
    ///
    /// # Panics
    /// If the shipped scenario cannot be flown.
    #[must_use]
    pub fn new() -> Self {
        let file = Path::new("takeoff_and_land.toml");
        let scenario = scenario_file::load_text(file, SCENARIO, &[], None).expect("the shipped scenario");
        Self::of(&scenario.with_real_time_policies())
    }

    fn of(scenario: &Scenario) -> Self {
        let schedule = scenario.schedule().expect("it can be flown");
        let grace_ns = nanoseconds(scenario.real_time.unwrap_or_default().grace);
        let services = registry::build_all(scenario).expect("it can be flown");
        let base_tick = nanoseconds(ON_THE_PATH) / schedule.tick_ns();
        let mut flight = NewestWins::new(schedule, grace_ns, services);
        while flight.next_tick() < base_tick {
            let operator = flight.planned_operator();
            flight
                .step(operator)
                .expect("an undisturbed flight has no such number");
        }
        Self {
            on_the_path: flight.save(),
            flight,
            base_tick,
        }
    }

    /// Returns the vehicle on its path.
    pub fn begin(&mut self) -> Airborne<'_> {
        self.flight.restore(&self.on_the_path);
        for service in ServiceId::ALL {
            self.flight.set_presence(service, Presence::Present);
        }
        let tick_ns = self.flight.schedule().tick_ns();
        let ticks = |seconds| nanoseconds(seconds) / tick_ns;
        Airborne {
            base_tick: self.base_tick,
            last_tick: self.base_tick + ticks(FOLLOWED),
            survived: ticks(SURVIVED),
            killed_within: ticks(KILLED_WITHIN),
            flight: &mut self.flight,
            operator: Operator::default(),
            killed_at: None,
            absent: 0,
            is_judged: true,
            sinking: 0.0,
            has_landed: false,
            found: None,
        }
    }
}

impl Default for Vehicle {
    fn default() -> Self {
        Self::new()
    }
}

/// A vehicle in the air.
pub struct Airborne<'a> {
    flight: &'a mut NewestWins,
    base_tick: u64,
    last_tick: u64,
    survived: u64,
    killed_within: u64,
    /// Requests during the history.
    operator: Operator,
    killed_at: Option<u64>,
    /// Time for which a service was absent, in half ticks.
    absent: u64,
    /// `false` once services were absent for longer than any vehicle survives.
    is_judged: bool,
    /// Speed downwards, m/s.
    sinking: f64,
    has_landed: bool,
    found: Option<String>,
}

impl Airborne<'_> {
    fn step(&mut self, present: &Present) {
        for (service, &is_present) in ServiceId::ALL.into_iter().zip(present) {
            let presence = match is_present {
                true => Presence::Present,
                false => Presence::Absent,
            };
            if self.flight.presence(service) != presence {
                self.flight.set_presence(service, presence);
            }
        }
        self.absent = if present.contains(&false) {
            self.absent + 2
        } else {
            self.absent.saturating_sub(1)
        };
        self.is_judged &= self.absent <= 2 * self.survived;
        let mut operator = self.flight.planned_operator();
        operator.land |= self.operator.land;
        operator.killed |= self.operator.killed;
        if let Err(found) = self.flight.step(operator) {
            self.found.get_or_insert(found.to_string());
        }
        self.watch(present);
    }

    fn watch(&mut self, present: &Present) {
        let Some(truth) = self.flight.newest_sample::<VehicleTruth>() else {
            return;
        };
        let (r, [x, y, z]) = (truth.world_from_body, truth.velocity_body);
        let is_on_the_ground = -truth.position_world[2] <= 1e-6;
        let at = (self.flight.next_tick() - self.base_tick) as f64 * 1e-3;
        let mut find = |what: String| {
            self.found
                .get_or_insert(format!("{what} {at:.3} s after the start"));
        };
        let may_fall = self.operator.killed || !self.is_judged;
        if is_on_the_ground && !self.has_landed && self.sinking > FALL && !may_fall {
            find(format!(
                "the vehicle has hit the ground at {:.1} m/s",
                self.sinking
            ));
        }
        if r[8] < UPRIGHT && !may_fall {
            find("the vehicle is tilted by more than 1 rad".to_owned());
        }
        if let Some(killed_at) = self.killed_at
            && self.flight.next_tick() > killed_at + self.killed_within
            && present[ServiceId::RcOutput.index()]
            && let Some(frame) = self.flight.newest_sample::<RcFrame>()
            && frame.header.tick > killed_at + self.killed_within
            && !frame.failsafe.is_set()
        {
            find("the motors turn after a kill".to_owned());
        }
        self.has_landed |= is_on_the_ground;
        self.sinking = r[6] * x + r[7] * y + r[8] * z;
    }
}

impl World for Airborne<'_> {
    fn advance_to(&mut self, tick: u64, present: &Present) {
        let end = (self.base_tick + tick).min(self.last_tick);
        while self.flight.next_tick() < end {
            self.step(present);
        }
    }

    fn replace(&mut self, service: ServiceId, _next_tick: u64) {
        self.flight.open_ports(service, Start::FromCheckpoint);
    }

    fn ask(&mut self, request: Request) {
        match request {
            Request::Arm => {}
            Request::Land => self.operator.land = true,
            Request::Kill => {
                self.operator.killed = true;
                self.killed_at.get_or_insert(self.flight.next_tick());
            }
        }
    }

    fn newest_frame(&self) -> Option<RcFrame> {
        let base_ns = self.base_tick * self.flight.schedule().tick_ns();
        let mut frame = *self.flight.newest_sample::<RcFrame>()?;
        frame.header.stamp_ns = frame.header.stamp_ns.saturating_sub(base_ns);
        Some(frame)
    }

    fn phase(&self) -> FlightPhase {
        let reference = self.flight.newest_sample::<PathReference>();
        reference.map_or(FlightPhase::Disarmed, |reference| {
            FlightPhase::from_code(reference.phase)
        })
    }

    fn longest_landing_ns(&self) -> u64 {
        // One that has fallen may never be seen to land.
        if self.is_judged { LANDING_NS } else { u64::MAX }
    }

    fn judge(&self) -> Result<(), String> {
        self.found.clone().map_or(Ok(()), Err)
    }
}
