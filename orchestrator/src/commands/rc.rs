//! `gerono rc probe` and `gerono rc identify`: a radio link on the ground, and what its channels mean in the air.

use std::fmt::Write;
use std::time::Duration;

use comfy_table::{Table, presets};
use radio_link::channel_map::{ChannelMap, SentTravel, StickTravel};
use radio_link::link::RadioLink;
use radio_link::sender::{LinkReport, Sender};
use radio_link::sticks::Sticks;
use scenario::{RadioProtocol, RcLink, Scenario};
use shared_types::service::nanoseconds;

use super::{Failure, load, log_path, print};
use crate::cli::{RcIdentify, RcProbe};
use command_line::exit::Exit;
use command_line::interrupt;
use link_identification::{Calibration, EXPLAINS, Identification, STICKS};

/// The period at which the sticks are moved on and given to the sender, s.
const STEP: f64 = 0.01;

/// Steps between two lines that are shown.
const SHOWN_EVERY: u64 = 25;

/// `gerono rc probe`: moves one stick after another, disarmed, and says what the receiver should show.
///
/// # Errors
/// [`Failure`] if the scenario has no link but the simulated one, or its device cannot be used.
pub fn probe(arguments: &RcProbe) -> Result<Exit, Failure> {
    let scenario = load(&arguments.scenario)?;
    let link = link_of(&scenario)?;
    let transmitter = link.transmitter.as_ref().ok_or_else(no_link)?;
    let opened = RadioLink::open(link).map_err(Failure::trouble)?;
    let opened = opened.ok_or_else(no_link)?;
    let (map, units) = (opened.encoder().map().clone(), opened.encoder().units());
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let period_ns = nanoseconds(1.0 / transmitter.frame_rate_on(link.link));
    let sender = Sender::start(opened, period_ns).map_err(Failure::trouble)?;

    let moved = moved_sticks(transmitter.arming_channel.is_some() || arguments.propellers_off);
    print(introduction(link, moved));
    for &stick in moved {
        let steps = nanoseconds(arguments.seconds) / nanoseconds(STEP);
        for step in 0..=steps {
            let travel = StickTravel::new(sweep(step as f64 / steps.max(1) as f64));
            let sticks = one_stick(&map, stick, travel);
            sender.put(&sticks);
            if step % SHOWN_EVERY == 0 {
                print(if transmitter.has_channels(link.link) {
                    let (channel, travels) = (map.stick_channels()[stick], map.travels(&sticks));
                    let sent = travels[channel].map_or(f64::NAN, SentTravel::value);
                    line(link.link, stick, channel, sent, units.codes(&travels)[channel])
                } else {
                    attitude_line(link, &map, stick, &sticks)
                });
            }
            if interrupt.signal().is_some() {
                break;
            }
            std::thread::sleep(Duration::from_secs_f64(STEP));
        }
    }
    sender.put(&Sticks::AT_REST);
    let report = sender
        .stop()
        .map_err(|_| Failure::trouble("the sender has failed"))?;
    print(summary(&report));
    Ok(interrupt.signal().map_or(Exit::Success, Exit::Signal))
}

fn link_of(scenario: &Scenario) -> Result<&RcLink, Failure> {
    let link = scenario.rc_output.as_ref();
    link.filter(|link| !link.link.is_simulated()).ok_or_else(no_link)
}

fn no_link() -> Failure {
    let reason = "the scenario's radio link is simulated; state `rc_output.link` and `[rc_output.transmitter]`, as \
                  docs/radio_links.md tells";
    Failure::bad_input(reason)
}

/// Which sticks are moved, thrust last. Without an arming switch the thrust stick may let motors turn.
fn moved_sticks(with_thrust: bool) -> &'static [usize] {
    if with_thrust { &[1, 2, 3, 0] } else { &[1, 2, 3] }
}

