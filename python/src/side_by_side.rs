//! Flights side by side: one step of many simulations, on threads and without Python's lock.
//!
//! A flight depends on no other one, so the number of threads changes no bit of it. Observation and reward are computed
//! here for one flight and for many alike, so that a single environment and a vector of environments return equal numbers.

use std::sync::Mutex;

use flight::many;
use metrics::read;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use shared_types::Topic;
use shared_types::samples::{PathReference, VehicleState};

use crate::errors;
use crate::simulation::Simulation;

/// Numbers of an observation: position error, velocity error, R, Ω.
const NUMBERS: usize = 18;

/// A scenario that has been read and checked, to be flown with any seed.
#[pyclass(frozen, module = "gerono")]
pub(crate) struct PreparedScenario(pub(crate) scenario::Scenario);

/// Values at which the parts of an observation are 1.
#[derive(Clone, Copy, Debug)]
struct Scale {
    /// Position error, m.
    position: f64,
    /// Velocity error, m/s.
    velocity: f64,
    /// Angular velocity, rad/s.
    rate: f64,
}

impl From<(f64, f64, f64)> for Scale {
    fn from((position, velocity, rate): (f64, f64, f64)) -> Self {
        Self {
            position,
            velocity,
            rate,
        }
    }
}

/// Observations, rewards, times, whether the flight has ended, and whether the vehicle is lost: one row a flight.
type Views<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
);

/// Starts one flight for each scenario and seed.
#[pyfunction]
pub(crate) fn start_side_by_side(
    py: Python<'_>,
    prepared: Vec<Py<PreparedScenario>>,
    seeds: Vec<u64>,
    threads: usize,
) -> PyResult<Vec<Simulation>> {
    let flights: Vec<_> = prepared.iter().map(Py::get).zip(seeds).collect();
    let start = |(prepared, seed): &(&PreparedScenario, u64)| {
        let mut scenario = prepared.0.clone();
        scenario.seed = *seed;
        Simulation::new(&scenario)
    };
    py.detach(|| match flights.len() {
        1 => vec![start(&flights[0])],
        number => many::map(&flights, threads.min(number), start),
    })
    .into_iter()
    .collect()
}

/// Flies one period of the controller in each flight for which `flies` is set, with its row of `commands`: thrust, N, and
/// torque, N m, or with `has_rates` body rates, rad/s.
#[pyfunction]
pub(crate) fn step_side_by_side(
    py: Python<'_>,
    simulations: Vec<Bound<'_, Simulation>>,
    commands: PyReadonlyArray2<'_, f64>,
    flies: PyReadonlyArray1<'_, bool>,
    has_rates: bool,
    threads: usize,
) -> PyResult<()> {
    if commands.shape() != [simulations.len(), 4] || flies.len() != simulations.len() {
        return Err(PyValueError::new_err("one command of 4 numbers for each flight"));
    }
    let (commands, flies) = (commands.as_slice()?, flies.as_slice()?);
    let mut borrowed = simulations
        .iter()
        .map(Bound::try_borrow_mut)
        .collect::<Result<Vec<_>, _>>()?;
    let rows = commands.as_chunks::<4>().0;
    let mut flights: Vec<(usize, &mut Simulation, &[f64; 4])> = borrowed
        .iter_mut()
        .zip(rows)
        .enumerate()
        .filter(|(index, _)| flies[*index])
        .map(|(index, (simulation, row))| (index, &mut **simulation, row))
        .collect();
    let failed = py.detach(|| {
        let first_failure: Mutex<Option<(usize, PyErr)>> = Mutex::new(None);
        let fly = |flights: &mut [(usize, &mut Simulation, &[f64; 4])]| {
            for (index, simulation, row) in flights {
                let [thrust, x, y, z] = **row;
                let (torque, rates) = if has_rates {
                    ([0.0; 3], [x, y, z])
                } else {
                    ([x, y, z], [0.0; 3])
                };
                if let Err(error) = simulation.fly_period(thrust, torque, rates) {
                    let mut first = first_failure
                        .lock()
                        .expect("no thread panics while it holds the lock");
                    if first.as_ref().is_none_or(|(before, _)| *index < *before) {
                        *first = Some((*index, error));
                    }
                }
            }
        };
        let share = flights.len().div_ceil(threads.max(1)).max(1);
        std::thread::scope(|scope| {
            let mut shares = flights.chunks_mut(share);
            let own = shares.next();
            for share in shares {
                scope.spawn(|| fly(share));
            }
            own.map(fly);
        });
        first_failure
            .into_inner()
            .expect("no thread panics while it holds the lock")
    });
    match failed {
        Some((index, error)) if rows.len() > 1 => Err(errors::other(format!("environment {index}: {error}"))),
        Some((_, error)) => Err(error),
        None => Ok(()),
    }
}

