//! A flight of a sweep does not allocate during its ticks.

#[path = "../../../tests/common/allocations.rs"]
mod allocations;

use std::path::Path;

use ::flight::interrupt::Interrupt;
use sweep::definition::Source;
use sweep::flight;
use sweep::plan::Plan;

/// Returns the number of allocations in a judged flight of Fig. 1 of this duration.
fn allocations_of_a_flight(seconds: f64) -> u64 {
    let scenario_path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/fig1.toml");
    let scenario = std::fs::read_to_string(&scenario_path).unwrap();
    let text = format!(
        "scenario = \"fig1.toml\"\nsamples = 1\nset = [\"duration={seconds:?}\", \"vehicle.change=[]\"]\n\
         [vary]\n\"vehicle.mass\" = {{ uniform = [0.19, 0.21] }}\n"
    );
    let source = Source::new(Path::new("sweep.toml"), text, scenario_path, scenario).unwrap();
    let plan = Plan::new(source).unwrap();
    let (sample, entry) = (plan.sample(0), &plan.entries[0]);
    let fly = || {
        flight::fly(&plan, &sample, entry, &Interrupt::never())
            .unwrap()
            .unwrap()
    };
    // What is made once a process is there.
    fly();
    let mut steps = 0;
    let count = allocations::allocations_during(|| steps = fly().steps);
    assert!(steps as f64 >= 1000.0 * seconds);
    count
}

#[test]
fn a_longer_flight_allocates_no_more() {
    assert_eq!(allocations_of_a_flight(2.0), allocations_of_a_flight(12.0));
}
