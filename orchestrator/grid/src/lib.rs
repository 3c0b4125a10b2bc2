//! Comparison of control laws in performance and margin.
//!
//! Every law flies the same conditions with the same seeds, so that results compare seed by seed. Besides the error the grid
//! measures the margin: the largest value of each disturbance that a law survives, found by bisection with the same seeds.
//! Flights run in process and are functions of their scenario alone.
//!
//! * [`laws`]: the control laws;
//! * [`conditions`]: the conditions, and the quantities whose margin is searched;
//! * [`flights`]: the flights, and the results of a law in a condition;
//! * [`margins`]: the search for the largest value that a law survives;
//! * [`front`]: the Pareto front in performance and margin;
//! * [`report`]: the results as tables, as JSON and as a page with a heat map.

pub mod conditions;
pub mod error;
pub mod flights;
pub mod front;
pub mod laws;
pub mod margins;
pub mod page;
pub mod report;

/// Default first seed; seeds from it on were not used for tuning.
pub const FIRST_SEED: u64 = 201;
