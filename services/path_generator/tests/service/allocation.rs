//! A step does not allocate, counted by the allocator itself.
#![expect(unsafe_code, reason = "a global allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use crate::flight::{generator, paper_path, step_at, vehicle};
use shared_types::scenario::{Circle, Curve, Hover, Line, Path, TiltedEight, Waypoints};

thread_local! {
    // Tests run side by side: each thread counts its own. Constant, so that counting does not allocate.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: all requests go on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing_on_any_curve() {
    let curves = [
        Curve::TiltedEight(TiltedEight::default()),
        Curve::Hover(Hover { position: [0.0; 3] }),
        Curve::Circle(Circle {
            center: [0.0; 3],
            radius: 1.0,
            frequency: 1.0,
            tilt: 0.1,
        }),
        Curve::Line(Line {
            start: [0.0; 3],
            direction: [1.0, 0.0, 0.0],
        }),
        Curve::Waypoints(Waypoints {
            points: vec![[0.0; 3], [1.0; 3], [0.0, 1.0, 2.0]],
            closed: true,
            interval: 0.1,
        }),
    ];
    for curve in curves {
        let before_construction = ALLOCATIONS.get();
        let mut generator = generator(Path {
            curve,
            ..paper_path()
        });
        let before = ALLOCATIONS.get();
        for tick in 0..2000 {
            let vehicle = vehicle([tick as f64 * 1e-3, 0.0, 0.0], [1.0, 0.0, 0.0]);
            step_at(&mut generator, tick, (tick % 7 > 0).then_some(&vehicle));
        }
        assert_eq!(ALLOCATIONS.get() - before, 0);
        drop(Box::new(before_construction));
        assert_eq!(ALLOCATIONS.get() - before, 1, "the allocator counts");
    }
}
