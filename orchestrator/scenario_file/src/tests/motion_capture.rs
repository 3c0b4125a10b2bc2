//! Poses of a laboratory's motion-capture system.

use scenario::{CaptureSystem, PoseSource};

use super::*;

const SYSTEM: &str = r#"
[motion_capture]
source = "vrpn"
server = "192.168.10.1"
port = 3884
interface = "192.168.10.7"
object = "quad"
latency = 0.003
rate = [90.0, 110.0]
max_speed = 6.0
settle = 0.2
world_from_capture = { position = [0.1, 0.2, 0.3], roll_pitch_yaw = [3.14159, 0.0, 0.0] }
"#;

/// The laboratory with a source of poses in place of the plant's cameras.
fn in_the_laboratory() -> String {
    LABORATORY.to_owned() + SYSTEM
}

#[test]
fn a_system_is_read_as_it_is_written_and_the_rest_has_defaults() {
    let scenario = load_text(&in_the_laboratory(), &[]).unwrap();
    let (name, system) = scenario.capture_system().unwrap();
    assert_eq!(name, CaptureSystem::Vrpn);
    assert_eq!((system.port, system.rate), (Some(3884), [90.0, 110.0]));
    assert_eq!(
        system.world_from_capture.as_ref().unwrap().position,
        [0.1, 0.2, 0.3]
    );
    assert_eq!(system.body_from_markers, None);
    assert_eq!(system.max_turn_rate, 35.0);
}

#[test]
fn poses_are_simulated_unless_a_source_is_stated_and_a_system_may_wait() {
    let text = with(&in_the_laboratory(), "source = \"vrpn\"", "");
    let scenario = load_text(&text, &[]).unwrap();
    assert_eq!(scenario.pose_source(), PoseSource::Simulated);
    let scenario = load_text(&text, &["motion_capture.source=natnet"]).unwrap();
    assert_eq!(scenario.pose_source(), PoseSource::Natnet);
}

#[test]
fn a_source_that_nothing_is_known_of_is_refused() {
    let text = with(&in_the_laboratory(), "object = \"quad\"", "");
    let line = line_of(&text, "source = \"vrpn\"");
    refused_on_line(
        &text,
        line,
        &[
            "the server of `vrpn` and the vehicle's body are not both stated",
            "help: add `server` and `object`",
        ],
    );
}

#[test]
fn what_moved_from_the_estimator_is_told_its_new_place() {
    for key in ["source", "recording"] {
        let line = format!("{key} = \"vrpn\"");
        let text = with(
            &in_the_laboratory(),
            "[estimator.kalman]",
            &format!("[estimator]\n{line}\n\n[estimator.kalman]"),
        );
        let fix = format!("`{key}` belongs to `motion_capture`: write it directly below `[motion_capture]`");
        let at = line_of(&text, "[estimator]") + 1;
        refused_on_line(&text, at, &["is unknown", &fix]);
    }
}

#[test]
fn cameras_of_poses_need_a_filter() {
    let text = with(&in_the_laboratory(), "[estimator.kalman]", "");
    let shown = narrated(&load_text(&text, &[]).unwrap_err());
    assert!(shown.contains("there is no estimator"), "{shown}");
}

#[test]
fn what_no_laboratory_has_is_refused_at_its_line() {
    for (part, replacement, pieces) in [
        (
            "source = \"vrpn\"",
            "source = \"vprn\"",
            ["`vprn` is not known here", "did you mean `vrpn`?"],
        ),
        (
            "server = \"192.168.10.1\"",
            "server = \"vicon.local\"",
            ["`vicon.local` is not an IPv4 address", "names are not resolved"],
        ),
        (
            "interface = \"192.168.10.7\"",
            "interface = \"0.0.0.0\"",
            [
                "packets would be accepted on all interfaces",
                "help: give the address of one interface",
            ],
        ),
        (
            "object = \"quad\"",
            "object = \"quad#one\"",
            ["there is no number after the #", "help: write it as `quad`"],
        ),
        (
            "object = \"quad\"",
            "object = \"#3\"",
            ["the vehicle's body has no name", "help: give the body's name"],
        ),
        (
            "rate = [90.0, 110.0]",
            "rate = [110.0, 90.0]",
            ["is not a range of rates", "the smaller one first"],
        ),
    ] {
        let text = with(&in_the_laboratory(), part, replacement);
        refused_on_line(&text, line_of(&text, replacement), &pieces);
    }
}

#[test]
fn a_name_is_as_long_as_the_protocol_lets_it_be() {
    let long = "q".repeat(25);
    let sets = [format!("motion_capture.object={long}")];
    let set = |source: &str| {
        let text = in_the_laboratory();
        let source = format!("motion_capture.source={source}");
        load_text(&text, &[sets[0].as_str(), source.as_str()])
    };
    assert!(set("vrpn").is_ok());
    let shown = narrated(&set("vicon_udp").unwrap_err());
    assert!(shown.contains("a name of 25 bytes, more than 24"), "{shown}");
}

#[test]
fn a_transform_states_its_turn_because_it_replaces_that_of_the_system() {
    let turn = ", roll_pitch_yaw = [3.14159, 0.0, 0.0]";
    let text = with(&in_the_laboratory(), turn, "");
    let line = line_of(&text, "world_from_capture");
    refused_on_line(&text, line, &["roll_pitch_yaw"]);
}
