//! An own law in Rust sends the frames of the built-in one, to the bit: `geometric_pid` again, as
//! `tests/plugins/geometric_pid.c` has it.

use std::convert::Infallible;
use std::f64::consts::PI;

use host::in_process::{InProcess, TickSink};
use nalgebra::{Matrix3, Vector3};
use scenario::Scenario;
use shared_types::samples::ControlCommand;
use shared_types::service::ErasedService;
use shared_types::wiring::{ControllerInputs, ControllerOutputs};
use shared_types::{GRAVITY, Now, Service, ServiceId, Topic};

const KP: f64 = 36.0;
const KV: f64 = 12.0;
const KI: f64 = 18.0;
const KR: f64 = 39.24;
const LARGEST: f64 = 9.0;
const MASS: f64 = 0.2;
const STEP: f64 = 0.001;
const YAW_KP: f64 = 4.0;
const YAW_KI: f64 = 0.5;
const YAW_LARGEST: f64 = 0.5;

shared_types::sample! {
    /// State between two steps.
    pub struct Memory {
        /// Integral of the errors in {I}, m/s².
        pub integral: [f64; 3],
        /// ω of the hold before, rad/s.
        pub omega: [f64; 2],
        /// Integral term of the yaw law, rad/s.
        pub yaw_integral: f64,
    }
}

/// The law with its state.
struct GeometricPid(Memory);

impl Service for GeometricPid {
    const ID: ServiceId = ServiceId::Controller;
    type Inputs<'a> = ControllerInputs<'a>;
    type Outputs<'a> = ControllerOutputs<'a>;
    type State = Memory;

    fn step(&mut self, now: &Now, inputs: &ControllerInputs<'_>, outputs: &mut ControllerOutputs<'_>) {
        let (Some(state), Some(path)) = (inputs.state.newest(), inputs.reference.newest()) else {
            return;
        };
        let Some(command) = outputs.command.due() else {
            return;
        };
        let memory = &mut self.0;
        let elapsed = if now.elapsed_ns == 0 { STEP } else { now.elapsed() };
        let r = Matrix3::from_row_slice(&state.world_from_body);
        let n: Vector3<f64> = r.column(2).into();
        let (rate, turn) = (path.gamma_dot, path.gamma_ddot);
        let [d1, d2, d3] = [
            path.derivative1_world,
            path.derivative2_world,
            path.derivative3_world,
        ]
        .map(Vector3::from);
        let e = Vector3::from(state.position_world) - Vector3::from(path.position_world);
        let de = r * Vector3::from(state.velocity_body) - d1 * rate;
        let ahead = d2 * (rate * rate) + d1 * turn;
        let grown = Vector3::from(memory.integral) + (de + e * (2.0 * KP / KV)) * (KI * elapsed);
        let integral = grown.map(|component| component.clamp(-LARGEST, LARGEST));
        memory.integral = integral.into();
        let gravity = Vector3::z() * GRAVITY;
        let mut f = gravity - (ahead - de * KV - e * KP) + integral;
        let thrust = MASS * n.dot(&f);
        let jerk = d3 * (rate * rate * rate) + d2 * (3.0 * rate * turn) + d1 * path.gamma_dddot_constant;
        let mut df = -jerk + (gravity - n * (thrust / MASS) - ahead) * KV + de * KP;
        if f.z < 0.3 * GRAVITY {
            (f.z, df.z) = (0.3 * GRAVITY, 0.0);
        }
        let nd = f / f.norm();
        let dnd = (df - nd * nd.dot(&df)) / f.norm();
        let across = n.cross(&nd);
        let sine = across.norm();
        let share = if sine > 0.0 {
            libm::atan2(sine, n.dot(&nd)) / sine
        } else {
            0.0
        };
        let omega = r.tr_mul(&(across * share * KR + nd.cross(&dnd)));
        let yaw = libm::atan2(r[(1, 0)], r[(0, 0)]) - path.yaw;
        let yaw = yaw - 2.0 * PI * libm::rint(yaw / (2.0 * PI));
        let proportional = YAW_KP * yaw;
        // The mean over the hold; no negative zero.
        command.rates_body = [
            0.0 + (memory.omega[0] + omega.x) * 0.5,
            0.0 + (memory.omega[1] + omega.y) * 0.5,
            0.0 + (-proportional - memory.yaw_integral),
        ];
        (command.thrust, command.mode) = (thrust, ControlCommand::MODE_RATES);
        memory.omega = [omega.x, omega.y];
        if proportional.abs() <= YAW_LARGEST {
            memory.yaw_integral += YAW_KI * yaw * elapsed;
        }
        memory.yaw_integral = memory.yaw_integral.clamp(-YAW_LARGEST, YAW_LARGEST);
    }

    fn save(&self) -> Memory {
        self.0
    }

    fn restore(&mut self, state: &Memory) {
        self.0 = *state;
    }
}

/// Frames and true states, as bytes.
#[derive(Default)]
struct Samples(Vec<Vec<u8>>);

impl TickSink for Samples {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        if matches!(topic, Topic::RcFrame | Topic::VehicleTruth) {
            self.0.push(bytes.to_vec());
        }
        Ok(())
    }
}

#[test]
fn a_law_in_rust_sends_the_frames_of_the_built_in_one() {
    let text = include_str!("../../../tests/plugins/geometric_pid.toml");
    let scenario: Scenario = toml::from_str(text).expect("a scenario");
    let fly = |own: Option<Box<dyn ErasedService>>| {
        let mut services = registry::build_all(&scenario).expect("the services");
        if let Some(own) = own {
            services[ServiceId::Controller.index()] = own;
        }
        let mut samples = Samples::default();
        InProcess::new(scenario.schedule().expect("a schedule"), services)
            .fly(&mut samples)
            .expect("a flight");
        samples.0
    };
    let memory = Memory {
        integral: [0.0; 3],
        omega: [0.0; 2],
        yaw_integral: 0.0,
    };
    let expected = fly(None);
    assert_eq!(expected.len(), 20_002);
    assert!(fly(Some(Box::new(GeometricPid(memory)))) == expected);
}
