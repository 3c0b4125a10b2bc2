//! Distance of the vehicle from its path, effort, and loss of the vehicle: one definition for the summary, the fault matrix,
//! the report, the plots and the reproduced figures, and for every controller.
//!
//! * [`path_clock`]: position of the path at any time;
//! * [`tracker`]: the vehicle and its path, by the truth, or by the estimator without a truth;
//! * [`stretch`]: metrics of a stretch of the flight;
//! * [`steady`]: the phases of the flight, each with a transient and a steady state;
//! * [`loss`]: loss of the vehicle;
//! * [`statistics`], [`percentiles`]: statistics of a stream of numbers in constant memory.
//!
//! No metric depends on outputs of a controller about itself. All are computed from samples in the order of the log, during
//! a flight or from its log, without allocation.

#![warn(missing_docs)]

pub mod loss;
pub mod path_clock;
pub mod percentiles;
pub mod response;
pub mod statistics;
pub mod steady;
pub mod stretch;
pub mod summary;
pub mod tracker;

use scenario::Scenario;
use shared_types::Sample;

/// Length of the end of a stretch that counts as its ultimate behaviour, s, as in the paper's figures.
pub const ULTIMATE_WINDOW: f64 = 5.0;

/// Distance from the path below which the vehicle counts as settled, m: 1.2 times the theorem's bound for the paper's gains.
pub const SETTLED: f64 = 0.02;

/// Confidence of the stated interval of an identified number.
pub const CONFIDENCE: f64 = 0.95;

/// Confidence of the interval outside of which a stated number differs from the identified one: a 95 % interval would miss
/// five of a hundred numbers by chance, and each would cause wrong advice. In half-widths of the stated interval it is 1.7
/// with many degrees of freedom, 2.3 with seven, 4 with three.
pub const CERTAIN: f64 = 0.999;

/// Copies a sample from bytes.
///
/// # Panics
/// If the bytes are those of another type.
#[inline]
pub fn read<T: Sample>(bytes: &[u8]) -> T {
    T::read_from_bytes(bytes).expect("hosts hand out samples of their topic")
}

/// Reads a sample in place, or a copy if its bytes are not aligned.
///
/// # Panics
/// If the bytes are those of another type.
#[inline]
pub fn view<T: Sample, R>(bytes: &[u8], act: impl FnOnce(&T) -> R) -> R {
    match T::ref_from_bytes(bytes) {
        Ok(sample) => act(sample),
        Err(_) => act(&read(bytes)),
    }
}

/// Returns the times at which a scenario changes the vehicle or the air, s.
pub fn changes(scenario: &Scenario) -> impl Iterator<Item = f64> {
    let vehicle = scenario.vehicle.change.iter().map(|change| change.at);
    let fan = scenario.vehicle.fan.iter();
    vehicle.chain(fan.flat_map(|fan| std::iter::once(fan.on_at).chain(fan.off_at)))
}

/// Returns the times of the planned events that are no faults and may move the vehicle or its estimate, s.
fn events_beside_faults(scenario: &Scenario) -> impl Iterator<Item = f64> {
    let gains = scenario.controller.change.iter().map(|change| change.at);
    let fan = scenario.vehicle.fan.iter();
    let fan = fan.flat_map(|fan| fan.moves.iter().map(|to| to.at));
    let yaw = scenario.path.yaw_step.iter().map(|step| step.at);
    let cameras = scenario.cameras.iter().flat_map(|cameras| {
        let hidden = cameras.occlusion.iter().map(|hidden| hidden.at);
        hidden.chain(cameras.marker_swap.iter().map(|swap| swap.at))
    });
    changes(scenario)
        .chain(gains)
        .chain(fan)
        .chain(yaw)
        .chain(cameras)
}
