//! Simulator of everything around the supervisor's decisions: processes that start, step, hang, lie and die; a machine that
//! is slow; an operator; and the supervisor's own loop, which may be late.
//!
//! A [`History`] determines everything: there is no clock and no process. [`course_of`] flies it and checks the
//! [properties](properties::Property) at every event; [`shrink`](shrink::shrink) finds the shortest history that violates
//! the same one; [`campaign`] does this for many seeds.

pub mod campaign;
pub mod flights;
pub mod history;
mod machine;
pub mod properties;
mod random;
pub mod shrink;
pub mod simulation;
pub mod world;

pub use history::{FOR_EVER, Fault, FaultKind, History, Host, Setting, Target};
pub use machine::latency;
pub use simulation::{Course, Simulation};

use flights::Flights;
use world::NullWorld;

/// Flies a history over a vehicle without dynamics.
#[must_use]
pub fn course_of(history: &History, flights: &mut Flights, is_traced: bool) -> Course {
    let (scenario, schedule) = flights.of(history.setting);
    let world = NullWorld::new(schedule.tick_ns(), history.setting.has_phases);
    let simulation = Simulation::new(history, scenario, schedule, world);
    match is_traced {
        true => simulation.traced().run(),
        false => simulation.run(),
    }
}

/// Returns the shortest history that violates the same property as this one; `None` if it violates none.
#[must_use]
pub fn shortest(history: &History) -> Option<History> {
    let mut flights = Flights::default();
    let mut violated = |history: &History| {
        let violation = course_of(history, &mut flights, false).violation;
        violation.map(|violation| violation.property)
    };
    let property = violated(history)?;
    Some(shrink::shrink(history.clone(), property, violated))
}
