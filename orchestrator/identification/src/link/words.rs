//! A calibration as text: a table beside the stated values, and the lines to put into the scenario.

use std::fmt::{self, Display, Formatter, Write};

use comfy_table::{Table, presets};

use crate::rehearsal::advice;

use super::{Calibration, EXPLAINS, Identification, STICKS};

/// Path that moves thrust, roll and pitch, within half a metre of a place.
pub(super) const MOVING_PATH: &str =
    "path.curve={lissajous={center=[0.0,0.0,-1.2],amplitude=[0.5,0.5,0.3],frequency=[1.5,1.8,3.6]}}";

impl Display for Identification {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        formatter.write_str(&table(self))?;
        formatter.write_str(&reversed(self))?;
        formatter.write_str(&snippet(self))
    }
}

/// Names the sticks that the vehicle answers with the wrong sign, and other wrong axes.
fn reversed(found: &Identification) -> String {
    let reversed = found.sticks.iter().filter(|stick| stick.is_reversed());
    let mut text: String = reversed
        .map(|stick| {
            format!(
                "WRONG: {} answers with the wrong sign: reverse its channel (`rc_output.transmitter.reversed`) or its slope.\n",
                stick.stick
            )
        })
        .collect();
    if let Some(response) = found.response.as_ref().filter(|_| text.is_empty()) {
        let _ = writeln!(text, "WRONG: {response}.");
    }
    if !text.is_empty() {
        text.push('\n');
    }
    text
}

fn table(found: &Identification) -> String {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header([
        "stick",
        "stated",
        "fitted",
        "95 % intervals, ±",
        "residual",
        "explained",
        "travel",
        "points",
    ]);
    for calibration in &found.sticks {
        let pair = |[offset, slope]: [f64; 2]| format!("{offset:.4} + {slope:.4} s");
        let fitted = calibration.fitted.map_or_else(
            || {
                vec![calibration.needed.map_or_else(
                    || "too little travel".to_owned(),
                    |needed| format!("too short, needs {needed:.0} s"),
                )]
            },
            |fit| {
                vec![
                    pair([fit.offset, fit.slope]),
                    format!("{:.4}, {:.4}", fit.errors[0], fit.errors[1]),
                    format!("{:.4}", fit.residual),
                    format!("{:.1} %", 100.0 * fit.explained.max(0.0)),
                    format!("{:.4}", fit.travel_deviation),
                    fit.points.to_string(),
                ]
            },
        );
        let stick = [calibration.stick.to_owned(), pair(calibration.stated)];
        table.add_row(stick.into_iter().chain(fitted));
    }
    let mass = found
        .mass
        .map_or_else(String::new, |mass| format!("; thrusts for a mass of {mass} kg"));
    format!("{table}\n\nvalue = offset + slope · travel s, N and rad/s{mass}\n\n")
}

/// Returns the lines of a scenario for the values that differ, and the sticks that are not identifiable.
fn snippet(found: &Identification) -> String {
    let [thrust, rates @ ..] = found.sticks;
    let mut text = String::new();
    if let Some(fit) = thrust.usable().filter(|_| thrust.differs()) {
        let _ = write!(
            text,
            "thrust_offset = {:.4}\nthrust_slope = {:.4}\n",
            fit.offset, fit.slope
        );
    }
    if rates.iter().any(Calibration::differs) {
        let slopes = rates.map(|rate| {
            let fit = rate.usable().filter(|_| rate.differs());
            fit.map_or(rate.stated[1], |fit| fit.slope)
        });
        let _ = writeln!(
            text,
            "rate_slope = [{:.4}, {:.4}, {:.4}]",
            slopes[0], slopes[1], slopes[2]
        );
    }
    let values = "thrust and body rates of the channels";
    let advise = |lines: &str| advice(found.rehearsal, found.is_late, values, lines);
    if text.is_empty() {
        let count = found
            .sticks
            .iter()
            .filter(|stick| stick.usable().is_some())
            .count();
        text = match count {
            0 => "No stick can be identified from this flight.\n".to_owned(),
            4 => "All identified values are as stated.\n".to_owned(),
            _ => format!(
                "{count} of 4 sticks were identified, and are as stated. The others were NOT identified:\n"
            ),
        };
        let advice = advise("");
        if count > 0 && !advice.is_empty() {
            text = format!("{advice}\n{text}");
        }
    } else {
        text = format!("[rc_output]\n{text}");
        text = advise(&text);
    }
    text + &too_short(found) + &unmoved(found)
}

/// Lists the sticks that need a longer flight, if there are any.
fn too_short(found: &Identification) -> String {
    let needed = |stick: &Calibration| Some(format!("{} needs {:.0} s", stick.stick, stick.needed?));
    let short: Vec<_> = found.sticks.iter().filter_map(needed).collect();
    if short.is_empty() {
        return String::new();
    }
    format!(
        "\nKept as stated, because the flight is too short for valid intervals: {}.\n",
        short.join(", ")
    )
}

/// Lists the sticks that moved too little, if there are any.
fn unmoved(found: &Identification) -> String {
    let unmoved = found
        .sticks
        .iter()
        .filter(|stick| stick.needed.is_none() && stick.usable().is_none());
    let unmoved: Vec<_> = unmoved.map(|stick| stick.stick).collect();
    if unmoved.is_empty() {
        return String::new();
    }
    let mut remedies = String::new();
    if unmoved.iter().any(|stick| *stick != STICKS[3]) {
        let _ = write!(
            remedies,
            " A hover moves none enough: fly for 40 s, where there is room,\nwith  --set '{MOVING_PATH}'\n"
        );
    }
    if unmoved.contains(&STICKS[3]) {
        remedies += " The yaw is moved by steps of `[[path.yaw_step]]`.\n";
    }
    format!(
        "\nKept as stated, because the stick explains less than {:.0} % of the measured variance: {}.{remedies}",
        100.0 * EXPLAINS,
        unmoved.join(", ")
    )
}
