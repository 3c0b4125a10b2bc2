//! `gerono rc` with a receiver on a pseudo-terminal, and with the log of a flight.

use crate::common;

use std::os::fd::OwnedFd;
use std::process::Command;

use common::laboratory::serial_line;
use common::{Place, output, scenario};
use radio_link::crsf;
use serde_json::Value;

/// `gerono rc probe` of figure 7's link as CRSF on a device.
fn probe(place: &Place, device: &str, more: &[&str]) -> Command {
    let fig7 = scenario("fig7");
    let transmitter = format!("rc_output.transmitter={{device = \"{device}\", arming_channel = 5}}");
    let mut arguments = vec!["rc", "probe", fig7.to_str().unwrap(), "--seconds", "0.2"];
    arguments.extend(["--set", "rc_output.link=crsf", "--set", &transmitter]);
    arguments.extend(more);
    place.gerono(&arguments)
}

/// All frames that wait at the receiver's end.
fn frames(master: &OwnedFd) -> Vec<radio_link::ChannelCodes> {
    let (mut bytes, mut piece) = (Vec::new(), [0; 4096]);
    // Nobody has the other end any more: after what waits, reading fails.
    while let Ok(count @ 1..) = rustix::io::read(master, &mut piece) {
        bytes.extend_from_slice(&piece[..count]);
    }
    assert_eq!(bytes.len() % crsf::LENGTH, 0);
    let frames = bytes.chunks_exact(crsf::LENGTH);
    frames.map(|frame| crsf::decode(frame).unwrap()).collect()
}

#[test]
fn a_probe_moves_one_stick_after_another_and_never_arms() {
    let place = Place::new();
    let (master, device) = serial_line();
    let shown = String::from_utf8(output(&mut probe(&place, &device, &[])).stdout).unwrap();
    for piece in [
        "roll rate   channel  1",
        "thrust      channel  3",
        "frames sent",
        "disarmed",
    ] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
    let frames = frames(&master);
    let rest = [992, 992, 172, 992];
    for channels in &frames {
        let moved = channels
            .iter()
            .zip(&rest)
            .filter(|(code, rest)| code.abs_diff(**rest) > 1);
        assert!(moved.count() <= 1, "{channels:?}");
        assert_eq!(channels[4], 172, "disarmed");
    }
    for channel in 0..4 {
        let moved = frames
            .iter()
            .any(|channels| channels[channel].abs_diff(rest[channel]) > 100);
        assert!(moved, "channel {} has never moved", channel + 1);
    }
    assert_eq!(frames.last().unwrap()[..4], rest);
}

#[test]
fn without_an_arming_switch_the_thrust_stick_rests() {
    let place = Place::new();
    let (master, device) = serial_line();
    let unarmed = format!("rc_output.transmitter={{device = \"{device}\"}}");
    output(&mut probe(&place, &device, &["--set", &unarmed]));
    let frames = frames(&master);
    assert!(!frames.is_empty() && frames.iter().all(|channels| channels[2] == 172));
}

#[test]
fn a_device_that_is_not_there_and_a_link_that_is_simulated_are_refused_with_the_fix() {
    let place = Place::new();
    let refused = |mut command: Command| {
        let output = command.output().unwrap();
        assert!(!output.status.success());
        String::from_utf8(output.stderr).unwrap()
    };
    let missing = refused(probe(&place, "/dev/no-such-radio", &[]));
    assert!(missing.contains("is it plugged in?"), "{missing}");
    let fig7 = scenario("fig7");
    let simulated = refused(place.gerono(&["rc", "probe", fig7.to_str().unwrap()]));
    assert!(simulated.contains("docs/radio_links.md"), "{simulated}");
}

#[test]
fn a_calibration_comes_back_from_a_log_as_a_table_and_as_json() {
    let place = Place::new();
    let (fig7, out) = (scenario("fig7"), place.path("run"));
    let out = out.to_str().unwrap();
    let mut flight = vec![
        "run",
        fig7.to_str().unwrap(),
        "--host",
        "inprocess",
        "--quiet",
        "--out",
        out,
    ];
    flight.extend([
        "--set",
        "duration=35.0",
        "--set",
        "vehicle.actuators.rate_factor=[0.9, 1.0, 1.0]",
    ]);
    output(&mut place.gerono(&flight));
    let json = output(&mut place.gerono(&["rc", "identify", out, "--from", "truth", "--json"])).stdout;
    let found: Value = serde_json::from_slice(&json).unwrap();
    let slope = found["sticks"][1]["fitted"]["slope"].as_f64().unwrap();
    assert!((slope + 0.9 * 19.0).abs() < 0.1, "{slope}");
    let shown = String::from_utf8(output(&mut place.gerono(&["rc", "identify", out])).stdout).unwrap();
    // By poses the yaw stick, which rests in hover, keeps what was stated.
    for piece in ["rate_slope = [-1", "-8.0000]", "yaw rate", "[rc_output]"] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}
