//! Planned faults in the summary's table.

use super::FaultReport;
use crate::summary::table::{length, wrapped};

/// Returns the effects of the faults, some lines each.
pub(in crate::summary) fn faults_in_words(faults: &[FaultReport]) -> String {
    faults.iter().map(in_words).collect()
}

fn in_words(fault: &FaultReport) -> String {
    let lasts = match fault.ends {
        Some(_) => format!("for {} s", fault.outage),
        None => "for good".to_owned(),
    };
    let title = format!(
        "from {} s {lasts}: {}",
        fault.begins,
        fault.fault.replace('`', "")
    );
    let noticed = fault.detection.as_ref().map_or_else(
        || "by nobody".to_owned(),
        |detection| format!("after {} s: {} {}", detection.after, detection.by, detection.sign),
    );
    let distance = fault.peak_error.map_or_else(|| "not known".to_owned(), length);
    let back = match fault.back_after {
        Some(after) => format!("after {after:.3} s"),
        None if fault.is_over() => "not back".to_owned(),
        None => "–".to_owned(),
    };
    let lines = [
        title,
        format!("  noticed           {noticed}"),
        format!("  largest distance  {distance}"),
        format!("  back              {back}"),
        format!("  what the services did: {}", fault.others),
    ];
    lines.map(|line| wrapped(&line) + "\n").concat()
}
