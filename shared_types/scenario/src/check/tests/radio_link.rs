//! Radio link of frames.

use super::assert_only;
use crate::tests_support::rig;
use crate::{ChannelSwitch, MultiModule, Problem, RadioProtocol, Scenario, Transmitter};

/// The problems of a flight in the laboratory whose frames leave on a link, after its transmitter has been spoilt.
fn problems(link: RadioProtocol, spoil: impl FnOnce(&mut Transmitter)) -> Vec<Problem> {
    let is_serial = link.properties().serial;
    let mut transmitter = Transmitter {
        device: is_serial.then(|| "/dev/ttyUSB0".to_owned()),
        uri: (!is_serial).then(|| "radio://0/80/2M/E7E7E7E7E7".to_owned()),
        ..Transmitter::default()
    };
    spoil(&mut transmitter);
    let mut scenario = rig();
    let stated = scenario.rc_output.as_mut().unwrap();
    (stated.link, stated.transmitter) = (link, Some(transmitter));
    scenario.problems()
}

#[track_caller]
fn refused(link: RadioProtocol, spoil: impl FnOnce(&mut Transmitter), key: &str, reason: &str, fix: &str) {
    assert_only(
        &problems(link, spoil),
        &format!("rc_output.transmitter{key}"),
        reason,
        fix,
    );
}

const LINKS: [RadioProtocol; RadioProtocol::ALL.len()] = RadioProtocol::ALL;

#[test]
fn every_link_goes_by_a_serial_device_or_a_dongle_with_its_defaults() {
    for link in LINKS {
        assert_eq!(problems(link, |_| {}), []);
    }
}

#[test]
fn a_link_without_a_transmitter_and_a_transmitter_without_a_link_are_refused() {
    let spoilt = |link, transmitter| {
        let mut scenario: Scenario = rig();
        let stated = scenario.rc_output.as_mut().unwrap();
        (stated.link, stated.transmitter) = (link, transmitter);
        scenario.problems()
    };
    let without = spoilt(RadioProtocol::Crsf, None);
    assert_only(
        &without,
        "rc_output.link",
        "the destination of the frames of `crsf` is not stated",
        "[rc_output.transmitter]",
    );
    let simulated = spoilt(RadioProtocol::Simulated, Some(Transmitter::default()));
    assert_only(
        &simulated,
        "rc_output.transmitter",
        "no transmitter",
        "state the `link`",
    );
}

#[test]
fn frames_go_to_one_place_that_the_link_knows() {
    use RadioProtocol::{Crsf, Mavlink, Msp};
    let address = || Some("127.0.0.1:5761".to_owned());
    refused(
        Crsf,
        |stated| stated.device = None,
        "",
        "exactly one destination",
        "state `device`",
    );
    refused(
        Msp,
        |stated| stated.tcp = address(),
        "",
        "exactly one destination",
        "`device` and `tcp`",
    );
    for (link, is_tcp) in [(Crsf, true), (Msp, false), (Mavlink, true)] {
        let spoil = |stated: &mut Transmitter| {
            stated.device = None;
            *(if is_tcp { &mut stated.tcp } else { &mut stated.udp }) = address();
        };
        let key = if is_tcp { ".tcp" } else { ".udp" };
        refused(link, spoil, key, "is not sent by", "state");
    }
    let named = |stated: &mut Transmitter| {
        (stated.device, stated.udp) = (None, Some("autopilot:14540".to_owned()));
    };
    refused(Mavlink, named, ".udp", "not an address with a port", "127.0.0.1");
    let reached = |stated: &mut Transmitter| (stated.device, stated.tcp) = (None, address());
    assert_eq!(problems(Msp, reached), []);
}

