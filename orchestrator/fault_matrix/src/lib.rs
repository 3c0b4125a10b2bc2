//! The fault matrix: every service and every edge of the wiring, every kind of fault, at several injection times.
//!
//! * [`fault_kind`]: kinds of faults and their parameters;
//! * [`injection_times`]: default injection times;
//! * [`plan`]: the cells, each with its scenario;
//! * [`flight`]: flies a cell; its result depends on its scenario alone;
//! * [`campaign`]: flies all cells, and resumes after an interrupt;
//! * [`undisturbed`]: the flight without a fault, as the reference of the verdicts;
//! * [`survival`]: the verdicts;
//! * [`report`], [`table`]: the report as JSON and as a table.

pub mod campaign;
pub mod fault_kind;
pub mod flight;
pub mod injection_times;
pub mod plan;
pub mod report;
pub mod survival;
pub mod table;
pub mod truth;
pub mod undisturbed;

/// Default duration of a fault, s: the last frame is still usable after this time, and no longer a little later.
pub const LASTS: f64 = 0.1;

/// Default time flown after a fault, s: two settling times of the control law.
pub const AFTER: f64 = 8.0;

/// Default number of injection times.
pub const MOMENTS: usize = 3;

/// Delay of late samples, s: more than twice the longest period of the laboratory.
pub const DELAY: f64 = 0.05;

/// Fraction of samples lost by an intermittent edge.
pub const FRACTION: f64 = 0.5;

/// Maximum magnitude of garbage in range, in m, m/s, rad/s or N: each number is plausible.
pub const RANGE: f64 = 10.0;

/// Maximum ratio of the vehicle's distance to the bound for the verdict "survived".
pub const SURVIVES: f64 = 1.5;

/// Half width of the window in which the undisturbed flight is compared, s: a fault may delay the vehicle's reaction to
/// planned changes.
pub const BESIDE: f64 = 0.5;