/// The travel of a stick at a share of its time: from the middle to one end, to the other, and back.
fn sweep(share: f64) -> f64 {
    let quarter = 4.0 * share;
    match quarter {
        up if up <= 1.0 => up,
        down if down <= 3.0 => 2.0 - down,
        back => back - 4.0,
    }
}

/// One stick somewhere, the others at rest: the least thrust, the rates in the middle, disarmed.
fn one_stick(map: &ChannelMap, stick: usize, travel: StickTravel) -> Sticks {
    let middle = StickTravel::MIDDLE;
    let mut travels = [map.least_thrust(), middle, middle, middle];
    travels[stick] = travel;
    Sticks {
        disarmed: true,
        ..Sticks::flying(travels.map(|travel| map.code(travel)))
    }
}

fn introduction(link: &RcLink, moved: &[usize]) -> String {
    let mut text = format!(
        "{}: disarmed, propellers off all the same. Each line is what the receiver should show.\n",
        link.link.name()
    );
    if !moved.contains(&0) {
        text += "The thrust stick is not moved: no arming switch would hold the motors. With --propellers-off it is.\n";
    }
    text + "\n"
}

fn line(link: RadioProtocol, stick: usize, channel: usize, travel: f64, code: u16) -> String {
    let name = STICKS[stick];
    let percent = 100.0 * travel;
    let shown = match link {
        // What flight controllers make of a receiver's codes.
        RadioProtocol::Crsf | RadioProtocol::Sbus => {
            format!("code {code:4}, {:.0} µs", 1500.0 + 512.0 * travel)
        }
        RadioProtocol::Multi => format!("code {code:4}"),
        _ => format!("{code} µs"),
    };
    format!(
        "{name:10}  channel {:2}  {percent:+6.1} %  {shown}\n",
        channel + 1
    )
}

/// What `SET_ATTITUDE_TARGET` says of a stick: it has no channels.
fn attitude_line(link: &RcLink, map: &ChannelMap, stick: usize, sticks: &Sticks) -> String {
    let name = STICKS[stick];
    match (stick, sticks.codes) {
        (1.., Some(codes)) => {
            let rate = link.rate_slope[stick - 1] * map.travel(codes[stick]).value();
            format!("{name:10}  {rate:+7.2} rad/s\n")
        }
        _ => format!("{name:10}  {:7.3} of the largest\n", map.thrust_share(sticks)),
    }
}

fn summary(report: &LinkReport) -> String {
    let counts = &report.counts;
    let late = |quantile| report.lateness_ns.value_at_quantile(quantile) as f64 * 1e-6;
    format!(
        "\n{} frames sent, {} dropped because others waited, {} because nothing took them; lost {} times, found again {}\n\
         late by {:.3} ms (half of them), {:.3} ms (99 of 100), {:.3} ms at most; {} left out\n",
        counts.sent,
        counts.busy,
        counts.closed,
        counts.losses,
        counts.recoveries,
        late(0.5),
        late(0.99),
        late(1.0),
        report.left_out
    )
}

/// `gerono rc identify`: fits the calibration of a link from a log.
///
/// # Errors
/// [`Failure`] if the log has nothing to fit.
pub fn identify(arguments: &RcIdentify) -> Result<(), Failure> {
    let found = link_identification::identify(&log_path(&arguments.log), arguments.from, arguments.mass)
        .map_err(Failure::trouble)?;
    if arguments.json {
        let text = serde_json::to_string_pretty(&found).map_err(Failure::trouble)?;
        print(text + "\n");
    } else {
        print(table(&found));
        print(snippet(&found));
    }
    Ok(())
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
                    || "too little moved".to_owned(),
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
        .map_or_else(String::new, |mass| format!("; thrusts are those of {mass} kg"));
    format!("{table}\n\nvalue = offset + slope · travel s, N and rad/s{mass}\n\n")
}

/// The part of a scenario that states what differs, and which sticks tell nothing.
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
    if text.is_empty() {
        let is_any_usable = found.sticks.iter().any(|stick| stick.usable().is_some());
        text += if is_any_usable {
            "Nothing differs from what is stated.\n"
        } else {
            "The flight tells nothing of any stick.\n"
        };
    } else {
        text = format!("Put into the scenario:\n\n[rc_output]\n{text}");
    }
    text + &too_short(found) + &unmoved(found)
}

