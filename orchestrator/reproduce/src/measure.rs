//! Results of a flight, measured against the truth during the flight, in fixed memory.
//!
//! The error is the distance from the path of [`metrics`] at every tick. The controller's z1 is not used: it is based on the
//! estimated position.

use std::convert::Infallible;

use control_law::yaw::shorter_way;
use host::in_process::TickSink;
use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::rotation::{from_row_major, roll_pitch_yaw};
use shared_types::samples::{ControlAdaptation, RcFrame, VehicleTruth};
use shared_types::{Schedule, Topic};

use super::latest::{Known, Latest};
use super::windows::{JUDGED, Windows};
use metrics::loss::{Loss, LossWatch};
use metrics::path_clock::Demand;
use metrics::read;
use metrics::statistics::Statistics;
use metrics::steady::PhaseParts;
use metrics::stretch::Metrics;
use metrics::tracker::StateSource;
use serde::{Deserialize, Serialize};

/// Results of a flight, in SI units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// ‖p − pd(γ)‖ in the judged part, m.
    pub error: Statistics,
    /// ‖p − pd(γ)‖ before the first event, m.
    pub error_before: Statistics,
    /// ‖p − pd(γ)‖ in the ultimate window, m.
    pub error_ultimate: Statistics,
    /// ‖p − pd(γ)‖ from the first event to the judged part, m.
    pub error_transient: Statistics,
    /// Transient of the last phase between changes of the vehicle, as in summaries.
    pub transient: Option<Metrics>,
    /// Steady state of the last phase.
    pub steady: Option<Metrics>,
    /// ‖p − pd(γ)‖ while the yaw settles after a step, m.
    pub error_while_yawing: Statistics,
    /// ‖p − pd(γ)‖ over the whole flight, m.
    pub error_ever: Statistics,
    /// Advance of γ in the judged part, as a share of vd times its duration.
    pub progress: f64,
    /// ψ − ψd once the yaw has settled, rad.
    pub yaw_error: Statistics,
    /// Roll in the averaged part, rad.
    pub roll: Statistics,
    /// True b in {I} in the averaged part, by components, m/s².
    pub disturbance: [Statistics; 3],
    /// π(b̂) in the averaged part, by components, m/s².
    pub disturbance_estimate: [Statistics; 3],
    /// m̂ in the judged part, kg.
    pub mass_estimate: Statistics,
    /// m̂ − m in the judged part, kg.
    pub mass_error: Statistics,
    /// The observer's m̂ − m in the judged part, kg; empty without an observer.
    pub observer_mass_error: Statistics,
    /// The vehicle's thrust over the whole flight, N.
    pub thrust: Statistics,
    /// ‖ω‖ of the vehicle over the whole flight, rad/s.
    pub rate_ever: Statistics,
    /// ‖ω‖ of the vehicle in the judged part, rad/s.
    pub rate: Statistics,
    /// Frames in which a limit of the radio link changed the controller's command.
    pub saturated_frames: u64,
}

/// Measures a flight.
#[derive(Clone, Debug)]
pub struct Meter {
    windows: Windows,
    /// Advance of γ in the judged part if the path never waits.
    nominal_advance: f64,
    latest: Latest,
    loss: LossWatch,
    has_observer: bool,
    last_phase: PhaseParts,
    /// γ at the first and the last judged tick.
    judged_gamma: Option<(f64, f64)>,
    measured: Measured,
}

impl Meter {
    /// Starts the measurement of a flight of `scenario`, whose schedule is `schedule`.
    #[must_use]
    pub fn new(scenario: &Scenario, schedule: &Schedule) -> Self {
        Self {
            windows: Windows::new(scenario),
            nominal_advance: scenario.path.speed * JUDGED.min(scenario.duration),
            latest: Latest::new(schedule, scenario.flight.is_some()),
            loss: LossWatch::new(scenario, StateSource::of(schedule)),
            has_observer: scenario.controller.observer_gain.is_some(),
            last_phase: PhaseParts::all(scenario, schedule)
                .pop()
                .expect("a flight has a phase"),
            judged_gamma: None,
            measured: Measured::default(),
        }
    }

