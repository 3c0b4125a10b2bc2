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
pub mod vehicle;
pub mod world;

pub use history::{FOR_EVER, Fault, FaultKind, History, Host, Setting, Target};
pub use machine::latency;
pub use simulation::{Course, Simulation};

use flights::Flights;
use world::{NullWorld, World};

/// One history in so many has a vehicle in the air, if its setting permits: such a history takes a hundred times as long.
const FLOWN: u64 = 20;

/// Flies a history, over a vehicle in the air or over one without dynamics.
#[must_use]
pub fn course_of(history: &History, flights: &mut Flights, is_traced: bool) -> Course {
    let (scenario, schedule, vehicle) = flights.of(history.setting);
    if is_flown(history) {
        let world = vehicle.get_or_insert_default().begin();
        return course_over(Simulation::new(history, scenario, schedule, world), is_traced);
    }
    let world = NullWorld::new(schedule.tick_ns(), history.setting.has_phases);
    course_over(Simulation::new(history, scenario, schedule, world), is_traced)
}

fn course_over<W: World>(simulation: Simulation<'_, W>, is_traced: bool) -> Course {
    match is_traced {
        true => simulation.traced().run(),
        false => simulation.run(),
    }
}

/// Returns whether a history has a vehicle in the air: one of the ideal schedule that can land.
#[must_use]
pub fn is_flown(history: &History) -> bool {
    let setting = &history.setting;
    let permits = setting.host == Host::RealTime && setting.has_phases && !setting.is_slow;
    permits && setting.external.is_none() && history.seed.is_multiple_of(FLOWN)
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
