//! Service `path_generator`: from the newest state to the reference of the same tick.
//!
//! At tick k its state is γₖ and γ̇ₖ, at which it evaluates curve and timing law. At the next step γ and γ̇ advance by
//! explicit Euler over the elapsed time: γₖ₊₁ = γₖ + hγ̇ₖ, γ̇ₖ₊₁ = γ̇ₖ + hγ̈ₖ.
//!
//! Failure policy: while the position of the vehicle is unknown, the path stands still: γ̇ = γ̈ = 0 from that step on, in
//! both modes, and the reference states it. When the position is known again, the timing law starts γ̇ from 0, as at the
//! start of a flight; trajectory tracking resumes at full speed.
//! * An impossible state is refused and counted ([`StateValidator`]); the last valid one remains in use.
//! * Without a policy the position is known while that state is `tracked`, at any age.
//! * With a policy it is known until the last valid tracked state is too old.
//!
//! In a flight with phases ([`crate::phases`]) γ is constant until the vehicle has reached the path, and after it has left
//! it.

use nalgebra::Vector3;
use scenario::{EdgeName, PathMode, Scenario};
use shared_types::input_validator::{
    GateState, InputValidator, LARGEST, StateGateState, StateValidator, Validity, is_of_the_past,
};
use shared_types::path_stop::{BRAKE_AFTER, Coasted};
use shared_types::samples::{PathReference, RcFrame, VehicleState};
use shared_types::service::{Input, nanoseconds};
use shared_types::wiring::{PathGeneratorInputs, PathGeneratorOutputs};
use shared_types::{FlightPhase, Now, Service, ServiceId, Topic};
use zerocopy::FromZeros;

use crate::bump::TransitionError;
use crate::curve::{Curve, CurveError, CurvePoint};
use crate::phases::{PathRateCommand, PhaseInput, Phases, PhasesMemory};
use crate::speed_profile::SpeedProfile;
use crate::timing_law::{PathRates, TimingLaw};

shared_types::sample! {
    /// State of the path generator between steps.
    pub struct PathGeneratorState {
        /// Place and rate of the path.
        pub motion: PathMotion,
        /// State of the input validator of states.
        pub states: StateGateState,
        /// The last good frame; all zero before the first, and in a flight without phases.
        pub frame: RcFrame,
        /// State of the input validator of frames.
        pub frames: GateState,
        /// State of the phases.
        pub phases: PhasesMemory,
    }

    /// Place of the path, and its rates.
    pub struct PathMotion {
        /// γ.
        pub gamma: f64,
        /// γ̇, 1/s.
        pub gamma_dot: f64,
        /// γ̈, 1/s².
        pub gamma_ddot: f64,
    }
}

