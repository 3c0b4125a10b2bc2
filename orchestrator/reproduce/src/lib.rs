//! Reproduction of the paper's figures: flown over many seeds in three laboratories, measured, judged and drawn.
//!
//! * [`mod@column`]: the laboratories: as stated, doubled, wrong model;
//! * [`figures`]: the flights and numbers of each figure, with acceptance limits;
//! * [`flight`]: flies them on all cores, each a function of its scenario alone;
//! * [`measure`], [`windows`], [`latest`]: measure the results during the flight;
//! * [`row`], [`known_gaps`], [`judgement`]: judge the results;
//! * [`observability`], [`ablation`]: observability of the mass; ablation of the design;
//! * [`table`], [`traces`], [`drawings`], [`canvas`], [`pages`], [`gallery`], [`log_figures`]: show the results;
//! * [`plan`]: the flights that all of this needs.

pub mod ablation;
pub mod canvas;
pub mod column;
pub mod drawings;
pub mod figures;
pub mod flight;
pub mod gallery;
pub mod judgement;
pub mod known_gaps;
pub mod latest;
pub mod log_figures;
pub mod measure;
pub mod observability;
pub mod pages;
pub mod plan;
pub mod row;
pub mod table;
pub mod traces;
pub mod windows;

/// The first seed flown. Gains were tuned on the seeds 1 to 6, which are not used here.
pub const FIRST_SEED: u64 = 101;

/// Default number of seeds.
pub const SEEDS: u64 = 20;

/// Number of seeds of the short list.
pub const QUICK_SEEDS: u64 = 2;

/// Returns `count` seeds from [`FIRST_SEED`] on.
#[must_use]
pub fn seeds(count: u64) -> Vec<u64> {
    (FIRST_SEED..FIRST_SEED + count).collect()
}
