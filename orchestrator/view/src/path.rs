//! The path of a scenario as points, drawn before it is flown.

use std::f64::consts::TAU;

use path_generator::Curve;
use scenario::Scenario;

/// Number of segments of the path.
const POINTS: u32 = 400;

/// Turns of the slowest axis after which a Lissajous figure is drawn completely.
const TURNS: f64 = 8.0;

/// Returns points of the path in {I}, m: one turn of a closed curve, otherwise as far as the flight can reach.
#[must_use]
pub fn points(scenario: &Scenario) -> Vec<[f32; 3]> {
    let Ok(curve) = Curve::new(&scenario.path.curve) else {
        return Vec::new();
    };
    let begin = scenario.path.initial_gamma;
    let step = length(scenario) / f64::from(POINTS);
    let point = |index: u32| {
        let position = curve.at(begin + f64::from(index) * step).position;
        [position.x as f32, position.y as f32, position.z as f32]
    };
    let count = if step > 0.0 { POINTS } else { 0 };
    (0..=count).map(point).collect()
}

/// Returns the drawn length in γ.
fn length(scenario: &Scenario) -> f64 {
    let path = &scenario.path;
    let flown = path.speed.abs() * scenario.duration;
    let turn = |frequency: f64| {
        if frequency == 0.0 {
            0.0
        } else {
            TAU / frequency.abs()
        }
    };
    match &path.curve {
        scenario::Curve::TiltedEight(eight) => turn(eight.frequency),
        scenario::Curve::Circle(circle) => turn(circle.frequency),
        scenario::Curve::Hover(_) => 0.0,
        scenario::Curve::Line(_) => flown,
        scenario::Curve::Lissajous(figure) => {
            let slowest = figure.frequency.map(turn).into_iter().fold(0.0, f64::max);
            (TURNS * slowest).min(flown)
        }
        scenario::Curve::Waypoints(way) => {
            let legs = way.points.len() - usize::from(!way.closed);
            way.interval * legs as f64
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario;

    fn distance(from: [f32; 3], to: [f32; 3]) -> f32 {
        let square = |axis: usize| (from[axis] - to[axis]) * (from[axis] - to[axis]);
        (0..3).map(square).sum::<f32>().sqrt()
    }

    #[test]
    fn a_closed_path_is_drawn_once_around() {
        let mut flown = scenario(0.001, 1000.0);
        flown.path.curve = scenario::Curve::TiltedEight(scenario::TiltedEight::default());
        let points = points(&flown);
        assert_eq!(points.len() as u32, POINTS + 1);
        assert!(distance(points[0], points[POINTS as usize]) < 1e-5);
        assert!(points.windows(2).all(|pair| distance(pair[0], pair[1]) < 0.05));
    }

    #[test]
    fn a_line_is_drawn_as_far_as_it_can_be_flown_and_a_hover_is_a_point() {
        let mut flown = scenario(0.001, 10.0);
        flown.path.speed = 0.5;
        flown.path.curve = scenario::Curve::Line(scenario::Line {
            start: [0.0, 0.0, -1.0],
            direction: [1.0, 0.0, 0.0],
        });
        let [last_x, ..] = *points(&flown).last().unwrap();
        assert!((last_x - 5.0).abs() < 1e-5, "{last_x}");
        flown.path.curve = scenario::Curve::Hover(scenario::Hover {
            position: [0.0, 0.0, -1.5],
        });
        assert_eq!(points(&flown), [[0.0, 0.0, -1.5]]);
    }
}
