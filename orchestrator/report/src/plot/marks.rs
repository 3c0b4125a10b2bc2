//! Annotations of a figure: the theorem's bound, changes of the vehicle, planned faults.

use kuva::prelude::{ReferenceLine, ShadedRegion};
use scenario::{Fault, FaultState, VehicleChange};

use super::CHANGE_COLOR;
use super::curve::Curve;

const BOUND_COLOR: &str = "#d55e00";
const FAULT_COLOR: &str = "#e69f00";

/// Returns a line for each theorem's bound of the curves' controllers.
pub(super) fn bound_lines(curves: &[Curve]) -> Vec<ReferenceLine> {
    let mut bounds: Vec<f64> = curves
        .iter()
        .filter_map(|curve| curve.scenario.theorem_bound())
        .collect();
    bounds.sort_by(f64::total_cmp);
    bounds.dedup();
    bounds
        .into_iter()
        .map(|bound| {
            ReferenceLine::horizontal(bound)
                .with_color(BOUND_COLOR)
                .with_label(format!("theorem's bound: {bound:.4} m"))
        })
        .collect()
}

/// Returns a line at each time at which a vehicle changed, labelled with the change if all flights share it.
pub(super) fn change_lines(curves: &[Curve], span: [f64; 2]) -> Vec<ReferenceLine> {
    let mut changes: Vec<&VehicleChange> = curves
        .iter()
        .flat_map(|curve| &curve.scenario.vehicle.change)
        .filter(|change| is_within(change.at, span))
        .collect();
    changes.sort_by(|left, right| left.at.total_cmp(&right.at));
    changes
        .chunk_by(|left, right| left.at == right.at)
        .map(|same_time| {
            let is_same_change = same_time.iter().all(|change| change == &same_time[0]);
            ReferenceLine::vertical(same_time[0].at)
                .with_color(CHANGE_COLOR)
                .with_dasharray("3 3")
                .with_label(if is_same_change {
                    describe(same_time[0])
                } else {
                    "vehicle changes".to_owned()
                })
        })
        .collect()
}

/// Describes the properties of the vehicle that change.
fn describe(change: &VehicleChange) -> String {
    let mut parts = Vec::new();
    if let Some(mass) = change.mass {
        parts.push(format!("mass becomes {mass} kg"));
    }
    if change.inertia.is_some() {
        parts.push("inertia changes".to_owned());
    }
    if let Some([x, y, z]) = change.disturbance {
        parts.push(format!("disturbance becomes [{x}, {y}, {z}] m/s²"));
    }
    parts.join(", ")
}

/// Returns a line at the start of each planned fault, labelled with the fault if all flights share it.
pub(super) fn fault_lines(curves: &[Curve], span: [f64; 2]) -> Vec<ReferenceLine> {
    let mut faults = faults(curves);
    faults.retain(|fault| is_within(fault.at, span));
    faults.sort_by(|left, right| left.at.total_cmp(&right.at));
    faults
        .chunk_by(|left, right| left.at == right.at)
        .map(|same_time| {
            let is_same_fault = same_time.iter().all(|fault| fault == &same_time[0]);
            let what = if is_same_fault {
                in_short(same_time[0])
            } else {
                "faults".to_owned()
            };
            let lasts = same_time[0].lasts;
            let is_same_length = same_time.iter().all(|fault| fault.lasts == lasts);
            ReferenceLine::vertical(same_time[0].at)
                .with_color(FAULT_COLOR)
                .with_label(match lasts {
                    Some(lasts) if is_same_length => format!("{what} for {lasts} s"),
                    None if is_same_length => format!("{what} for good"),
                    _ => what,
                })
        })
        .collect()
}

/// Describes target and kind of a fault, short enough for a label.
fn in_short(fault: &Fault) -> String {
    let target = fault
        .target()
        .map_or_else(String::new, |target| target.to_string());
    let state = match fault.state {
        FaultState::Cold => ", cold,",
        FaultState::Warm => "",
    };
    format!("{target} {}{state}", fault.kind)
}

/// Returns the spans of the planned faults of all flights.
pub(super) fn fault_regions(curves: &[Curve], span: [f64; 2]) -> Vec<ShadedRegion> {
    let [from, to] = span;
    let mut spans: Vec<(f64, f64)> = faults(curves)
        .into_iter()
        .map(|fault| (fault.at.max(from), fault.until().min(to)))
        .filter(|(begin, end)| begin < end)
        .collect();
    spans.sort_by(|left, right| left.0.total_cmp(&right.0).then(left.1.total_cmp(&right.1)));
    spans.dedup();
    spans
        .into_iter()
        .map(|(begin, end)| {
            ShadedRegion::vertical(begin, end)
                .with_color(FAULT_COLOR)
                .with_opacity(0.25)
        })
        .collect()
}

fn faults(curves: &[Curve]) -> Vec<&Fault> {
    curves.iter().flat_map(|curve| &curve.scenario.fault).collect()
}

fn is_within(time: f64, [from, to]: [f64; 2]) -> bool {
    (from..=to).contains(&time)
}
