//! Smoothest quintic spline through the waypoints: the one with the minimum ∫‖pd‴‖² dγ.
//!
//! The five control points of a waypoint P are P + N y with four free vectors y, so that the curve passes through P for
//! every y. The third derivative between two waypoints depends only on their ten control points. So the integral is a
//! quadratic form that couples only neighbours, equal for every pair, and its minimum solves
//!
//!   Bᵀ yᵢ₋₁ + A yᵢ + B yᵢ₊₁ = e (Pᵢ − Pᵢ₊₁)ᵀ + f (Pᵢ − Pᵢ₋₁)ᵀ
//!
//! with yᵢ ∈ R⁴ˣ³, y = 0 at an end at rest, and indices around a closed curve. The solution affects only the
//! smoothness: the curve is C⁴ and passes through its points for any y.

use nalgebra::{Matrix3, Matrix4, SMatrix, Vector3, Vector4};

use super::KNOTS_PER_INTERVAL;

/// The control points of a waypoint, in order; the third belongs to its own knot.
pub(super) type ControlPoints = [Vector3<f64>; KNOTS_PER_INTERVAL];

/// y of a waypoint: offsets of its control points from it, without the middle one.
type Offsets = SMatrix<f64, 4, 3>;

/// Returns the control points of the smoothest curve, five a waypoint.
pub(super) fn control_points(points: &[Vector3<f64>], closed: bool) -> Vec<ControlPoints> {
    let energy = Energy::of_interval();
    let offsets = if closed {
        energy.closed_minimum(points)
    } else {
        energy.open_minimum(points)
    };
    let around = |(point, offsets): (&Vector3<f64>, Offsets)| {
        let spread = passing() * offsets;
        std::array::from_fn(|row| point + spread.row(row).transpose())
    };
    points.iter().zip(offsets).map(around).collect()
}

/// Returns N: from y to the offsets of all five control points, such that (c₋₂ + 26c₋₁ + 66c₀ + 26c₁ + c₂)/120 = 0.
fn passing() -> SMatrix<f64, 5, 4> {
    let (inner, outer) = (-26.0 / 66.0, -1.0 / 66.0);
    SMatrix::<f64, 5, 4>::from_row_slice(&[
        1.0, 0.0, 0.0, 0.0, //
        0.0, 1.0, 0.0, 0.0, //
        outer, inner, inner, outer, //
        0.0, 0.0, 1.0, 0.0, //
        0.0, 0.0, 0.0, 1.0,
    ])
}

/// Returns ∫‖pd‴‖² from one waypoint to the next as a quadratic form of their ten control points, knot spacing 1.
fn interval_form() -> SMatrix<f64, 10, 10> {
    // On a piece, the third derivative is the quadratic B-spline of the third differences.
    let third_difference = [-1.0, 3.0, -3.0, 1.0];
    let gram = Matrix3::new(6.0, 13.0, 1.0, 13.0, 54.0, 13.0, 1.0, 13.0, 6.0) / 120.0;
    let mut form = SMatrix::zeros();
    for piece in 0..KNOTS_PER_INTERVAL {
        let mut differences = SMatrix::<f64, 3, 10>::zeros();
        for row in 0..3 {
            for (column, weight) in third_difference.into_iter().enumerate() {
                differences[(row, piece + row + column)] = weight;
            }
        }
        form += differences.transpose() * gram * differences;
    }
    form
}

/// Blocks of the equations for the minimum.
struct Energy {
    /// A.
    own: Matrix4<f64>,
    /// B.
    next: Matrix4<f64>,
    /// e.
    from_next: Vector4<f64>,
    /// f.
    from_previous: Vector4<f64>,
}

impl Energy {
    fn of_interval() -> Self {
        let form = interval_form();
        let begin = form.fixed_view::<5, 5>(0, 0);
        let across = form.fixed_view::<5, 5>(0, 5);
        let end = form.fixed_view::<5, 5>(5, 5);
        let (n, one) = (passing(), SMatrix::<f64, 5, 1>::repeat(1.0));
        Self {
            own: n.transpose() * (begin + end) * n,
            next: n.transpose() * across * n,
            from_next: n.transpose() * across * one,
            from_previous: n.transpose() * across.transpose() * one,
        }
    }

    /// Returns the right-hand side for a point between two others.
    fn pull(&self, previous: &Vector3<f64>, own: &Vector3<f64>, next: &Vector3<f64>) -> Offsets {
        self.from_next * (own - next).transpose() + self.from_previous * (own - previous).transpose()
    }

    fn open_minimum(&self, points: &[Vector3<f64>]) -> Vec<Offsets> {
        let triples = points.windows(3);
        let between = self.solve_chain(triples.map(|p| self.pull(&p[0], &p[1], &p[2])).collect());
        let at_rest = std::iter::once(Offsets::zeros());
        at_rest.clone().chain(between).chain(at_rest).collect()
    }

