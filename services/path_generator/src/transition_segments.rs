//! Transition segments: the straight lines between the ground and the path. Their parameter is time, s.

use nalgebra::Vector3;
use scenario::{STEEPEST, leg_duration};

use crate::curve::CurvePoint;
use crate::speed_profile::Step;

/// Maximum deceleration of a moving vehicle at the beginning of a segment, m/s².
const DECELERATION: f64 = 2.5;
/// Time in which a descent reaches full speed, s.
pub const DESCENT_BEGIN: f64 = 1.0;

/// Straight segment from one point to another, from rest to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// Start in {I}, m.
    pub from: Vector3<f64>,
    /// End in {I}, m.
    pub to: Vector3<f64>,
    /// Maximum speed, m/s.
    pub speed: f64,
}

impl Leg {
    #[must_use]
    pub fn duration(&self) -> f64 {
        leg_duration((self.to - self.from).norm(), self.speed)
    }

    /// Returns the point at a time, s.
    #[must_use]
    pub fn at(&self, time: f64) -> CurvePoint {
        let duration = self.duration();
        if time >= duration {
            return CurvePoint::at_rest(self.to);
        }
        let (way, rate) = (self.to - self.from, 1.0 / duration);
        let step = Step::at(time * rate);
        CurvePoint {
            position: self.from + way * step.value,
            derivative1: way * (step.slope * rate),
            derivative2: way * (step.curvature * rate * rate),
            derivative3: way * (step.third * rate * rate * rate),
            ..CurvePoint::at_rest(self.from)
        }
    }
}

/// Deceleration of a moving vehicle, superposed on the segment that begins at its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlowDown {
    /// Initial velocity of the vehicle in {I}, m/s.
    pub velocity: Vector3<f64>,
}

impl SlowDown {
    #[must_use]
    pub fn duration(&self) -> f64 {
        STEEPEST * self.velocity.norm() / DECELERATION
    }

    /// Returns the stopping distance, m.
    #[must_use]
    pub fn way(&self) -> Vector3<f64> {
        self.velocity * (0.5 * self.duration())
    }

    /// Returns a point of a segment shifted by the remaining stopping distance, `time` s after the beginning of both.
    #[must_use]
    pub fn before(&self, point: CurvePoint, time: f64) -> CurvePoint {
        let duration = self.duration();
        if time >= duration {
            return point;
        }
        let rate = 1.0 / duration;
        let step = Step::at(time * rate);
        let behind = time - duration * Step::integral(time * rate);
        CurvePoint {
            position: point.position + self.velocity * behind - self.way(),
            derivative1: point.derivative1 + self.velocity * (1.0 - step.value),
            derivative2: point.derivative2 - self.velocity * (step.slope * rate),
            derivative3: point.derivative3 - self.velocity * (step.curvature * rate * rate),
            ..point
        }
    }
}

/// Straight descent from a point, ended by the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descent {
    /// Start in {I}, m.
    pub from: Vector3<f64>,
    /// Speed after [`DESCENT_BEGIN`], m/s.
    pub speed: f64,
}

impl Descent {
    /// Returns the point at a time, s.
    #[must_use]
    pub fn at(&self, time: f64) -> CurvePoint {
        let (down, rate) = (Vector3::z() * self.speed, 1.0 / DESCENT_BEGIN);
        let step = Step::at(time * rate);
        CurvePoint {
            position: self.from + down * (DESCENT_BEGIN * Step::integral(time * rate)),
            derivative1: down * step.value,
            derivative2: down * (step.slope * rate),
            derivative3: down * (step.curvature * rate * rate),
            ..CurvePoint::at_rest(self.from)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn assert_derivatives(at: impl Fn(f64) -> CurvePoint, time: f64) -> Result<(), TestCaseError> {
        let h = 1e-4;
        let point = at(time);
        let slopes =
            |part: fn(&CurvePoint) -> Vector3<f64>| (part(&at(time + h)) - part(&at(time - h))) / (2.0 * h);
        for (got, wanted) in [
            (point.derivative1, slopes(|point| point.position)),
            (point.derivative2, slopes(|point| point.derivative1)),
            (point.derivative3, slopes(|point| point.derivative2)),
        ] {
            prop_assert!((got - wanted).norm() < 1e-4, "{} {}", got, wanted);
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn a_leg_keeps_to_its_speed_and_its_acceleration_and_is_smooth(
            to in [-3.0..3.0f64, -3.0..3.0f64, -3.0..3.0f64], speed in 0.1..2.0f64, share in 0.01..0.99f64,
        ) {
            let leg = Leg { from: Vector3::new(0.3, -0.2, 0.1), to: to.into(), speed };
            let time = share * leg.duration();
            let point = leg.at(time);
            prop_assert!(point.derivative1.norm() <= speed * (1.0 + 1e-9));
            prop_assert!(point.derivative2.norm() <= scenario::LEG_ACCELERATION * (1.0 + 1e-9));
            prop_assume!(leg.duration() > 0.5);
            assert_derivatives(|time| leg.at(time), time)?;
        }

        #[test]
        fn a_vehicle_that_is_met_in_motion_is_led_from_its_place_and_velocity_to_the_segment(
            velocity in [-2.0..2.0f64, -2.0..2.0f64, -2.0..2.0f64], share in 0.01..0.99f64,
        ) {
            let slow_down = SlowDown { velocity: velocity.into() };
            prop_assume!(slow_down.duration() > 0.5);
            let met = Vector3::new(0.3, -0.2, 0.1);
            let leg = Leg { from: met + slow_down.way(), to: Vector3::new(1.0, 2.0, -1.0), speed: 0.4 };
            let at = |time| slow_down.before(leg.at(time), time);
            let begin = at(0.0);
            prop_assert!((begin.position - met).norm() < 1e-12);
            prop_assert!((begin.derivative1 - slow_down.velocity).norm() < 1e-12);
            let time = share * slow_down.duration();
            assert_derivatives(at, time)?;
            let slowed = at(time).derivative2 - leg.at(time).derivative2;
            prop_assert!(slowed.norm() <= DECELERATION * (1.0 + 1e-9));
            let later = slow_down.duration() + share;
            prop_assert_eq!(at(later), leg.at(later));
        }

        #[test]
        fn a_descent_is_smooth_and_comes_to_its_speed(time in 0.01..3.0f64, speed in 0.1..1.0f64) {
            let descent = Descent { from: Vector3::new(1.0, 2.0, -3.0), speed };
            assert_derivatives(|time| descent.at(time), time)?;
            let later = descent.at(DESCENT_BEGIN + time);
            prop_assert_eq!(later.derivative1, Vector3::z() * speed);
            prop_assert_eq!(later.derivative2, Vector3::zeros());
        }
    }

    #[test]
    fn a_leg_begins_and_ends_at_rest_where_it_should() {
        let leg = Leg {
            from: Vector3::zeros(),
            to: Vector3::new(0.0, 0.0, -1.0),
            speed: 0.5,
        };
        assert_eq!(leg.at(0.0), CurvePoint::at_rest(leg.from));
        assert_eq!(leg.at(leg.duration()), CurvePoint::at_rest(leg.to));
        let nowhere = Leg { to: leg.from, ..leg };
        assert_eq!(
            (nowhere.duration(), nowhere.at(0.0)),
            (0.0, CurvePoint::at_rest(leg.from))
        );
    }
}
