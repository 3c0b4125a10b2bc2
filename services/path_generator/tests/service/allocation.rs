//! A step does not allocate, counted by the allocator itself.

use crate::allocations::allocations_during;
use crate::flight::{generator, paper_path, step_at, vehicle};
use scenario::{Circle, Curve, Hover, Line, Lissajous, Path, TiltedEight, Waypoints, YawStep};

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
        Curve::Lissajous(Lissajous {
            center: [0.0; 3],
            amplitude: [0.0, 0.0, 0.3],
            frequency: [0.0, 0.0, 4.0],
            phase: [0.0; 3],
        }),
        Curve::Waypoints(Waypoints {
            points: vec![[0.0; 3], [1.0; 3], [0.0, 1.0, 2.0]],
            closed: true,
            interval: 0.1,
            ..Waypoints::default()
        }),
    ];
    for curve in curves {
        let mut generator = generator(Path {
            curve,
            yaw_step: vec![YawStep { at: 1.0, yaw: 0.5 }],
            ..paper_path()
        });
        let count = allocations_during(|| {
            for tick in 0..2000 {
                let vehicle = vehicle([tick as f64 * 1e-3, 0.0, 0.0], [1.0, 0.0, 0.0]);
                step_at(&mut generator, tick, (tick % 7 > 0).then_some(&vehicle));
            }
        });
        assert_eq!(count, 0);
    }
}
