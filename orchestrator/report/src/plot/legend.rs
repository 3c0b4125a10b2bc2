//! Position of a figure's legend: a corner without data, or beside the axes.

use kuva::prelude::LegendPosition;

use super::FLOOR;

/// Maximum share of the axes' width and height for a legend.
const SHARE: [f64; 2] = [0.35, 0.35];

/// The corners in order of preference; the flags are `[is right, is top]`.
const CORNERS: [(LegendPosition, [bool; 2]); 4] = [
    (LegendPosition::InsideTopRight, [true, true]),
    (LegendPosition::InsideTopLeft, [false, true]),
    (LegendPosition::InsideBottomRight, [true, false]),
    (LegendPosition::InsideBottomLeft, [false, false]),
];

/// Returns a legend position that hides no point of the curves. `is_logarithmic` applies to the vertical axis.
pub fn free_position<'a>(
    curves: impl Iterator<Item = &'a [(f64, f64)]> + Clone,
    is_logarithmic: bool,
) -> LegendPosition {
    let upwards = |y: f64| {
        if is_logarithmic {
            libm::log10(y.max(FLOOR))
        } else {
            y
        }
    };
    let points = curves.flatten().map(|&(x, y)| [x, upwards(y)]);
    let mut spans = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for point in points.clone() {
        for (span, value) in spans.iter_mut().zip(point) {
            *span = [span[0].min(value), span[1].max(value)];
        }
    }
    let is_in = |point: [f64; 2], corner: [bool; 2]| {
        (0..2).all(|axis| {
            let [low, high] = spans[axis];
            let share = (point[axis] - low) / (high - low);
            if corner[axis] {
                share > 1.0 - SHARE[axis]
            } else {
                share < SHARE[axis]
            }
        })
    };
    CORNERS
        .into_iter()
        .find(|(_, corner)| !points.clone().any(|point| is_in(point, *corner)))
        .map_or(LegendPosition::OutsideRightTop, |(position, _)| position)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn position(curve: impl Fn(f64) -> f64, is_logarithmic: bool) -> LegendPosition {
        let points: Vec<(f64, f64)> = (0..=100)
            .map(|step| (f64::from(step), curve(f64::from(step) / 100.0)))
            .collect();
        free_position([points.as_slice()].into_iter(), is_logarithmic)
    }

    #[test]
    fn a_legend_goes_where_no_curve_is() {
        let falling = position(|x| 1.0 - x, false);
        assert!(matches!(falling, LegendPosition::InsideTopRight));
        let rising = position(|x| x, false);
        assert!(matches!(rising, LegendPosition::InsideTopLeft));
        let rising = position(|x| libm::pow(10.0, 3.0 * x), true);
        assert!(matches!(rising, LegendPosition::InsideTopLeft));
        let everywhere = position(|x| libm::sin(200.0 * x), false);
        assert!(matches!(everywhere, LegendPosition::OutsideRightTop));
    }
}
