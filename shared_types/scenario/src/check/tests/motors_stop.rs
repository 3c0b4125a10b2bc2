//! What stops the motors is no thrust: a stated failsafe, and a channel without an arming switch.

use super::assert_only;
use crate::tests_support::rig;
use crate::{Mavlink, MavlinkMessage, Problem, RadioProtocol, RcLink, Transmitter};

/// Change of a link and its transmitter.
type Change = fn(&mut RcLink, &mut Transmitter);

/// The problems of a flight in the laboratory by CRSF, unless it is changed.
fn problems(change: impl FnOnce(&mut RcLink, &mut Transmitter)) -> Vec<Problem> {
    let mut transmitter = Transmitter {
        device: Some("/dev/ttyUSB0".to_owned()),
        ..Transmitter::default()
    };
    let mut scenario = rig();
    let link = scenario.rc_output.as_mut().unwrap();
    link.link = RadioProtocol::Crsf;
    change(link, &mut transmitter);
    link.transmitter = Some(transmitter);
    scenario.problems()
}

#[test]
fn a_channel_that_means_thrust_where_a_receiver_has_lost_the_link_needs_an_arming_switch() {
    for (slope, reversed, turns) in [
        (3.138, "", false),
        (3.138, "T", true),
        (-3.138, "", true),
        (-3.138, "T", false),
        (3.138, "AER", false),
    ] {
        let state = |link: &mut RcLink, stated: &mut Transmitter| {
            (link.thrust_slope, stated.reversed) = (slope, reversed.to_owned());
        };
        let found = problems(state);
        if turns {
            assert_only(
                &found,
                "rc_output.transmitter.arming_channel",
                "-100 %, which commands 5.4451 N",
                "`arming_channel`",
            );
        } else {
            assert_eq!(found, [], "{slope} {reversed:?}");
        }
        let with_switch = problems(|link, stated| {
            state(link, stated);
            stated.arming_channel = Some(5);
        });
        assert_eq!(with_switch, [], "{slope} {reversed:?}");
    }
}

/// The ends of the stick are beyond those of the link, and −100 % is a thrust of 0.0909 · 3 N.
#[test]
fn a_scaled_channel_whose_lowest_travel_is_beyond_that_of_a_lost_link_needs_an_arming_switch() {
    let scaled = |link: &mut RcLink, stated: &mut Transmitter| {
        (link.thrust_offset, link.thrust_slope, stated.thrust_ends) = (3.0, 3.0, [-1.1, 1.1]);
    };
    assert_only(
        &problems(scaled),
        "rc_output.transmitter.arming_channel",
        "which commands 0.272727 N",
        "`arming_channel`",
    );
    // At the ends of the link itself it is none.
    assert_eq!(
        problems(|link, _| (link.thrust_offset, link.thrust_slope) = (3.0, 3.0)),
        []
    );
}

#[test]
fn a_link_without_a_travel_of_no_thrust_needs_an_arming_switch() {
    let idles = |link: &mut RcLink| link.thrust_offset = 3.4;
    assert_only(
        &problems(|link, _| idles(link)),
        "rc_output.transmitter.arming_channel",
        "the least thrust of the channel is 0.262 N",
        "`arming_channel`",
    );
    let armed = |link: &mut RcLink, stated: &mut Transmitter| {
        idles(link);
        stated.arming_channel = Some(5);
    };
    assert_eq!(problems(armed), []);
    // A travel beyond the end of the stick stops the motors too.
    let beyond = |link: &mut RcLink, stated: &mut Transmitter| {
        armed(link, stated);
        stated.failsafe = Some([-1.1, 0.0, 0.0, 0.0]);
    };
    assert_eq!(problems(beyond), []);
}

