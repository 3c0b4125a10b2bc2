//! A path that can be flown: a timing law that is defined and a curve that is smooth.

use super::Findings;
use super::events::Events;
use crate::{Circle, Curve, Hover, Key, Line, Lissajous, Path, TiltedEight, Vector, Waypoints};

impl Path {
    pub(super) fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        found.not_negative(&at.then("speed"), "vd", self.speed);
        found.positive(&at.then("k4"), "k4", self.k4);
        let alpha1_is_good = found.positive(&at.then("alpha1"), "α1", self.alpha1);
        let alpha2_is_good = found.positive(&at.then("alpha2"), "α2", self.alpha2);
        if alpha1_is_good && alpha2_is_good && self.alpha1 >= self.alpha2 {
            found.add(
                at.then("alpha1"),
                format!(
                    "α1 = {:?} m is not below α2 = {:?} m, so the path has no room to slow down in",
                    self.alpha1, self.alpha2
                ),
                "lower `alpha1` or raise `alpha2`; the paper uses 0.5 and 1.5",
            );
        }
        found.number(&at.then("initial_gamma"), self.initial_gamma);
        found.number(&at.then("initial_gamma_dot"), self.initial_gamma_dot);
        found.angle(&at.then("yaw"), self.yaw);
        self.check_yaw_steps(duration, &at.then("yaw_step"), found);
        self.curve.check(&at.then("curve"), found);
    }

    fn check_yaw_steps(&self, duration: f64, at: &Key, found: &mut Findings) {
        for (index, step) in self.yaw_step.iter().enumerate() {
            found.angle(&at.then(index).then("yaw"), step.yaw);
        }
        let steps = Events {
            one: "yaw step",
            several: "yaw steps",
            at: at.clone(),
            times: self.yaw_step.iter().map(|step| step.at).collect(),
        };
        steps.check(duration, found);
    }
}

impl Curve {
    fn check(&self, at: &Key, found: &mut Findings) {
        match self {
            Self::TiltedEight(eight) => eight.check(&at.then("tilted_eight"), found),
            Self::Hover(hover) => hover.check(&at.then("hover"), found),
            Self::Circle(circle) => circle.check(&at.then("circle"), found),
            Self::Line(line) => line.check(&at.then("line"), found),
            Self::Lissajous(figure) => figure.check(&at.then("lissajous"), found),
            Self::Waypoints(waypoints) => waypoints.check(&at.then("waypoints"), found),
        }
    }
}

impl Curve {
    /// Returns the key that states the curve's height, and the stated z, m; the lowest of several.
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

impl TiltedEight {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.positive(&at.then("size"), "ℓ", self.size);
        found.positive(&at.then("frequency"), "w", self.frequency);
        found.number(&at.then("height"), self.height);
        found.angle(&at.then("tilt"), self.tilt);
    }
}

impl Hover {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.vector(&at.then("position"), &self.position);
    }
}

impl Circle {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.vector(&at.then("center"), &self.center);
        found.positive(&at.then("radius"), "r", self.radius);
        found.positive(&at.then("frequency"), "w", self.frequency);
        found.angle(&at.then("tilt"), self.tilt);
    }
}

impl Line {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.vector(&at.then("start"), &self.start);
        let fix = "give a direction such as [1.0, 0.0, 0.0], or use `hover`";
        let direction = at.then("direction");
        found.direction(&direction, &self.direction, "the line has no direction", fix);
    }
}

impl Lissajous {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.vector(&at.then("center"), &self.center);
        found.vector(&at.then("amplitude"), &self.amplitude);
        found.vector(&at.then("frequency"), &self.frequency);
        found.vector(&at.then("phase"), &self.phase);
    }
}

impl Waypoints {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.positive(&at.then("interval"), "interval", self.interval);
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
        for (index, point) in self.points.iter().enumerate() {
            found.vector(&points.then(index), point);
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
                "the last point coincides with the first, to which a closed curve leads by itself",
                "leave the last point out",
            );
        }
    }
}
