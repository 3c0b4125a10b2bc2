//! Planned faults as people read of them.

use comfy_table::{ContentArrangement, Table, presets};

use super::FaultReport;

/// Width of the column in which the services' doings are told, characters: the table shall fit a wide terminal.
const TOLD: u16 = 44;

/// What the faults did, one line each.
pub(in crate::summary) fn fault_table(faults: &[FaultReport]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_content_arrangement(ContentArrangement::Dynamic);
    table.set_width(160);
    table.set_header([
        "fault",
        "from, s",
        "for, s",
        "noticed after, s",
        "peak ‖p − pd‖, m",
        "back after, s",
        "what the services did",
    ]);
    for fault in faults {
        table.add_row(row(fault));
    }
    if let Some(column) = table.column_mut(6) {
        column.set_constraint(comfy_table::ColumnConstraint::UpperBoundary(
            comfy_table::Width::Fixed(TOLD),
        ));
    }
    table
}

fn row(fault: &FaultReport) -> [String; 7] {
    let none = || "–".to_owned();
    [
        fault.fault.replace('`', ""),
        format!("{}", fault.begins),
        format!("{}", fault.outage),
        fault.detection.map_or_else(none, |detection| {
            format!("{}\n{} {}", detection.after, detection.by, detection.sign)
        }),
        fault.peak_error.map_or_else(none, |peak| format!("{peak:.4}")),
        match fault.back_after {
            Some(after) => format!("{after:.3}"),
            None if fault.is_over() => "not back".to_owned(),
            None => none(),
        },
        fault.others.clone(),
    ]
}