/// Which sticks need a longer flight, if there are any.
fn too_short(found: &Identification) -> String {
    let of_stick = |stick: &Calibration| Some(format!("{} needs {:.0} s", stick.stick, stick.needed?));
    let short: Vec<_> = found.sticks.iter().filter_map(of_stick).collect();
    if short.is_empty() {
        return String::new();
    }
    format!(
        "\nAs stated, because the flight is too short for intervals that hold: {}.\n",
        short.join(", ")
    )
}

/// Which sticks moved too little, if there are any.
fn unmoved(found: &Identification) -> String {
    let unmoved = found
        .sticks
        .iter()
        .filter(|stick| stick.needed.is_none() && stick.usable().is_none());
    let unmoved: Vec<_> = unmoved.map(|stick| stick.stick).collect();
    if unmoved.is_empty() {
        return String::new();
    }
    format!(
        "\nAs stated, because the stick explains less than {:.0} % of what was measured: {}. Fly a path that moves it, up and \
         down or around.\n",
        100.0 * EXPLAINS,
        unmoved.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::Transmitter;

    #[test]
    fn a_sweep_goes_from_the_middle_to_both_ends_and_back_without_a_jump() {
        assert_eq!([0.0, 0.25, 0.5, 0.75, 1.0].map(sweep), [0.0, 1.0, 0.0, -1.0, 0.0]);
        let travels: Vec<f64> = (0..=1000).map(|step| sweep(f64::from(step) / 1000.0)).collect();
        assert!(travels.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.0041));
    }

    #[test]
    fn nothing_that_a_probe_sends_is_armed_and_only_one_stick_moves() {
        for (slope, reversed, least) in [
            (3.0, "", -1.0),
            (3.0, "T", 1.0),
            (-3.0, "", 1.0),
            (-3.0, "T", -1.0),
        ] {
            let transmitter = Transmitter {
                arming_channel: Some(5),
                reversed: reversed.to_owned(),
                ..Transmitter::default()
            };
            let link = RcLink {
                thrust_slope: slope,
                ..RcLink::default()
            };
            let map = ChannelMap::new(&link, &transmitter);
            for &stick in moved_sticks(true) {
                for travel in [-1.0, -0.3, 1.0] {
                    let sticks = one_stick(&map, stick, StickTravel::new(travel));
                    let travels = map.travels(&sticks).map(|sent| sent.map(SentTravel::value));
                    assert_eq!(travels[4], Some(-1.0), "disarmed");
                    for (other, &channel) in map.stick_channels().iter().enumerate() {
                        let turned = if stick == 0 && reversed == "T" {
                            -travel
                        } else {
                            travel
                        };
                        let rest = if other == 0 { least } else { 0.0 };
                        let wanted = if other == stick { turned } else { rest };
                        assert!((travels[channel].unwrap() - wanted).abs() < 1e-3);
                    }
                }
            }
        }
        assert!(!moved_sticks(false).contains(&0));
    }

    #[test]
    fn a_probe_of_attitude_targets_says_what_they_carry() {
        let link = RcLink {
            thrust_slope: -3.0,
            ..RcLink::default()
        };
        let map = ChannelMap::new(&link, &Transmitter::default());
        let shown = |stick, travel| {
            let sticks = one_stick(&map, stick, StickTravel::new(travel));
            attitude_line(&link, &map, stick, &sticks)
        };
        assert_eq!(shown(0, -1.0), "thrust        1.000 of the largest\n");
        assert_eq!(shown(0, 1.0), "thrust        0.000 of the largest\n");
        assert_eq!(shown(1, 1.0), "roll rate    -19.00 rad/s\n");
        assert_eq!(shown(3, -1.0), "yaw rate      +8.00 rad/s\n");
    }
}
