//! The filter and PX4's EKF2 on the same samples: simulated flights, and PX4's own recorded flight.
//!
//!     inertial_navigation_ekf2 SEEDS [DATA]
//!
//! Prints tables; the status is 1 if the filter errs more than EKF2. DATA is the folder of EKF2's recorded flight.

mod recorded;
mod reference;
#[path = "../../tests/it/rig.rs"]
mod rig;
mod simulated;

use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let seeds = arguments.next().and_then(|word| word.parse().ok()).unwrap_or(3);
    let mut is_good = simulated::compare(seeds);
    if let Some(data) = arguments.next() {
        is_good &= recorded::compare(data.as_ref());
    }
    if is_good {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
