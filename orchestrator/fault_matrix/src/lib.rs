//! The fault matrix: every service and every edge of the wiring, every kind of fault, at several moments.
//!
//! * [`fault_kind`]: the kinds of faults and what is wrong with which topic;
//! * [`injection_times`]: when they begin, unless told;
//! * [`plan`]: the flights: a scenario for every cell;
//! * [`flight`]: flying them, each a function of its scenario alone;
//! * [`undisturbed`]: the flight without a fault, by which the others are judged;
//! * [`survival`]: judging them;
//! * [`report`], [`table`]: showing it.

pub mod fault_kind;
pub mod flight;
pub mod injection_times;
pub mod plan;
pub mod report;
pub mod survival;
pub mod table;
pub mod truth;
pub mod undisturbed;

/// Time for which a fault lasts unless told, s: after so long the last frame is still good enough, and a little later it is
/// not.
pub const LASTS: f64 = 0.1;

/// Time for which a cell is flown after its fault unless told, s: two settling times of the law.
pub const AFTER: f64 = 8.0;

/// The default number of moments.
pub const MOMENTS: usize = 3;

/// By how much samples are late with a delay, s: more than twice the longest period of the laboratory.
pub const DELAY: f64 = 0.05;

/// Share of the samples that are lost intermittently.
pub const FRACTION: f64 = 0.5;

/// Largest magnitude of garbage in range: each number could be true, in m, m/s, rad/s or N.
pub const RANGE: f64 = 10.0;

/// The largest ratio of the vehicle's distance to the bound, which it must come back to, for a fault to count as
/// survived.
pub const SURVIVES: f64 = 1.5;

/// The distance from a moment at which the undisturbed flight is looked at, s: a vehicle that a fault holds up meets
/// what the scenario plans a little later.
pub const BESIDE: f64 = 0.5;
