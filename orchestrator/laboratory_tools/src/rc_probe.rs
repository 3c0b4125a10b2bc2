//! Test of a radio link on the ground: moves one stick after another, disarmed, and prints what the receiver should show.

use std::time::Duration;

use radio_link::channel_map::{ChannelMap, CodeUnit, SentTravel, StickTravel};
use radio_link::link::RadioLink;
use radio_link::sender::{LinkReport, Sender};
use radio_link::sticks::Sticks;
use scenario::{RadioProtocol, RcLink, Scenario};
use shared_types::service::nanoseconds;

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::print;
use flight::interrupt::Interrupt;
use identification::link::STICKS;

/// Period at which the sticks are updated, s.
const STEP: f64 = 0.01;

/// Time for which a Crazyflie whose motors may have turned gets stops, s: it counts as flying until 2 s after, and locks when packets
/// end before (`supervisor.c` of 2026.08).
const STOPS: f64 = 2.5;

/// Steps between two printed lines.
const SHOWN_EVERY: u64 = 25;

/// Tests the link of a scenario. Each stick moves from the middle to both ends and back in `seconds`; the thrust stick only
/// if the link has an arming switch or the propellers are off.
///
/// # Errors
/// [`Failure`] if the scenario's link is simulated, or its device cannot be used.
pub fn probe(scenario: &Scenario, seconds: f64, propellers_off: bool) -> Result<Exit, Failure> {
    let link = link_of(scenario)?;
    let transmitter = link.transmitter.as_ref().ok_or_else(no_link)?;
    // The values that the receiver shall show are those of the sticks, whatever the battery.
    let plain = RcLink {
        battery: None,
        ..link.clone()
    };
    let opened = RadioLink::open(&plain).map_err(Failure::trouble)?;
    let opened = opened.ok_or_else(no_link)?;
    let (map, units) = (opened.encoder().map().clone(), opened.encoder().units());
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let period_ns = nanoseconds(1.0 / transmitter.frame_rate_on(link.link));
    let sender = Sender::start(opened, period_ns).map_err(Failure::trouble)?;

    let moved = moved_sticks(transmitter.arming_channel.is_some() || propellers_off);
    print(introduction(link, moved));
    let steps = nanoseconds(seconds) / nanoseconds(STEP);
    for (stick, step) in positions(moved, steps, &interrupt) {
        let travel = StickTravel::new(sweep(step as f64 / steps.max(1) as f64));
        let sticks = one_stick(&map, stick, travel);
        sender.set(&sticks);
        if step % SHOWN_EVERY == 0 {
            print(if transmitter.has_channels(link.link) {
                let (channel, travels) = (map.stick_channels()[stick], map.travels(&sticks));
                let sent = travels[channel].map_or(f64::NAN, SentTravel::value);
                line(units.unit, stick, channel, sent, units.codes(&travels)[channel])
            } else {
                attitude_line(link, &map, stick, &sticks)
            });
        }
        std::thread::sleep(Duration::from_secs_f64(STEP));
    }
    sender.set(&Sticks::MOTORS_OFF);
    if link.link == RadioProtocol::Crazyflie && moved.contains(&0) {
        print("\nthe motors are kept still until the vehicle has landed for its firmware\n");
        std::thread::sleep(Duration::from_secs_f64(STOPS));
    }
    let report = sender
        .stop()
        .map_err(|_| Failure::trouble("the sender has failed"))?;
    print(summary(link.link, &report));
    let signal = interrupt.signal();
    if signal.is_none() && report.counts.is_lost() {
        return Err(Failure::trouble(
            "the link is lost: the receiver or the vehicle does not take the frames; see that it is switched on, and where they go",
        ));
    }
    Ok(signal.map_or(Exit::Success, Exit::Signal))
}

fn link_of(scenario: &Scenario) -> Result<&RcLink, Failure> {
    let link = scenario.rc_output.as_ref();
    link.filter(|link| !link.link.is_simulated()).ok_or_else(no_link)
}

fn no_link() -> Failure {
    let reason = "the scenario's radio link is simulated; state `rc_output.link` and `[rc_output.transmitter]`: see \
                  docs/radio_links.md";
    Failure::bad_input(reason)
}