/// Errors of a scenario's path.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(transparent)]
pub enum PathGeneratorError {
    /// The parameters of the curve are invalid.
    Curve(#[from] CurveError),
    /// α1 and α2 are invalid.
    Transition(#[from] TransitionError),
}

/// Law of γ̇.
#[derive(Clone, Copy, Debug)]
enum ParameterLaw {
    /// The path waits for the vehicle.
    TimingLaw(TimingLaw),
    /// The path does not wait: γ̇ = vd, 1/s.
    Trajectory { speed: f64 },
}

/// Step logic of the path generator.
#[derive(Clone, Debug)]
pub struct PathGeneratorService {
    states: StateValidator,
    /// Maximum age of a state without faults, ns.
    ordinary_age_ns: u64,
    /// Maximum time over which a step integrates, ns.
    longest_gap_ns: u64,
    /// Time between two steps above which the controller has moved the path, ns.
    ordinary_gap_ns: u64,
    /// Time for which the controller continues before its stop, s.
    goes_on_for: Option<f64>,
    generator: ReferenceGenerator,
    /// ψd (rad) with the tick from which it holds, in ascending order; the first one holds from the start.
    yaws: Vec<(u64, f64)>,
}

#[derive(Clone, Debug)]
struct ReferenceGenerator {
    curve: Curve,
    law: ParameterLaw,
    motion: PathMotion,
    /// `None` if the flight starts in the air.
    phases: Option<Phases>,
    /// Used only by the phases.
    frames: InputValidator<RcFrame>,
}

struct StepReference {
    point: CurvePoint,
    /// Parameter of the path or the segment.
    gamma: f64,
    rates: PathRates,
}

impl PathGeneratorService {
    /// Makes the path generator of a scenario, at the start of the flight.
    ///
    /// # Errors
    /// [`PathGeneratorError`] if the scenario's curve or timing law is not valid.
    pub fn new(scenario: &Scenario) -> Result<Self, PathGeneratorError> {
        let between_steps_ns = scenario.schedule().map_or(0, |schedule| {
            schedule.time_ns(schedule.service_rate(ServiceId::PathGenerator).period)
        });
        let path = &scenario.path;
        let curve = Curve::new(&path.curve)?;
        let generator = ReferenceGenerator {
            curve,
            law: ParameterLaw::new(path)?,
            motion: PathMotion {
                gamma: path.initial_gamma,
                gamma_dot: path.initial_gamma_dot,
                gamma_ddot: 0.0,
            },
            phases: Phases::new(scenario),
            frames: InputValidator::default(),
        };
        Ok(Self {
            generator,
            yaws: std::iter::once((0, path.yaw))
                .chain(
                    path.yaw_step
                        .iter()
                        .map(|step| (scenario.tick_of(step.at), step.yaw)),
                )
                .collect(),
            states: StateValidator::new(
                scenario
                    .safety_of(Topic::VehicleState, ServiceId::PathGenerator)
                    .map(scenario::InputSafety::policy),
            ),
            ordinary_age_ns: EdgeName::between(Topic::VehicleState, ServiceId::PathGenerator)
                .map_or(0, |edge| scenario.ordinary_age_ns(edge)),
            longest_gap_ns: scenario
                .safety_of(Topic::PathReference, ServiceId::Controller)
                .map_or(u64::MAX, |safety| {
                    nanoseconds(safety.max_age).max(between_steps_ns)
                }),
            ordinary_gap_ns: nanoseconds(BRAKE_AFTER).max(between_steps_ns),
            goes_on_for: scenario.path_continues_for(),
        })
    }

    /// Returns ψd at a step, rad.
    fn yaw_at(&self, now: &Now) -> f64 {
        let begun = self.yaws.partition_point(|(from, _)| *from <= now.tick);
        let phases = self.generator.phases.as_ref();
        self.yaws[begun.max(1) - 1].1 + phases.map_or(0.0, |phases| phases.yaw_test(now))
    }
}

impl ReferenceGenerator {
    /// Advances by the time since the last step.
    fn advance(&mut self, elapsed: f64) {
        self.motion.advance(elapsed);
        if let Some(phases) = &mut self.phases {
            phases.advance_segment(elapsed);
        }
    }

    /// Resumes from the position to which the controller has moved the path without references, `elapsed` s after the last
    /// one.
    fn coast(&mut self, now: &Now, elapsed: f64, goes_on_for: f64) {
        let coasted = self.motion.coast(elapsed, goes_on_for);
        if let Some(phases) = &mut self.phases {
            phases.coast(now, &coasted, elapsed, goes_on_for);
        }
    }

    /// Returns the reference on the path, by the timing law; it stands still while the vehicle's position is unknown.
    fn along_path(&mut self, vehicle: Option<&VehicleState>, profile: &SpeedProfile) -> StepReference {
        let point = self.curve.at(self.motion.gamma);
        let rates = match vehicle {
            Some(vehicle) => self.law.rates(vehicle, &point, self.motion.gamma_dot, profile),
            None => PathRates::steady(0.0),
        };
        self.motion.take(&rates);
        StepReference {
            point,
            gamma: self.motion.gamma,
            rates,
        }
    }

    /// Returns the reference, on the path or on a segment of the flight's phase. `state` is the last valid state, with its
    /// age in ns; it is also the state of the `vehicle` if the position is known.
    fn reference(
        &mut self,
        now: &Now,
        frame: &Input<'_, RcFrame>,
        vehicle: Option<&VehicleState>,
        state: Option<&VehicleState>,
        vehicle_age_ns: Option<u64>,
    ) -> StepReference {
        let Some(phases) = &mut self.phases else {
            return self.along_path(vehicle, &SpeedProfile::FULL);
        };
        self.frames.look(frame, LARGEST, |frame, _| {
            if frame.is_whole() && is_of_the_past(frame, now) {
                Validity::Good
            } else {
                Validity::Refused
            }
        });
        let path = self.curve.at(self.motion.gamma);
        let sight = PhaseInput {
            vehicle,
            state,
            vehicle_age_ns: vehicle_age_ns.unwrap_or(u64::MAX),
            frame: self.frames.held(),
            frame_age_ns: self.frames.age_ns(now).unwrap_or(u64::MAX),
            path: path.position,
            path_velocity: path.derivative1 * self.motion.gamma_dot,
            path_rates: [self.motion.gamma_dot, self.motion.gamma_ddot],
        };
        phases.advance(now, &sight);
        match phases.reference_source(now, vehicle.is_some()) {
            PathRateCommand::Path(profile) => self.along_path(vehicle, &profile),
            PathRateCommand::PathAt(rates) => {
                let rates = PathRates::stated(rates);
                self.motion.take(&rates);
                StepReference {
                    point: path,
                    gamma: self.motion.gamma,
                    rates,
                }
            }
            PathRateCommand::Line(point, gamma, rates) => {
                self.motion.take(&PathRates::steady(0.0));
                StepReference { point, gamma, rates }
            }
        }
    }

    fn phase(&self) -> FlightPhase {
        self.phases.as_ref().map_or(FlightPhase::Fly, Phases::phase)
    }

    fn cause(&self) -> u8 {
        self.phases
            .as_ref()
            .map_or(PathReference::CAUSE_NONE, Phases::cause)
    }

    fn is_airborne(&self) -> bool {
        self.phases.as_ref().is_none_or(Phases::is_airborne)
    }
}

impl ParameterLaw {
    fn new(path: &scenario::Path) -> Result<Self, TransitionError> {
        Ok(match path.mode {
            PathMode::Following => Self::TimingLaw(TimingLaw::new(path)?),
            PathMode::TrajectoryTracking => Self::Trajectory { speed: path.speed },
        })
    }

    /// Returns the rates of γ for the vehicle at `vehicle` and the path at `point`.
    fn rates(
        &self,
        vehicle: &VehicleState,
        point: &CurvePoint,
        gamma_dot: f64,
        profile: &SpeedProfile,
    ) -> PathRates {
        match self {
            Self::TimingLaw(law) => {
                let p = Vector3::from(vehicle.position_world);
                let p_dot = vehicle.velocity_world();
                let z1 = p - point.position; // (7)
                let z1_dot = p_dot - point.derivative1 * gamma_dot;
                law.paced(profile, &z1, &z1_dot, gamma_dot)
            }
            Self::Trajectory { speed } => {
                PathRates::stated([profile.value, profile.rate, profile.acceleration].map(|w| w * speed))
            }
        }
    }
}

impl PathMotion {
    /// Steps by explicit Euler over `h` seconds.
    fn advance(&mut self, h: f64) {
        self.gamma += h * self.gamma_dot;
        self.gamma_dot += h * self.gamma_ddot;
    }

    /// Moves as the controller without references has moved it.
    fn coast(&mut self, elapsed: f64, goes_on_for: f64) -> Coasted {
        let coasted = Coasted::after(elapsed, [self.gamma_dot, self.gamma_ddot], goes_on_for);
        self.gamma += coasted.way;
        [self.gamma_dot, self.gamma_ddot, _] = coasted.rates;
        coasted
    }

    fn take(&mut self, rates: &PathRates) {
        self.gamma_dot = rates.gamma_dot;
        self.gamma_ddot = rates.gamma_ddot;
    }
}

impl Service for PathGeneratorService {
    const ID: ServiceId = ServiceId::PathGenerator;
    type Inputs<'a> = PathGeneratorInputs<'a>;
    type Outputs<'a> = PathGeneratorOutputs<'a>;
    type State = PathGeneratorState;

    fn step(&mut self, now: &Now, inputs: &Self::Inputs<'_>, outputs: &mut Self::Outputs<'_>) {
        let elapsed = now.elapsed();
        let gap = self.goes_on_for.filter(|_| now.elapsed_ns > self.ordinary_gap_ns);
        let now = &Now {
            elapsed_ns: now.elapsed_ns.min(self.longest_gap_ns),
            ..*now
        };
        match gap {
            Some(goes_on_for) => self.generator.coast(now, elapsed, goes_on_for),
            None => self.generator.advance(elapsed),
        }
        self.states.look(now, &inputs.state);
        let newest = self.states.held();
        let age_ns = self.states.age_ns(now);
        let known = newest.filter(|vehicle| vehicle.tracked.is_set() && !self.states.is_too_old(now));
        let StepReference { point, gamma, rates } =
            self.generator
                .reference(now, &inputs.frame, known, newest, age_ns);
        // The path does not wait for a late state.
        let late_ns = age_ns.unwrap_or(0).saturating_sub(self.ordinary_age_ns);
        if let Some(reference) = outputs.reference.due() {
            *reference = PathReference {
                header: reference.header,
                reference_time_ns: newest.map_or(now.time_ns, |vehicle| {
                    vehicle.state_time_ns.saturating_add(late_ns)
                }),
                gamma,
                gamma_dot: rates.gamma_dot,
                gamma_ddot: rates.gamma_ddot,
                gamma_dot_desired: rates.gamma_dot_desired,
                gamma_dddot_constant: rates.gamma_dddot_constant,
                gamma_dddot_slope: rates.gamma_dddot_slope,
                position_world: point.position.into(),
                derivative1_world: point.derivative1.into(),
                derivative2_world: point.derivative2.into(),
                derivative3_world: point.derivative3.into(),
                yaw: self.yaw_at(now),
                yaw_rate: 0.0,
                states_refused: self.states.refused(),
                vehicle_known: known.is_some().into(),
                phase: self.generator.phase().code(),
                airborne: self.generator.is_airborne().into(),
                cause: self.generator.cause(),
            };
        }
    }

    fn save(&self) -> PathGeneratorState {
        let (frames, frame) = self.generator.frames.save();
        PathGeneratorState {
            motion: self.generator.motion,
            states: self.states.save(),
            frame,
            frames,
            phases: self
                .generator
                .phases
                .as_ref()
                .map_or_else(PhasesMemory::new_zeroed, |phases| phases.persistent),
        }
    }

    fn restore(&mut self, state: &PathGeneratorState) {
        self.generator.motion = state.motion;
        self.states.restore(&state.states);
        self.generator.frames.restore(&state.frames, &state.frame);
        if let Some(phases) = &mut self.generator.phases {
            phases.persistent = state.phases;
        }
    }
}
