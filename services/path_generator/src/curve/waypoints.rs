//! A smooth curve through points: a uniform quintic B-spline, hence C⁴, with five knots per interval.
//!
//! Every waypoint lies on a knot and has the five control points around it. At that knot the other control points have no
//! weight, so these five determine the position and four derivatives there. Hence
//! * the curve passes through a waypoint if its own five satisfy (c₋₂ + 26c₋₁ + 66c₀ + 26c₁ + c₂)/120 = P;
//! * it is at rest there, all four derivatives zero, if the five coincide, and can continue as a constant without loss of
//!   smoothness: so an open curve begins and ends.
//!
//! With one knot per interval a curve could not have both properties. The remaining freedom makes the curve as
//! smooth as possible, see [`smoothest`]; a closed one is then the periodic quintic interpolating spline of the
//! textbooks.
//!
//! Overshoot: for any ball that contains all waypoints, the distance of the curve from the centre is at most
//! [`Waypoints::OVERSHOOT_OPEN`] or [`Waypoints::OVERSHOOT_CLOSED`] times the radius. Between rest at two points the curve is
//! straight, at up to three times its mean speed.

mod smoothest;

use nalgebra::Vector3;

use super::{CurveError, CurvePoint};
use smoothest::control_points;

/// Knots per interval: one for the position and one for each of four derivatives.
const KNOTS_PER_INTERVAL: usize = 5;

/// Position and five derivatives by γ at a knot: the polynomial from there to the next knot.
type Piece = [Vector3<f64>; 6];

/// A curve through points, `interval` in γ from one to the next, the first at γ = 0.
///
/// An open curve rests at the first point before γ = 0 and at the last one after γ = (n − 1)·interval. A closed curve is
/// periodic.
#[derive(Clone, Debug, PartialEq)]
pub struct Waypoints {
    /// γ from one knot to the next.
    spacing: f64,
    closed: bool,
    /// Polynomial from each knot on; the last one of an open curve is constant.
    pieces: Vec<Piece>,
}

impl Waypoints {
    /// Maximum distance of an open curve from the centre of a ball that contains all waypoints, in radii.
    pub const OVERSHOOT_OPEN: f64 = 2.1;

    /// The same as [`Self::OVERSHOOT_OPEN`] for a closed curve.
    pub const OVERSHOOT_CLOSED: f64 = 1.85;

    /// Makes the curve through these points.
    ///
    /// # Errors
    /// [`CurveError`] if there are fewer than two points, or three for a closed curve, if two neighbours
    /// coincide, or if a number is not finite or the interval not positive.
    pub fn new(parameters: &scenario::Waypoints) -> Result<Self, CurveError> {
        check(parameters)?;
        let closed = parameters.closed;
        let points: Vec<_> = parameters.points.iter().copied().map(Vector3::from).collect();
        let spacing = parameters.interval / KNOTS_PER_INTERVAL as f64;

        let control: Vec<_> = control_points(&points, closed).into_iter().flatten().collect();
        let knots = if closed {
            control.len()
        } else {
            control.len() - KNOTS_PER_INTERVAL + 1
        };
        let at = |index: usize| {
            if closed {
                control[index % control.len()]
            } else {
                // At the rest at the end the last control point is repeated.
                control[index.min(control.len() - 1)]
            }
        };
        let pieces = (0..knots)
            .map(|knot| piece(std::array::from_fn(|offset| at(knot + offset)), spacing))
            .collect();
        Ok(Self {
            spacing,
            closed,
            pieces,
        })
    }

    /// Returns pd(γ) and its derivatives.
    #[must_use]
    pub fn at(&self, gamma: f64) -> CurvePoint {
        let last = self.pieces.len() - 1;
        let knots = if self.closed {
            // The remainder is exact and cannot overflow, so the accuracy does not depend on the number of laps.
            let round = self.pieces.len() as f64 * self.spacing;
            gamma.rem_euclid(round) / self.spacing
        } else {
            (gamma / self.spacing).clamp(0.0, last as f64)
        };
        // Rounding can increase the remainder to a whole lap, where the last piece ends.
        let index = (knots as usize).min(last);
        let piece = &self.pieces[index];
        let past_knot = (knots - index as f64) * self.spacing;
        CurvePoint {
            position: taylor(piece, past_knot),
            derivative1: taylor(&piece[1..], past_knot),
            derivative2: taylor(&piece[2..], past_knot),
            derivative3: taylor(&piece[3..], past_knot),
            derivative4: taylor(&piece[4..], past_knot),
        }
    }
}