/// Returns the sticks to move, thrust last. Without an arming switch the thrust stick could start the motors.
fn moved_sticks(with_thrust: bool) -> &'static [usize] {
    if with_thrust { &[1, 2, 3, 0] } else { &[1, 2, 3] }
}

/// Returns the sticks with their steps, in turn. After an interrupt there are no more, of any stick.
fn positions(moved: &[usize], steps: u64, interrupt: &Interrupt) -> impl Iterator<Item = (usize, u64)> {
    let all = moved
        .iter()
        .flat_map(move |&stick| (0..=steps).map(move |step| (stick, step)));
    all.take_while(|_| interrupt.signal().is_none())
}

/// Returns the travel of a stick at a share of its time: from the middle to one end, to the other, and back.
fn sweep(share: f64) -> f64 {
    let quarter = 4.0 * share;
    match quarter {
        up if up <= 1.0 => up,
        down if down <= 3.0 => 2.0 - down,
        back => back - 4.0,
    }
}

/// Returns disarmed sticks with one of them at a travel, and the others at minimum thrust or zero rate.
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
        "{}: disarmed; remove the propellers anyway. Each line states what the receiver should show.\n",
        link.link.name()
    );
    if !moved.contains(&0) {
        text += "The thrust stick is not moved: without an arming switch it could start the motors. --propellers-off includes it.\n";
    }
    text + "\n"
}

fn line(unit: CodeUnit, stick: usize, channel: usize, travel: f64, code: u16) -> String {
    let name = STICKS[stick];
    let percent = 100.0 * travel;
    let shown = match unit {
        CodeUnit::ReceiverStep => format!("code {code:4}, {:.0} µs", 1500.0 + 512.0 * travel),
        CodeUnit::Step => format!("code {code:4}"),
        CodeUnit::Pulse => format!("{code} µs"),
    };
    format!(
        "{name:10}  channel {:2}  {percent:+6.1} %  {shown}\n",
        channel + 1
    )
}

/// Formats a stick for `SET_ATTITUDE_TARGET`, which has no channels.
fn attitude_line(link: &RcLink, map: &ChannelMap, stick: usize, sticks: &Sticks) -> String {
    let name = STICKS[stick];
    match (stick, sticks.codes) {
        (1.., Some(codes)) => {
            let rate = link.rate_slope[stick - 1] * map.travel(codes[stick]).value();
            format!("{name:10}  {rate:+7.2} rad/s\n")
        }
        _ => format!("{name:10}  {:7.3} of the maximum\n", map.thrust_share(sticks)),
    }
}

fn summary(link: RadioProtocol, report: &LinkReport) -> String {
    let counts = &report.counts;
    let busy = match link {
        RadioProtocol::Crazyflie => "the vehicle did not acknowledge them",
        _ => "the link was busy",
    };
    let late = |quantile| report.lateness_ns.value_at_quantile(quantile) as f64 * 1e-6;
    format!(
        "\n{} frames sent, {} dropped because {busy}, {} because the link was closed; lost {} times, recovered {} times\n\
         lateness: median {:.3} ms, p99 {:.3} ms, maximum {:.3} ms; {} frames skipped\n",
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
    fn an_interrupt_ends_the_movement_of_all_sticks() {
        let interrupt = Interrupt::never();
        let moved = moved_sticks(true);
        assert_eq!(positions(moved, 10, &interrupt).count(), 4 * 11);
        let mut positions = positions(moved, 10, &interrupt);
        assert_eq!(positions.nth(2), Some((1, 2)));
        interrupt.raise(2);
        assert_eq!(positions.next(), None);
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
        assert_eq!(shown(0, -1.0), "thrust        1.000 of the maximum\n");
        assert_eq!(shown(0, 1.0), "thrust        0.000 of the maximum\n");
        assert_eq!(shown(1, 1.0), "roll rate    -19.00 rad/s\n");
        assert_eq!(shown(3, -1.0), "yaw rate      +8.00 rad/s\n");
    }
}
