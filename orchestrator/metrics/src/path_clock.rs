//! Position of the path at any time, from references with separate times.
//!
//! A reference holds at the time of the state it was computed from, which may be a prediction. So references are queued
//! until their time. From then on γ moves by their γ̇ and γ̈, and the point by its derivatives in γ, until the time of the
//! next one.
//!
//! The path is that of `path/reference`, which includes the line of a take-off and the path of an external path generator.

use std::collections::VecDeque;

use scenario::Vector;
use shared_types::FlightPhase;
use shared_types::samples::PathReference;

/// Maximum time over which a reference is extrapolated, ns. Without a newer reference the path stands still after it.
///
/// On the paper's eight the error of the third-order polynomial in γ is 0.1 mm over this time, and 1e-7 m between two
/// references of the laboratory.
const CARRIED_NS: u64 = 200_000_000;

/// Maximum time of a reference ahead of its publication, ns. Predictions are some tens of milliseconds ahead; an external
/// program must not be able to grow the queue without limit.
const HORIZON_NS: u64 = 1_000_000_000;

/// Position of the path at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// pd in {I}, m.
    pub position_world: Vector,
    /// γ.
    pub gamma: f64,
    /// ψd, rad.
    pub yaw: f64,
    /// Phase of the flight, by the reference.
    pub phase: FlightPhase,
}

impl Demand {
    /// Returns the distance of a position from the point, m; `None` for numbers that are not finite.
    #[must_use]
    #[inline]
    pub fn distance(&self, position_world: &Vector) -> Option<f64> {
        let [x, y, z] = [0, 1, 2].map(|axis| position_world[axis] - self.position_world[axis]);
        Some((x * x + y * y + z * z).sqrt()).filter(|distance| distance.is_finite())
    }
}

/// Position of the path as a function of time, from all references in the order of their publication.
#[derive(Clone, Debug, Default)]
pub struct PathClock {
    /// The current reference, if its time has passed, and the future ones within a prediction. Whole samples, because copying
    /// a whole sample is cheaper than copying its fields.
    references: VecDeque<PathReference>,
    /// `true` if the first reference is the current one.
    has_begun: bool,
}

impl PathClock {
    /// Adds a reference.
    #[inline]
    pub fn observe(&mut self, reference: &PathReference) {
        self.references.push_back(*reference);
    }

    /// Returns the position at a time, which must not decrease; `None` before the first reference.
    #[inline]
    pub fn at(&mut self, time_ns: u64) -> Option<Demand> {
        while let Some(next) = self.references.get(usize::from(self.has_begun))
            && time_of(next) <= time_ns
        {
            if self.has_begun {
                self.references.pop_front();
            }
            self.has_begun = true;
        }
        let acting = self.references.front().filter(|_| self.has_begun);
        acting.map(|acting| carried(acting, time_ns))
    }
}

/// Returns the time at which a reference holds, ns.
#[inline]
fn time_of(reference: &PathReference) -> u64 {
    let latest = reference.header.stamp_ns.saturating_add(HORIZON_NS);
    reference.reference_time_ns.min(latest)
}