    /// Returns the results of the flight.
    ///
    /// # Errors
    /// The loss of the vehicle, if it was lost.
    pub fn finish(mut self) -> Result<Measured, Loss> {
        if let Some(known) = self.latest.last() {
            self.observe(&known);
        }
        if let Some(loss) = self.loss.loss() {
            return Err(loss.clone());
        }
        let advance = self.judged_gamma.map_or(f64::NAN, |(first, last)| last - first);
        Ok(Measured {
            progress: advance / self.nominal_advance,
            transient: self.last_phase.transient().finish(),
            steady: self.last_phase.steady().finish(),
            ..self.measured
        })
    }

    /// Records the samples of a moment.
    fn observe(&mut self, known: &Known) {
        let Known {
            moment,
            truth,
            adaptation,
        } = known;
        let tick = moment.vehicle.tick;
        self.loss.observe(moment);
        let [begin_tick, _] = self.last_phase.ticks();
        if tick >= begin_tick {
            self.last_phase.observe(moment);
        }
        self.measure_vehicle(tick, truth);
        if let (Some(demand), Some(error)) = (&moment.path, moment.distance) {
            self.measure_errors(tick, truth, demand, error);
        }
        if let Some(adaptation) = adaptation {
            self.measure_estimates(tick, truth, adaptation);
        }
    }

    /// Records the errors of a tick: the position error `error` (m) and the yaw error.
    fn measure_errors(&mut self, tick: u64, truth: &VehicleTruth, demand: &Demand, error: f64) {
        let [_, _, yaw] = roll_pitch_yaw(&from_row_major(&truth.world_from_body));
        let (windows, measured) = (&self.windows, &mut self.measured);

        measured.error_ever.add(error);
        if windows.judged.contains(&tick) {
            measured.error.add(error);
            let first = self.judged_gamma.map_or(demand.gamma, |(first, _)| first);
            self.judged_gamma = Some((first, demand.gamma));
        }
        if windows.ultimate.contains(&tick) {
            measured.error_ultimate.add(error);
        }
        if windows.before.as_ref().is_some_and(|part| part.contains(&tick)) {
            measured.error_before.add(error);
        }
        if windows
            .transient
            .as_ref()
            .is_some_and(|part| part.contains(&tick))
        {
            measured.error_transient.add(error);
        }
        if windows.yaw_is_stepping(tick) {
            measured.error_while_yawing.add(error);
        }
        if windows.yaw_is_steady(tick) {
            measured.yaw_error.add(shorter_way(yaw - demand.yaw));
        }
    }

    /// Records thrust, rates, roll and disturbance, which do not depend on the path.
    fn measure_vehicle(&mut self, tick: u64, truth: &VehicleTruth) {
        let (windows, measured) = (&self.windows, &mut self.measured);
        let rate = Vector3::from(truth.angular_velocity_body).norm();
        measured.thrust.add(truth.thrust);
        measured.rate_ever.add(rate);
        if windows.judged.contains(&tick) {
            measured.rate.add(rate);
        }
        if windows.averaged.contains(&tick) {
            let [roll, ..] = roll_pitch_yaw(&from_row_major(&truth.world_from_body));
            measured.roll.add(roll);
            add_each(&mut measured.disturbance, &truth.disturbance_world);
        }
    }

    /// Records the controller's estimates and their errors.
    fn measure_estimates(&mut self, tick: u64, truth: &VehicleTruth, adaptation: &ControlAdaptation) {
        let (windows, measured) = (&self.windows, &mut self.measured);
        if windows.judged.contains(&tick) {
            measured.mass_estimate.add(adaptation.mass_estimate);
            measured.mass_error.add(adaptation.mass_estimate - truth.mass);
            if self.has_observer {
                let error = adaptation.observer_mass_estimate - truth.mass;
                measured.observer_mass_error.add(error);
            }
        }
        if windows.averaged.contains(&tick) {
            let estimate = &adaptation.disturbance_projected_world;
            add_each(&mut measured.disturbance_estimate, estimate);
        }
    }
}

impl TickSink for Meter {
    type Error = Infallible;

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        if let Some(known) = self.latest.observe(topic, bytes) {
            self.observe(&known);
        }
        if topic == Topic::RcFrame {
            let is_saturated = read::<RcFrame>(bytes).saturated.is_set();
            self.measured.saturated_frames += u64::from(is_saturated);
        }
        Ok(())
    }
}

fn add_each(statistics: &mut [Statistics; 3], values: &[f64; 3]) {
    for (statistics, value) in statistics.iter_mut().zip(values) {
        statistics.add(*value);
    }
}

#[cfg(test)]
mod tests;
