//! Control laws compared with each other, in performance and in margin.
//!
//! Every law flies the same conditions with the same seeds, so that differences are to be read seed by seed. Beside the
//! error the grid has the second axis: how much of each disturbance a law survives, found by bisection with the same
//! seeds. Flights are in one process and functions of their scenario alone.
//!
//! * [`laws`]: the control laws;
//! * [`conditions`]: the conditions, and the quantities whose margin is searched;
//! * [`flights`]: the flights, and the results of a law in a condition;
//! * [`margins`]: the search for the largest value that a law survives;
//! * [`front`]: the laws that none beats in performance and margin;
//! * [`report`]: the results as tables, as JSON and as a page with a heat map.

pub mod conditions;
pub mod error;
pub mod flights;
pub mod front;
pub mod laws;
pub mod margins;
pub mod page;
pub mod report;

/// First of the seeds unless another is asked for; none of them was used for tuning.
pub const FIRST_SEED: u64 = 201;