/// Extrapolates a reference to another time: γ by its derivatives, and pd by its Taylor polynomial in γ.
#[must_use]
#[inline]
pub fn carried(reference: &PathReference, time_ns: u64) -> Demand {
    let begin_ns = time_of(reference);
    let phase = FlightPhase::from_code(reference.phase);
    if time_ns == begin_ns {
        return Demand {
            position_world: reference.position_world,
            gamma: reference.gamma,
            yaw: reference.yaw,
            phase,
        };
    }
    // One of the two is zero.
    let [ahead_ns, behind_ns] = [time_ns.saturating_sub(begin_ns), begin_ns.saturating_sub(time_ns)]
        .map(|way_ns| way_ns.min(CARRIED_NS) as i64);
    let t = (ahead_ns - behind_ns) as f64 * 1e-9;
    let way = t * (reference.gamma_dot + 0.5 * t * reference.gamma_ddot);
    let [first, second, third] = [
        &reference.derivative1_world,
        &reference.derivative2_world,
        &reference.derivative3_world,
    ];
    Demand {
        position_world: [0, 1, 2].map(|axis| {
            let bend = second[axis] + way / 3.0 * third[axis];
            reference.position_world[axis] + way * (first[axis] + 0.5 * way * bend)
        }),
        gamma: reference.gamma + way,
        yaw: reference.yaw,
        phase,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use path_generator::Curve;
    use proptest::prelude::*;
    use scenario::TiltedEight;
    use zerocopy::FromZeros;

    fn reference(time_ms: u64, gamma: f64, gamma_dot: f64, gamma_ddot: f64) -> PathReference {
        PathReference {
            reference_time_ns: time_ms * 1_000_000,
            gamma,
            gamma_dot,
            gamma_ddot,
            yaw: gamma,
            ..PathReference::new_zeroed()
        }
    }

    #[test]
    fn there_is_no_path_before_the_time_of_the_first_reference() {
        let mut clock = PathClock::default();
        assert_eq!(clock.at(0), None);
        clock.observe(&reference(5, 1.0, 0.0, 0.0));
        assert_eq!(clock.at(4_999_999), None);
        let demand = clock.at(5_000_000).unwrap();
        assert_eq!((demand.gamma, demand.yaw), (1.0, 1.0));
    }

    #[test]
    fn gamma_moves_by_its_derivatives_until_the_time_of_the_next_reference() {
        let mut clock = PathClock::default();
        clock.observe(&reference(5, 1.0, 2.0, 100.0));
        // Published early: a prediction by more than a period.
        clock.observe(&reference(27, 9.0, 0.0, 0.0));
        clock.observe(&reference(49, 10.0, 0.0, 0.0));
        let just_before = clock.at(26_000_000).unwrap();
        assert!((just_before.gamma - (1.0 + 2.0 * 0.021 + 50.0 * 0.021 * 0.021)).abs() < 1e-14);
        assert_eq!(just_before.yaw, 1.0);
        assert_eq!(clock.at(27_000_000).unwrap().gamma, 9.0);
        assert_eq!(clock.at(60_000_000).unwrap().gamma, 10.0);
    }

    #[test]
    fn a_path_that_nothing_has_moved_for_a_while_stands() {
        let mut clock = PathClock::default();
        clock.observe(&reference(0, 0.0, 0.5, 0.0));
        assert!((clock.at(200_000_000).unwrap().gamma - 0.1).abs() < 1e-15);
        assert!((clock.at(9_000_000_000).unwrap().gamma - 0.1).abs() < 1e-15);
    }

    #[test]
    fn a_reference_that_speaks_of_the_end_of_time_holds_up_no_others() {
        let mut clock = PathClock::default();
        clock.observe(&PathReference {
            reference_time_ns: u64::MAX,
            ..reference(0, 1.0, 0.0, 0.0)
        });
        let mut next = reference(1_500, 2.0, 0.0, 0.0);
        next.header.stamp_ns = 1_500_000_000;
        clock.observe(&next);
        assert_eq!(clock.at(1_500_000_000).unwrap().gamma, 2.0);
    }

    proptest! {
        #[test]
        fn between_two_references_the_point_is_that_of_the_curve(
            gamma in 0.0..20.0f64, gamma_dot in 0.0..1.5f64, gamma_ddot in -1.0..1.0f64, ahead_ms in 0u64..27,
        ) {
            let curve = Curve::new(&scenario::Curve::TiltedEight(TiltedEight::default())).unwrap();
            let point = curve.at(gamma);
            let reference = PathReference {
                position_world: point.position.into(),
                derivative1_world: point.derivative1.into(),
                derivative2_world: point.derivative2.into(),
                derivative3_world: point.derivative3.into(),
                ..reference(0, gamma, gamma_dot, gamma_ddot)
            };
            let demand = carried(&reference, ahead_ms * 1_000_000);
            let exact = curve.at(demand.gamma).position;
            prop_assert!((Vector3::from(demand.position_world) - exact).norm() < 2e-7);
        }
    }
}
