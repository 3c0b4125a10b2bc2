//! Checks of the path: timing law, yaw steps and curve.

use super::Findings;
use crate::{Curve, Key, Line, Path, Vector, Waypoints};

impl Path {
    pub(super) fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        if self.alpha1 >= self.alpha2 && found.are_in_range(at, &["alpha1", "alpha2"]) {
            found.add(
                at.then("alpha1"),
                format!(
                    "α1 = {:?} m is not below α2 = {:?} m, so the path has no room to slow down in",
                    self.alpha1, self.alpha2
                ),
                "lower `alpha1` or raise `alpha2`; the paper uses 0.5 and 1.5",
            );
        }
        let times: Vec<_> = self.yaw_step.iter().map(|step| step.at).collect();
        found.check_events(["yaw step", "yaw steps"], &at.then("yaw_step"), &times, duration);
        self.curve.check(&at.then("curve"), found);
    }
}

impl Curve {
    fn check(&self, at: &Key, found: &mut Findings) {
        match self {
            Self::Line(line) => line.check(&at.then("line"), found),
            Self::Waypoints(waypoints) => waypoints.check(&at.then("waypoints"), found),
            Self::TiltedEight(_) | Self::Hover(_) | Self::Circle(_) | Self::Lissajous(_) => {}
        }
    }

    /// Returns the key that states the curve's height, and the lowest stated z, m.
    pub(super) fn stated_depth(&self) -> (Key, f64) {
        let at = Key::root().then("path").then("curve");
        let z = |table: &str, name: &str, position: &Vector| (at.then(table).then(name), position[2]);
        match self {
            Self::TiltedEight(eight) => (at.then("tilted_eight").then("height"), -eight.height),
            Self::Hover(hover) => z("hover", "position", &hover.position),
            Self::Circle(circle) => z("circle", "center", &circle.center),
            Self::Line(line) => z("line", "start", &line.start),
            Self::Lissajous(figure) => z("lissajous", "center", &figure.center),
            Self::Waypoints(waypoints) => {
                let depths = waypoints.points.iter().map(|point| point[2]);
                (
                    at.then("waypoints").then("points"),
                    depths.fold(f64::NEG_INFINITY, f64::max),
                )
            }
        }
    }
}

impl Line {
    fn check(&self, at: &Key, found: &mut Findings) {
        let fix = "give a direction such as [1.0, 0.0, 0.0], or use `hover`";
        let direction = at.then("direction");
        found.direction(&direction, &self.direction, "the line has no direction", fix);
    }
}

impl Waypoints {
    fn check(&self, at: &Key, found: &mut Findings) {
        let points = at.then("points");
        let (least, kind) = if self.closed {
            (3, "a closed")
        } else {
            (2, "an open")
        };
        let count = self.points.len();
        if count < least {
            found.add(
                points.clone(),
                format!("{kind} curve through {count} points"),
                format!("give at least {least} points, or their `file`"),
            );
        }
        self.check_neighbours(&points, found);
    }

    fn check_neighbours(&self, at: &Key, found: &mut Findings) {
        for (index, pair) in self.points.windows(2).enumerate() {
            if Self::coincide(&pair[0], &pair[1]) {
                found.add(
                    at.then(index + 1),
                    format!("points {index} and {} coincide", index + 1),
                    "leave one of them out; stops are not part of a path",
                );
            }
        }
        if let [first, _, .., last] = self.points.as_slice()
            && self.closed
            && Self::coincide(last, first)
        {
            found.add(
                at.then(self.points.len() - 1),
                "the last point coincides with the first, to which a closed curve returns anyway",
                "leave the last point out",
            );
        }
    }
}