#[test]
fn a_crazyflie_has_an_address_of_its_own_kind_and_no_channels() {
    use RadioProtocol::{Crazyflie, Crsf};
    let at = |uri: &'static str| move |stated: &mut Transmitter| stated.uri = Some(uri.to_owned());
    for uri in [
        "udp://127.0.0.1:19850",
        "radio://1/100/1M/E7E7E7E701",
        "radio://0/80",
    ] {
        assert_eq!(problems(Crazyflie, at(uri)), []);
    }
    for (uri, reason, fix) in [
        (
            "udp://localhost:19850",
            "`localhost:19850` is not an address with a port",
            "not resolved",
        ),
        (
            "usb://0",
            "neither with `udp://` nor with `radio://`",
            "radio://0/80/2M/E7E7E7E7E7",
        ),
        (
            "radio://0/200/2M",
            "`200` is not a channel from 0 to 125",
            "udp://127.0.0.1:19850",
        ),
    ] {
        refused(Crazyflie, at(uri), ".uri", reason, fix);
    }
    let by_device = |stated: &mut Transmitter| {
        (stated.uri, stated.device) = (None, Some("/dev/ttyUSB0".to_owned()));
    };
    refused(
        Crazyflie,
        by_device,
        ".device",
        "`crazyflie` is not sent by `device`",
        "state `uri`, and nothing else",
    );
    let by_uri = |stated: &mut Transmitter| {
        (stated.device, stated.uri) = (None, Some("radio://0/80".to_owned()));
    };
    refused(Crsf, by_uri, ".uri", "is not sent by `uri`", "state `device`");
    refused(
        Crazyflie,
        |stated| stated.arming_channel = Some(5),
        ".arming_channel",
        "the packets of `crazyflie` have no channels",
        "leave `arming_channel` out",
    );
}

#[test]
fn a_rate_that_the_line_cannot_carry_is_refused_with_the_largest_that_it_can() {
    refused(
        RadioProtocol::Crsf,
        |stated| (stated.baud, stated.frame_rate) = (Some(115_200), Some(500.0)),
        ".frame_rate",
        "at 115200 baud the line carries 443 frames per second",
        "at most 443",
    );
    let by_udp = |stated: &mut Transmitter| {
        stated.udp = Some("127.0.0.1:14540".to_owned());
        (stated.device, stated.baud) = (None, Some(57_600));
    };
    refused(
        RadioProtocol::Mavlink,
        by_udp,
        ".baud",
        "only a serial device",
        "leave `baud` out",
    );
}

/// Change that spoils a transmitter, the key of the problem, and its reason.
type Spoilt = (fn(&mut Transmitter), &'static str, &'static str);

#[test]
fn channels_that_no_receiver_would_understand_are_refused() {
    let cases: [Spoilt; 11] = [
        (
            |stated| stated.order = "AETT".to_owned(),
            ".order",
            "every stick once",
        ),
        (
            |stated| stated.order = "AET".to_owned(),
            ".order",
            "every stick once",
        ),
        (
            |stated| stated.reversed = "EX".to_owned(),
            ".reversed",
            "`X` is not a stick",
        ),
        (
            |stated| stated.reversed = "EE".to_owned(),
            ".reversed",
            "is listed twice",
        ),
        (
            |stated| stated.thrust_ends = [1.0, -1.0],
            ".thrust_ends",
            "from a lower to a higher",
        ),
        (
            |stated| stated.rate_ends = [-1.0, 1.5],
            ".rate_ends",
            "1.5 is not a travel",
        ),
        (
            |stated| stated.failsafe = Some([-1.0, 0.0, 9.0, 0.0]),
            ".failsafe",
            "is not a travel",
        ),
        (|stated| stated.others = Some(-2.0), ".others", "is not a travel"),
        (
            |stated| stated.arming = [1.0, 1.0],
            ".arming",
            "have the same travel",
        ),
        (
            |stated| stated.switch = vec![switch(6, 2.0)],
            ".switch.0.travel",
            "is not a travel",
        ),
        (
            |stated| (stated.arming_channel, stated.switch) = (Some(6), vec![switch(6, 0.0)]),
            ".switch.0.channel",
            "already in use",
        ),
    ];
    for (spoil, key, reason) in cases {
        refused(RadioProtocol::Crsf, spoil, key, reason, "give");
    }
}

fn switch(channel: u32, travel: f64) -> ChannelSwitch {
    ChannelSwitch { channel, travel }
}

#[test]
fn settings_of_a_link_need_that_link() {
    refused(
        RadioProtocol::Crsf,
        |stated| stated.multi = Some(MultiModule::default()),
        ".multi",
        "the link is `crsf`",
        "leave `multi` out",
    );
}
