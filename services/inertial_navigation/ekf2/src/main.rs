//! The filter and PX4's EKF2 on the same samples of simulated flights.
//!
//!     inertial_navigation_ekf2 SEEDS
//!
//! Prints a table; the status is 1 if the filter errs more than EKF2.

mod reference;
#[path = "../../tests/it/rig.rs"]
mod rig;
mod simulated;

use std::process::ExitCode;

fn main() -> ExitCode {
    let seeds = std::env::args().nth(1).and_then(|word| word.parse().ok());
    if simulated::compare(seeds.unwrap_or(3)) {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