/// Returns observation, reward, time and end of each flight.
#[pyfunction]
pub(crate) fn view_side_by_side<'py>(
    py: Python<'py>,
    simulations: Vec<Bound<'py, Simulation>>,
    scale: (f64, f64, f64),
) -> PyResult<Views<'py>> {
    let scale = Scale::from(scale);
    let number = simulations.len();
    let mut observations = Vec::with_capacity(number * NUMBERS);
    let (mut rewards, mut times) = (Vec::with_capacity(number), Vec::with_capacity(number));
    let (mut done, mut lost) = (Vec::with_capacity(number), Vec::with_capacity(number));
    for simulation in simulations {
        let mut simulation = simulation.try_borrow_mut()?;
        let state: Option<VehicleState> = simulation.newest(Topic::VehicleState).map(read);
        let reference: Option<PathReference> = simulation.newest(Topic::PathReference).map(read);
        let (observation, reward) = match (state, reference) {
            (Some(state), Some(reference)) => observe(&state, &reference, scale),
            _ => ([0.0; NUMBERS], 0.0),
        };
        observations.extend_from_slice(&observation);
        rewards.push(reward);
        times.push(simulation.time());
        done.push(simulation.done());
        lost.push(simulation.is_lost());
    }
    Ok((
        PyArray1::from_vec(py, observations).reshape([number, NUMBERS])?,
        PyArray1::from_vec(py, rewards),
        PyArray1::from_vec(py, times),
        PyArray1::from_vec(py, done),
        PyArray1::from_vec(py, lost),
    ))
}

/// Returns the observation of the samples of a state and a reference.
#[pyfunction]
pub(crate) fn observe_samples<'py>(
    py: Python<'py>,
    state: &[u8],
    reference: &[u8],
    scale: (f64, f64, f64),
) -> Bound<'py, PyArray1<f64>> {
    let (observation, _) = observe(&read(state), &read(reference), scale.into());
    PyArray1::from_slice(py, &observation)
}

/// Returns the observation, within ±1, and the reward: 1 on the path, 0 from `scale.position` on.
fn observe(state: &VehicleState, reference: &PathReference, scale: Scale) -> ([f64; NUMBERS], f64) {
    let mut observation = [0.0; NUMBERS];
    let velocity_world = state.velocity_world();
    let mut squares = 0.0;
    for axis in 0..3 {
        let z1 = state.position_world[axis] - reference.position_world[axis];
        squares += z1 * z1;
        let along_the_path = reference.derivative1_world[axis] * reference.gamma_dot;
        observation[axis] = z1 / scale.position;
        observation[3 + axis] = (velocity_world[axis] - along_the_path) / scale.velocity;
        observation[15 + axis] = state.angular_velocity_body[axis] / scale.rate;
    }
    observation[6..15].copy_from_slice(&state.world_from_body);
    let distance = squares.sqrt();
    (
        observation.map(|number| number.clamp(-1.0, 1.0)),
        1.0 - (distance / scale.position).min(1.0),
    )
}
