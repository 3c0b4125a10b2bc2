//! Path generator with a vehicle that follows its reference, for tests of the phases.

use path_generator::PathGeneratorService;
use scenario::{Flight, InputSafety, Path, Scenario};
use shared_types::samples::{PathReference, RcFrame, VehicleState};
use shared_types::service::{Now, Operator, Service};
use zerocopy::FromZeros;

use crate::flight::{TICK_NS, paper_path, scenario, step_in_phases, vehicle};
use crate::restart::restarted;

pub const H: f64 = 1e-3;

/// Place of the vehicle at the start, away from the begin of the path.
pub const PLACE: [f64; 3] = [0.5, 0.4, 0.1];

pub const ARMED: Operator = Operator::FLYING;

pub const DISARMED: Operator = Operator {
    armed: false,
    ..ARMED
};

pub const TO_LAND: Operator = Operator { land: true, ..ARMED };

/// A second request to arm.
pub const ARMED_AGAIN: Operator = Operator {
    arm_count: 2,
    ..ARMED
};

pub fn phased(path: Path) -> Scenario {
    Scenario {
        flight: Some(Flight::default()),
        ..scenario(path)
    }
}

/// Path generator with a vehicle that follows its reference exactly, except on the ground.
pub struct FlownPath {
    pub scenario: Scenario,
    pub generator: PathGeneratorService,
    pub tick: u64,
    pub vehicle: VehicleState,
    pub frame: RcFrame,
    pub reference: PathReference,
    /// `true` if the motors can lift it.
    pub lifts: bool,
    pub phases: Vec<u8>,
}

pub fn at_rest_on_the_ground() -> VehicleState {
    vehicle(PLACE, [0.0; 3])
}

pub fn idle_frame() -> RcFrame {
    RcFrame {
        inputs_fresh: true.into(),
        failsafe: true.into(),
        ..RcFrame::new_zeroed()
    }
}

impl FlownPath {
    pub fn new(path: Path) -> Self {
        let scenario = phased(path);
        Self {
            generator: PathGeneratorService::new(&scenario).unwrap(),
            scenario,
            tick: 0,
            vehicle: at_rest_on_the_ground(),
            frame: idle_frame(),
            reference: PathReference::new_zeroed(),
            lifts: true,
            phases: Vec::new(),
        }
    }

    pub fn eight() -> Self {
        Self::new(paper_path())
    }

    /// A path whose references may have this age, s: without newer ones it coasts.
    pub fn that_coasts(max_age: f64) -> Self {
        let mut flown = Self::eight();
        let policy = InputSafety::new(max_age);
        flown
            .scenario
            .safety
            .insert("path/reference -> controller".to_owned(), policy);
        flown.generator = PathGeneratorService::new(&flown.scenario).unwrap();
        flown
    }

    /// Makes one tick; the path generator is killed and restarted before it.
    pub fn step(&mut self, operator: Operator) -> PathReference {
        self.step_after(self.tick.min(1), operator)
    }

    /// Makes one tick, this many after the one before it.
    pub fn step_after(&mut self, ticks: u64, operator: Operator) -> PathReference {
        self.generator = restarted(
            &self.generator,
            PathGeneratorService::new(&self.scenario).unwrap(),
        );
        let now = Now {
            tick: self.tick,
            time_ns: self.tick * TICK_NS,
            elapsed_ns: ticks * TICK_NS,
            operator,
        };
        for header in [&mut self.vehicle.header, &mut self.frame.header] {
            (header.seq, header.stamp_ns) = (self.tick, now.time_ns);
        }
        let (state, frame) = (self.vehicle, self.frame);
        self.reference = step_in_phases(&mut self.generator, &now, Some(&state), Some(&frame));
        self.tick += 1;
        if self.phases.last() != Some(&self.reference.phase) {
            self.phases.push(self.reference.phase);
        }
        self.follow();
        self.reference
    }

    /// Moves the vehicle to its reference; on the ground it stands, and the law commands less thrust the deeper the
    /// reference is.
    pub fn follow(&mut self) {
        let reference = &self.reference;
        let is_led = reference.phase >= PathReference::PHASE_TAKE_OFF;
        let mut position = reference.position_world;
        let depth = position[2] - PLACE[2];
        self.frame.thrust = match (is_led, depth > 0.0) {
            (false, _) => 0.0,
            (true, false) => 2.0,
            (true, true) => 2.0 / (1.0 + 10.0 * depth),
        };
        self.frame.failsafe = (reference.phase == PathReference::PHASE_DISARMED).into();
        position[2] = position[2].min(PLACE[2]);
        if is_led && self.lifts {
            let [.., rise] = motion(reference)[1];
            self.vehicle.position_world = position;
            self.vehicle.velocity_body = [0.0, 0.0, if depth < 0.0 { rise } else { 0.0 }];
        }
    }

    pub fn until(&mut self, operator: Operator, phase: u8) {
        for _ in 0..60_000 {
            if self.step(operator).phase == phase {
                return;
            }
        }
        panic!("phase {phase} never comes: {:?}", self.phases);
    }

    pub fn for_seconds(&mut self, operator: Operator, seconds: f64) {
        for _ in 0..(seconds / H) as u64 {
            self.step(operator);
        }
    }

    pub fn gamma(&self) -> f64 {
        Service::save(&self.generator).motion.gamma
    }
}

/// Position, velocity and acceleration of a reference in {I}.
pub fn motion(reference: &PathReference) -> [[f64; 3]; 3] {
    let (rate, change) = (reference.gamma_dot, reference.gamma_ddot);
    let [first, second] = [reference.derivative1_world, reference.derivative2_world];
    [
        reference.position_world,
        first.map(|d| d * rate),
        std::array::from_fn(|axis| second[axis] * rate * rate + first[axis] * change),
    ]
}

pub fn speed(reference: &PathReference) -> f64 {
    distance(motion(reference)[1], [0.0; 3])
}

pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b) * (a - b))
        .sum::<f64>()
        .sqrt()
}