fn check(parameters: &scenario::Waypoints) -> Result<(), CurveError> {
    let scenario::Waypoints {
        points,
        closed,
        interval,
        ..
    } = parameters;
    let needed = if *closed { 3 } else { 2 };
    if points.len() < needed {
        let found = points.len();
        return Err(CurveError::TooFewPoints { found, needed });
    }
    if let Some(index) = points
        .iter()
        .position(|point| !point.iter().all(|x| x.is_finite()))
    {
        return Err(CurveError::PointNotFinite { index });
    }
    let mut legs = points.windows(2);
    if let Some(index) = legs.position(|leg| leg[0] == leg[1]) {
        return Err(CurveError::CoincidentPoints { index });
    }
    if *closed && points.first() == points.last() {
        let index = points.len() - 1;
        return Err(CurveError::CoincidentPoints { index });
    }
    if !(interval.is_finite() && *interval > 0.0) {
        return Err(CurveError::Interval(*interval));
    }
    Ok(())
}

/// Returns the polynomial from a knot to the next, of the six control points with weight there.
///
/// The derivatives are differences of control points. If the points coincide, the derivatives are exactly zero and the
/// position is exact.
fn piece(c: [Vector3<f64>; 6], spacing: f64) -> Piece {
    let outer_sum = (c[0] - c[2]) + (c[4] - c[2]);
    let inner_sum = (c[1] - c[2]) + (c[3] - c[2]);
    let outer_difference = c[4] - c[0];
    let inner_difference = c[3] - c[1];
    let per_knot = 1.0 / spacing;
    let mut scale = 1.0;
    [
        c[2] + (outer_sum + inner_sum * 26.0) / 120.0,
        (outer_difference + inner_difference * 10.0) / 24.0,
        (outer_sum + inner_sum * 2.0) / 6.0,
        (outer_difference - inner_difference * 2.0) / 2.0,
        outer_sum - inner_sum * 4.0,
        (c[5] - c[0]) - (c[4] - c[1]) * 5.0 + (c[3] - c[2]) * 10.0,
    ]
    .map(|derivative| {
        let scaled = derivative * scale;
        scale *= per_knot;
        scaled
    })
}

