//! Data of a flight's drawings, collected during the flight: the extremes of every column of pixels.

use std::convert::Infallible;

use control_law::yaw::shorter_way;
use host::in_process::TickSink;
use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::rotation::{from_row_major, roll_pitch_yaw};
use shared_types::service::seconds;
use shared_types::{Schedule, Topic};

use super::latest::{Known, Latest};
use report::plot::COLUMNS;
use report::plot::downsample::Extremes;

/// Number of points of the trajectory.
const TRAJECTORY_POINTS: u64 = 2_000;

/// A quantity that is drawn over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// ‖p − pd(γ)‖, m.
    Error,
    /// m̂, kg.
    MassEstimate,
    /// |m̂ − m|, kg.
    MassError,
    /// |m̂ − m| of the observer, kg.
    ObserverMassError,
    /// m, kg.
    Mass,
    /// T, N.
    Thrust,
    /// ‖ω‖, rad/s.
    Rate,
    /// ωx, rad/s.
    RateX,
    /// ωy, rad/s.
    RateY,
    /// True by, m/s².
    DisturbanceY,
    /// π(b̂y), m/s².
    DisturbanceEstimateY,
    /// φ, rad.
    Roll,
    /// ψ, rad.
    Yaw,
    /// ψd, rad.
    YawDesired,
    /// ψ − ψd, rad.
    YawError,
}

const CHANNELS: usize = Channel::YawError as usize + 1;

/// Traces of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Traces {
    channels: Vec<Vec<(f64, f64)>>,
    /// p over the flight, m.
    pub positions: Vec<[f64; 3]>,
    /// pd over the flight, m.
    pub desired_positions: Vec<[f64; 3]>,
}

impl Traces {
    /// Returns the points of a channel: time, s, and value.
    #[must_use]
    pub fn channel(&self, channel: Channel) -> &[(f64, f64)] {
        &self.channels[channel as usize]
    }
}

/// Collects the traces of a flight.
pub struct Tracer {
    latest: Latest,
    /// Ticks between points of the trajectory.
    stride: u64,
    extremes: [Extremes; CHANNELS],
    positions: Vec<[f64; 3]>,
    desired_positions: Vec<[f64; 3]>,
}

impl Tracer {
    /// Starts the traces of a flight of `scenario`, whose schedule is `schedule`.
    #[must_use]
    pub fn new(scenario: &Scenario, schedule: &Schedule) -> Self {
        Self {
            latest: Latest::new(schedule, scenario.flight.is_some()),
            stride: (scenario.tick_of(scenario.duration) / TRAJECTORY_POINTS).max(1),
            extremes: std::array::from_fn(|_| Extremes::new(scenario.duration, COLUMNS)),
            positions: Vec::new(),
            desired_positions: Vec::new(),
        }
    }

    /// Returns the traces.
    #[must_use]
    pub fn finish(mut self) -> Traces {
        if let Some(known) = self.latest.last() {
            self.observe(&known);
        }
        Traces {
            channels: self.extremes.into_iter().map(Extremes::finish).collect(),
            positions: self.positions,
            desired_positions: self.desired_positions,
        }
    }

    fn observe(&mut self, known: &Known) {
        let Known {
            moment,
            truth,
            adaptation,
        } = known;
        let time = seconds(truth.header.stamp_ns);
        let extremes = &mut self.extremes;
        let mut add = |channel: Channel, value: f64| extremes[channel as usize].add(time, value);
        let omega = Vector3::from(truth.angular_velocity_body);
        let [roll, _, yaw] = roll_pitch_yaw(&from_row_major(&truth.world_from_body));
        add(Channel::Mass, truth.mass);
        add(Channel::Thrust, truth.thrust);
        add(Channel::Rate, omega.norm());
        add(Channel::RateX, omega.x);
        add(Channel::RateY, omega.y);
        add(Channel::DisturbanceY, truth.disturbance_world[1]);
        add(Channel::Roll, roll);
        add(Channel::Yaw, yaw);
        if let Some(adaptation) = adaptation {
            let estimate = adaptation.disturbance_projected_world[1];
            add(Channel::DisturbanceEstimateY, estimate);
            add(Channel::MassEstimate, adaptation.mass_estimate);
            add(Channel::MassError, (adaptation.mass_estimate - truth.mass).abs());
            add(
                Channel::ObserverMassError,
                (adaptation.observer_mass_estimate - truth.mass).abs(),
            );
        }
        if let (Some(demand), Some(distance)) = (&moment.path, moment.distance) {
            add(Channel::Error, distance);
            add(Channel::YawDesired, demand.yaw);
            add(Channel::YawError, shorter_way(yaw - demand.yaw));
            if moment.vehicle.tick.is_multiple_of(self.stride) {
                self.positions.push(truth.position_world);
                self.desired_positions.push(demand.position_world);
            }
        }
    }
}

impl TickSink for Tracer {
    type Error = Infallible;

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        if let Some(known) = self.latest.observe(topic, bytes) {
            self.observe(&known);
        }
        Ok(())
    }
}