#[test]
fn a_stated_failsafe_that_means_thrust_is_refused_with_or_without_an_arming_switch() {
    for (slope, reversed, travel, turns) in [
        (3.138, "", -1.0, false),
        (3.138, "", -0.8, false),
        (3.138, "", 0.0, true),
        (3.138, "T", -1.0, true),
        (3.138, "T", 1.0, false),
        (-3.138, "", -1.0, true),
        (-3.138, "", 1.0, false),
        (-3.138, "T", 1.0, true),
    ] {
        let found = problems(|link, stated| {
            (link.thrust_slope, stated.reversed) = (slope, reversed.to_owned());
            (stated.arming_channel, stated.failsafe) = (Some(5), Some([travel, 0.0, 0.0, 0.0]));
        });
        if turns {
            assert_only(
                &found,
                "rc_output.transmitter.failsafe",
                " N",
                "leave `failsafe` out",
            );
        } else {
            assert_eq!(found, [], "{slope} {reversed:?} {travel}");
        }
    }
    let only = problems(|_, stated| stated.failsafe = Some([0.2, 0.0, 0.0, 0.0]));
    assert_only(
        &only,
        "rc_output.transmitter.failsafe",
        "commands 2.9347 N",
        "give -1.0",
    );
}

#[test]
fn attitude_targets_have_no_switches_and_no_thrust_at_a_share_of_none() {
    let by_mavlink = |change: Change, message| {
        problems(|link, stated| {
            link.link = RadioProtocol::Mavlink;
            stated.mavlink = Some(Mavlink {
                message,
                ..Mavlink::default()
            });
            change(link, stated);
        })
    };
    let changes: [(&str, Change); 4] = [
        ("arming_channel", |_, stated| stated.arming_channel = Some(5)),
        ("others", |_, stated| stated.others = Some(-1.0)),
        ("failsafe", |_, stated| {
            stated.failsafe = Some([-1.0, 0.0, 0.0, 0.0]);
        }),
        ("switch", |_, stated| {
            stated.switch = vec![crate::ChannelSwitch {
                channel: 6,
                travel: 1.0,
            }];
        }),
    ];
    for (name, change) in changes {
        let found = by_mavlink(change, MavlinkMessage::AttitudeTarget);
        let key = format!("rc_output.transmitter.{name}");
        assert_only(&found, &key, "has no channels", "rc_override");
        assert_eq!(by_mavlink(change, MavlinkMessage::RcOverride), []);
    }
    // Neither a reversal nor the sense of the slope acts on a share.
    let turned: Change = |link, stated| {
        (link.thrust_slope, stated.reversed) = (-3.138, "T".to_owned());
    };
    assert_eq!(by_mavlink(turned, MavlinkMessage::AttitudeTarget), []);
    let to_a_crazyflie = problems(|link, stated| {
        (link.link, link.thrust_offset) = (RadioProtocol::Crazyflie, 3.4);
        (stated.device, stated.uri) = (None, Some("radio://0/80".to_owned()));
    });
    assert_only(
        &to_a_crazyflie,
        "rc_output.transmitter.uri",
        "would command 0.262 N",
        "`thrust_offset`",
    );
    let found = by_mavlink(|link, _| link.thrust_offset = 3.4, MavlinkMessage::AttitudeTarget);
    assert_only(
        &found,
        "rc_output.transmitter.mavlink.message",
        "would command 0.262 N",
        "`thrust_offset`",
    );
}

/// Pulses beyond 900 to 2100 µs are broken to a flight controller, and would be cut to them.
#[test]
fn travels_that_a_link_would_cut_are_refused() {
    for (link, most) in [
        (RadioProtocol::Crsf, 1.17),
        (RadioProtocol::Sbus, 1.17),
        (RadioProtocol::Multi, 1.24),
        (RadioProtocol::Msp, 1.2),
        (RadioProtocol::Mavlink, 1.2),
    ] {
        let ends = |reach: f64| {
            problems(|rc, stated| {
                (rc.link, stated.thrust_ends) = (link, [-1.0, reach]);
            })
        };
        assert_eq!(ends(most), []);
        assert_only(
            &ends(most + 0.01),
            "rc_output.transmitter.thrust_ends",
            "is not a travel",
            &format!("to {most:?}"),
        );
    }
}