/// Returns f(t) of the polynomial f with the given derivatives at 0, the value first: Σ f⁽ᵏ⁾ tᵏ/k!.
#[inline]
fn taylor(derivatives: &[Vector3<f64>], t: f64) -> Vector3<f64> {
    let (last, lower) = derivatives.split_last().expect("at least the value");
    let mut sum = *last;
    for (order, derivative) in lower.iter().enumerate().rev() {
        sum = derivative + sum * (t / (order + 1) as f64);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn curve(points: &[[f64; 3]], closed: bool, interval: f64) -> Waypoints {
        let points = points.to_vec();
        Waypoints::new(&scenario::Waypoints {
            points,
            closed,
            interval,
            ..scenario::Waypoints::default()
        })
        .unwrap()
    }

    fn any_points(count: std::ops::RangeInclusive<usize>) -> impl Strategy<Value = Vec<[f64; 3]>> {
        proptest::collection::vec(proptest::array::uniform3(-5.0..5.0f64), count)
            .prop_filter("no two points coincide", |points| {
                (1..points.len()).all(|i| !points[..i].contains(&points[i]))
            })
    }

    fn any_curve() -> impl Strategy<Value = (Vec<[f64; 3]>, bool, f64)> {
        let few_or_many = prop_oneof![
            (any_points(2..=4), Just(false)),
            (any_points(2..=50), Just(false)),
            (any_points(3..=5), Just(true)),
            (any_points(3..=50), Just(true)),
        ];
        (few_or_many, 0.1..10.0f64).prop_map(|((points, closed), interval)| (points, closed, interval))
    }

    /// γ-derivatives scaled to what they would be with one unit of γ from knot to knot.
    fn per_knot(derivatives: &[Vector3<f64>], spacing: f64) -> Vec<Vector3<f64>> {
        let powers = std::iter::successors(Some(1.0), |power| Some(power * spacing));
        derivatives
            .iter()
            .zip(powers)
            .map(|(d, power)| d * power)
            .collect()
    }

    proptest! {
        #[test]
        fn the_curve_passes_through_every_point((points, closed, interval) in any_curve()) {
            let curve = curve(&points, closed, interval);
            for (i, point) in points.iter().enumerate() {
                let distance = (curve.at(i as f64 * interval).position - Vector3::from(*point)).norm();
                prop_assert!(distance < 1e-12, "{} {}", i, distance);
            }
        }

        #[test]
        fn position_and_four_derivatives_agree_on_both_sides_of_every_knot((points, closed, interval) in any_curve()) {
            let Waypoints { spacing, pieces, .. } = curve(&points, closed, interval);
            let ends = pieces.iter().enumerate().map(|(i, piece)| {
                let next = if closed { (i + 1) % pieces.len() } else { (i + 1).min(pieces.len() - 1) };
                (piece, &pieces[next])
            });
            for (left, right) in ends {
                let at_end: Vec<_> = (0..5).map(|order| taylor(&left[order..], spacing)).collect();
                for (l, r) in per_knot(&at_end, spacing).iter().zip(per_knot(right, spacing)) {
                    prop_assert!((l - r).norm() < 1e-12, "{} {}", l, r);
                }
            }
        }

        #[test]
        fn each_derivative_is_that_of_the_one_before((points, closed, interval) in any_curve(), place in 0.0..1.0f64, part in 0.1..0.9f64) {
            let curve = curve(&points, closed, interval);
            let knot = (place * curve.pieces.len() as f64).floor();
            let orders = |knots: f64| {
                per_knot(&curve.at((knot + knots) * curve.spacing).orders(), curve.spacing)
            };
            let h = 0.02;
            let [minus2, minus1, here, plus1, plus2] = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|n| orders(part + n * h));
            for order in 0..4 {
                // Exact for polynomials of degree 4; the position's fifth derivative leaves h⁴/30 of it.
                let numerical = ((plus1[order] - minus1[order]) * 8.0 - (plus2[order] - minus2[order])) / (12.0 * h);
                prop_assert!((numerical - here[order + 1]).norm() < 5e-6, "{} {} {}", order, numerical, here[order + 1]);
            }
        }

        #[test]
        fn an_open_curve_is_exactly_at_rest_outside_of_its_points(points in any_points(2..=50), interval in 0.1..10.0f64, outside in 0.0..1e300f64) {
            let curve = curve(&points, false, interval);
            let end = (points.len() - 1) as f64 * interval;
            prop_assert_eq!(curve.at(-outside), CurvePoint::at_rest(points[0].into()));
            // Rounding may put the last knot itself an ulp later.
            let after = curve.at(end * (1.0 + 1e-15) + outside);
            prop_assert_eq!(after, CurvePoint::at_rest(points[points.len() - 1].into()));
        }

        #[test]
        fn a_closed_curve_comes_around_however_often(points in any_points(3..=50), gamma in -10.0..10.0f64, turns in -1_000_000..1_000_000i32) {
            let curve = curve(&points, true, 1.0);
            let later = gamma + f64::from(turns) * points.len() as f64;
            // At 50 million, γ and its number of knots are good to 1e−8, and the fourth derivative is steep.
            for (one, other) in curve.at(gamma).orders().iter().zip(curve.at(later).orders()) {
                prop_assert!((one - other).norm() < 1e-4, "{} {}", one, other);
            }
        }

        #[test]
        fn moving_turning_and_scaling_the_points_does_so_to_the_curve(
            (points, closed, interval) in any_curve(), place in 0.0..1.0f64, angle in -3.0..3.0f64, factor in 0.1..10.0f64,
        ) {
            let turn = shared_types::rotation::from_roll_pitch_yaw([angle, 0.5 * angle, -angle]) * factor;
            let shift = Vector3::new(1.0, -2.0, 3.0);
            let moved: Vec<[f64; 3]> =
                points.iter().map(|point| (turn * Vector3::from(*point) + shift).into()).collect();
            let gamma = place * points.len() as f64 * interval;
            let position = curve(&points, closed, interval).at(gamma).position;
            let distance = curve(&moved, closed, interval).at(gamma).position - (turn * position + shift);
            prop_assert!(distance.norm() < 1e-11 * (1.0 + factor));
        }

        #[test]
        fn any_gamma_gives_a_point(points in any_points(3..=50), closed: bool, gamma: f64) {
            let point = curve(&points, closed, 0.3).at(gamma);
            prop_assert_eq!(point.position.iter().all(|x| x.is_finite()), gamma.is_finite() || (!closed && !gamma.is_nan()));
        }
    }

    /// Largest Σᵢ|Lᵢ(γ)|, Lᵢ the curve through 1 at waypoint i and 0 at the others: as the Lᵢ sum up to 1, it
    /// bounds ‖pd(γ) − c‖ by that many times maxᵢ ‖Pᵢ − c‖.
    fn overshoot(count: usize, closed: bool) -> f64 {
        let impulse = |i: usize| {
            let value = |j: usize| Vector3::new(f64::from(u8::from(i == j)), 0.0, 0.0);
            let points: Vec<_> = (0..count).map(value).collect();
            control_points(&points, closed)
                .into_iter()
                .flatten()
                .map(|c| c.x)
                .collect::<Vec<_>>()
        };
        let impulses: Vec<_> = (0..count).map(impulse).collect();
        let knots = KNOTS_PER_INTERVAL * if closed { count } else { count - 1 };
        let mut largest = 0.0_f64;
        for knot in 0..knots {
            for part in 0..8 {
                let value = |control: &Vec<f64>| {
                    let c = |offset| Vector3::new(control[(knot + offset) % control.len()], 0.0, 0.0);
                    taylor(&piece(std::array::from_fn(c), 1.0), f64::from(part) / 8.0)
                        .x
                        .abs()
                };
                largest = largest.max(impulses.iter().map(value).sum());
            }
        }
        largest
    }

    #[test]
    fn the_overshoot_is_within_its_documented_bound_for_any_points() {
        for count in [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 25, 50] {
            let open = overshoot(count, false);
            assert!(open <= Waypoints::OVERSHOOT_OPEN, "{count} open: {open}");
            if count > 2 {
                let closed = overshoot(count, true);
                assert!(closed <= Waypoints::OVERSHOOT_CLOSED, "{count} closed: {closed}");
            }
        }
        assert!(
            (overshoot(2, false) - 1.0).abs() < 1e-14,
            "two points: no overshoot"
        );
    }

    #[test]
    fn a_closed_curve_through_samples_of_a_circle_is_that_circle_to_a_tenth_of_a_millimetre() {
        use std::f64::consts::TAU;
        let points: Vec<_> = (0..12)
            .map(|i| {
                let (sine, cosine) = libm::sincos(TAU * f64::from(i) / 12.0);
                [cosine, sine, -1.0]
            })
            .collect();
        let curve = curve(&points, true, TAU / 12.0);
        for i in 0..1000 {
            let gamma = TAU * f64::from(i) / 1000.0;
            let (sine, cosine) = libm::sincos(gamma);
            let [p, d1, d2, d3, _] = curve.at(gamma).orders();
            assert!((p - Vector3::new(cosine, sine, -1.0)).norm() < 1e-4);
            assert!((d1 - Vector3::new(-sine, cosine, 0.0)).norm() < 1e-3);
            assert!((d2 + Vector3::new(cosine, sine, 0.0)).norm() < 1e-2);
            assert!((d3 + Vector3::new(-sine, cosine, 0.0)).norm() < 1e-1);
        }
    }

    #[test]
    fn between_two_points_the_curve_goes_straight_and_never_back() {
        let (from, to) = (Vector3::new(1.0, 2.0, -1.0), Vector3::new(-2.0, 0.0, -3.0));
        let curve = curve(&[from.into(), to.into()], false, 2.0);
        let way = to - from;
        let (mut last, mut fastest) = (0.0, 0.0_f64);
        for i in 0..=1000 {
            let point = curve.at(2.0 * f64::from(i) / 1000.0);
            assert!((point.position - from).cross(&way).norm() < 1e-14);
            let gone = (point.position - from).dot(&way) / way.norm_squared();
            assert!(gone >= last && point.derivative1.dot(&way) >= 0.0, "{i}");
            last = gone;
            fastest = fastest.max(point.derivative1.norm());
        }
        assert!((last - 1.0).abs() < 1e-15);
        // The peak of the quartic B-spline, 115/192, at five knots to the interval.
        assert!((fastest / (way.norm() / 2.0) - 5.0 * 115.0 / 192.0).abs() < 1e-12);
    }

    #[test]
    fn parameters_without_a_curve_are_refused_with_the_place() {
        let a = [0.0, 0.0, -1.0];
        let b = [1.0, 0.0, -1.0];
        let refusal = |points: &[[f64; 3]], closed, interval| {
            Waypoints::new(&scenario::Waypoints {
                points: points.to_vec(),
                closed,
                interval,
                ..scenario::Waypoints::default()
            })
            .unwrap_err()
        };
        let too_few = |found, needed| CurveError::TooFewPoints { found, needed };
        assert_eq!(refusal(&[], false, 1.0), too_few(0, 2));
        assert_eq!(refusal(&[a], false, 1.0), too_few(1, 2));
        assert_eq!(refusal(&[a, b], true, 1.0), too_few(2, 3));
        assert_eq!(
            refusal(&[a, b, b, a], false, 1.0),
            CurveError::CoincidentPoints { index: 1 }
        );
        assert_eq!(
            refusal(&[a, b, a], true, 1.0),
            CurveError::CoincidentPoints { index: 2 }
        );
        assert_eq!(
            refusal(&[a, [0.0, f64::NAN, 0.0]], false, 1.0),
            CurveError::PointNotFinite { index: 1 }
        );
        for interval in [0.0, -1.0, f64::INFINITY] {
            assert_eq!(refusal(&[a, b], false, interval), CurveError::Interval(interval));
        }
    }
}