    /// Solves the chain of all but the last waypoint for the right-hand sides and, in four more columns, for the influence of
    /// the last waypoint's y, which then follows from the last equation.
    fn closed_minimum(&self, points: &[Vector3<f64>]) -> Vec<Offsets> {
        let last = points.len() - 1;
        let pull = |i: usize| {
            let (previous, next) = ((i + last) % points.len(), (i + 1) % points.len());
            self.pull(&points[previous], &points[i], &points[next])
        };
        let mut sides: Vec<_> = (0..last)
            .map(|i| {
                let mut side = SMatrix::<f64, 4, 7>::zeros();
                side.fixed_columns_mut::<3>(0).copy_from(&pull(i));
                side
            })
            .collect();
        let mut add_influence = |i: usize, block: Matrix4<f64>| {
            let mut columns = sides[i].fixed_columns_mut::<4>(3);
            columns += block;
        };
        add_influence(0, self.next.transpose());
        add_influence(last - 1, self.next);

        let solved = self.solve_chain(sides);
        let pulled = |i: usize| solved[i].fixed_columns::<3>(0).into_owned();
        let influence = |i: usize| solved[i].fixed_columns::<4>(3).into_owned();
        let (b, b_transposed) = (self.next, self.next.transpose());
        let pivot = self.own - b * influence(0) - b_transposed * influence(last - 1);
        let y_last = inverse(pivot) * (pull(last) - b * pulled(0) - b_transposed * pulled(last - 1));
        let others = (0..last).map(|i| pulled(i) - influence(i) * y_last);
        others.chain(std::iter::once(y_last)).collect()
    }

    /// Solves Bᵀ yᵢ₋₁ + A yᵢ + B yᵢ₊₁ = sideᵢ with y = 0 beyond both ends, by block elimination.
    fn solve_chain<const C: usize>(&self, mut sides: Vec<SMatrix<f64, 4, C>>) -> Vec<SMatrix<f64, 4, C>> {
        let (b, b_transposed) = (self.next, self.next.transpose());
        let mut inverse_pivots: Vec<Matrix4<f64>> = Vec::with_capacity(sides.len());
        for i in 0..sides.len() {
            let mut pivot = self.own;
            if let Some(previous) = inverse_pivots.last() {
                pivot -= b_transposed * previous * b;
                sides[i] = sides[i] - b_transposed * previous * sides[i - 1];
            }
            inverse_pivots.push(inverse(pivot));
        }
        for i in (0..sides.len()).rev() {
            if let Some(next) = sides.get(i + 1).copied() {
                sides[i] -= b * next;
            }
            sides[i] = inverse_pivots[i] * sides[i];
        }
        sides
    }
}

fn inverse(pivot: Matrix4<f64>) -> Matrix4<f64> {
    let factors = pivot.cholesky();
    factors
        .expect("the integral is strictly convex for all points")
        .inverse()
}

#[cfg(test)]
mod tests {
    use super::super::{Piece, piece};
    use super::*;
    use proptest::prelude::*;

    fn pieces(control: &[ControlPoints], closed: bool) -> Vec<Piece> {
        let control: Vec<_> = control.iter().flatten().copied().collect();
        let count = if closed {
            control.len()
        } else {
            control.len() - KNOTS_PER_INTERVAL
        };
        let at = |index: usize| control[index % control.len()];
        (0..count)
            .map(|knot| piece(std::array::from_fn(|offset| at(knot + offset)), 1.0))
            .collect()
    }

    /// ∫‖pd‴‖² by the quadrature of Gauss and Legendre with three nodes, exact for a polynomial of degree 4.
    fn integral(control: &[ControlPoints], closed: bool) -> f64 {
        let node = 0.5 * 0.6_f64.sqrt();
        let rule = [
            (0.5 - node, 5.0 / 18.0),
            (0.5, 8.0 / 18.0),
            (0.5 + node, 5.0 / 18.0),
        ];
        let on_piece = |piece: &Piece| {
            let third = |t: f64| piece[3] + (piece[4] + piece[5] * (0.5 * t)) * t;
            rule.iter()
                .map(|(t, weight)| weight * third(*t).norm_squared())
                .sum::<f64>()
        };
        pieces(control, closed).iter().map(on_piece).sum()
    }

    fn points(least: usize) -> impl Strategy<Value = Vec<Vector3<f64>>> {
        let point = [-5.0..5.0f64, -5.0..5.0f64, -5.0..5.0f64].prop_map(Vector3::from);
        proptest::collection::vec(point, least..=20)
    }

    proptest! {
        #[test]
        fn no_other_spline_through_the_points_is_smoother(
            (points, closed) in prop_oneof![(points(3), Just(true)), (points(3), Just(false))],
            seed in proptest::array::uniform12(-1.0..1.0f64),
            which in 0..1000usize,
        ) {
            let best = control_points(&points, closed);
            let which = if closed { which % points.len() } else { 1 + which % (points.len() - 2) };
            let other = |size: f64| {
                let mut control = best.clone();
                let spread = passing() * Offsets::from_row_slice(&seed) * size;
                for (c, row) in control[which].iter_mut().zip(spread.row_iter()) {
                    *c += row.transpose();
                }
                integral(&control, closed)
            };
            let least = integral(&best, closed);
            // The integral is quadratic: at its minimum the linear term vanishes.
            let (linear, quadratic) = ((other(1.0) - other(-1.0)) / 2.0, (other(1.0) + other(-1.0)) / 2.0 - least);
            prop_assert!(quadratic > 0.0);
            prop_assert!(linear.abs() < 1e-12 * (1.0 + least + quadratic), "{} {} {}", linear, least, quadratic);
        }

        #[test]
        fn the_smoothest_closed_curve_is_the_periodic_quintic_spline_with_a_knot_at_each_point_only(points in points(3)) {
            // Its fifth derivative jumps at the points and nowhere else.
            for interval in pieces(&control_points(&points, true), true).chunks(KNOTS_PER_INTERVAL) {
                // The five control points of a waypoint begin two knots before it: pieces are numbered from there.
                for piece in &interval[1..] {
                    prop_assert!((piece[5] - interval[0][5]).norm() < 1e-9, "{} {}", piece[5], interval[0][5]);
                }
            }
        }
    }
}
