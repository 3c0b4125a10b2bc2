//! `gerono truth`: prints the true distance from the path.

use comfy_table::{Table, presets};

use super::{Failure, log_path, print};
use crate::cli::TruthArguments as Arguments;
use fault_matrix::truth::{self, Truth};
use reproduce::windows::AVERAGED;

/// `gerono truth`.
///
/// # Errors
/// [`Failure`] if a log cannot be read or lacks the required samples.
pub fn truth(arguments: &Arguments) -> Result<(), Failure> {
    let flight = log_path(&arguments.flight);
    let world = arguments.world.as_ref().map(|world| log_path(world));
    let truth = truth::compare(&flight, world.as_deref(), arguments.last).map_err(Failure::trouble)?;
    if arguments.json {
        let text = serde_json::to_string_pretty(&truth);
        print(text.map_err(Failure::trouble)? + "\n");
    } else {
        print(shown(&truth));
    }
    Ok(())
}

fn shown(truth: &Truth) -> String {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(["part", "from, s", "to, s", "RMSE, cm", "SD, cm", "largest, cm"]);
    for part in &truth.parts {
        let [from, to] = part.span;
        let times = [from, to].map(|time| format!("{time:.1}"));
        let distances =
            [part.rmse, part.deviation, part.largest].map(|metres| format!("{:.3}", 1e2 * metres));
        table.add_row([part.name.to_owned()].into_iter().chain(times).chain(distances));
    }
    let vector = |[x, y, z]: [f64; 3]| format!("[{x:.3}, {y:.3}, {z:.3}]");
    let ends = truth.parts.iter().map(|part| part.span[1]).fold(0.0, f64::max);
    let begins = truth.parts.iter().map(|part| part.span[0]).fold(ends, f64::min);
    let window = (ends - begins).min(AVERAGED);
    format!(
        "{table}\ndisturbance in the last {window:.1} s, m/s²: true {}, estimated {}\n",
        vector(truth.disturbance),
        vector(truth.disturbance_estimate)
    )
}
