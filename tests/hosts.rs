//! Promises of the step logic that only all services together can show.

mod common;

use std::convert::Infallible;
use std::ops::ControlFlow;

use orchestrator::log::LogDigest;
use orchestrator::{scenario_file, services};
use runtime::in_process::{InProcess, TickSink};
use shared_types::scenario::Scenario;
use shared_types::{ServiceId, Topic};

fn host(scenario: &Scenario) -> InProcess {
    InProcess::new(
        scenario.schedule().unwrap(),
        services::build_all(scenario).unwrap(),
    )
}

fn short_fig1() -> Scenario {
    let sets = [
        "duration=2.0".to_owned(),
        "vehicle.change=[{at = 1.0, mass = 0.245}]".to_owned(),
    ];
    scenario_file::load(&common::scenario("fig1"), &sets, None).unwrap()
}

/// Digests what is published and stops after every tick.
#[derive(Default)]
struct Stopping(LogDigest);

impl TickSink for Stopping {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.0.update(topic, bytes);
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Break(()))
    }
}

/// Flies tick by tick, doing something between ticks, to the digest of what was published.
fn digest(scenario: &Scenario, mut between: impl FnMut(&mut InProcess)) -> String {
    let mut host = host(scenario);
    let mut sink = Stopping::default();
    for _ in 0..=host.schedule().last_tick() {
        host.fly(&mut sink).unwrap();
        between(&mut host);
    }
    sink.0.finish()
}

/// A service keeps nothing beside what it saves: born anew after every tick, all fly on with the same bytes.
#[test]
fn services_have_no_hidden_state() {
    let scenario = short_fig1();
    let undisturbed = digest(&scenario, |_| {});
    let reborn = digest(&scenario, |host| {
        for service in ServiceId::ALL {
            let mut state = vec![0; host.service_mut(service).state_size()];
            host.service_mut(service).save(&mut state);
            let mut fresh = services::build(service, &scenario).unwrap();
            fresh.restore(&state);
            host.replace(fresh);
        }
    });
    assert_eq!(undisturbed, reborn);
}

mod allocations {
    #![expect(unsafe_code, reason = "a counting allocator is an allocator")]

    use std::alloc::{GlobalAlloc, Layout, System};
    use std::cell::Cell;

    thread_local! {
        static COUNT: Cell<u64> = const { Cell::new(0) };
    }

    /// Counts this thread's allocations.
    pub(crate) struct Counting;

    // SAFETY: hands everything to the system's allocator.
    unsafe impl GlobalAlloc for Counting {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            COUNT.set(COUNT.get() + 1);
            // SAFETY: the caller's promises are the same.
            unsafe { System.alloc(layout) }
        }

        unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
            // SAFETY: the caller's promises are the same.
            unsafe { System.dealloc(pointer, layout) }
        }
    }

    /// Allocations of this thread so far.
    pub(crate) fn count() -> u64 {
        COUNT.get()
    }
}

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

struct Nowhere;

impl TickSink for Nowhere {
    type Error = Infallible;

    fn sample(&mut self, _topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        std::hint::black_box(bytes);
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Continue(()))
    }
}

#[test]
fn a_flight_allocates_nothing_in_any_step() {
    let mut host = host(&short_fig1());
    let before = allocations::count();
    host.fly(&mut Nowhere).unwrap();
    assert_eq!(allocations::count() - before, 0);
    drop(std::hint::black_box(Box::new(0)));
    assert!(allocations::count() > before, "the allocator counts");
}
