//! `gerono mocap`: one process seems to be a motion-capture system, another listens to it.

use crate::common;

use std::net::UdpSocket;
use std::process::{Child, Output};
use std::time::Duration;

use common::ports::free_port;
use common::{Place, output, said};
use motion_capture::natnet::{ServerInfo, Version};

/// A process that is ended with the test.
struct Sender(Child);

impl Drop for Sender {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Sends as a system, and listens to it.
fn probed(place: &Place, system: &str, send: &[&str], probe: &[&str]) -> Output {
    let (port, frames) = (free_port().to_string(), free_port().to_string());
    // Vicon sends to the port of the listener, NatNet is asked at one and sends to another.
    let to = format!("127.0.0.1:{}", if system == "vicon" { &port } else { &frames });
    let at = [
        "mocap",
        "send",
        "--as",
        system,
        "--port",
        &port,
        "--to",
        &to,
        "--seconds",
        "60",
    ];
    let sender = place.gerono(&[&at[..], send].concat()).spawn().unwrap();
    let _sender = Sender(sender);
    let from = [
        "mocap",
        "probe",
        "--source",
        system,
        "--port",
        &port,
        "--seconds",
        "3",
    ];
    output(&mut place.gerono(&[&from[..], probe].concat()))
}

#[test]
fn every_system_that_is_sent_is_heard_and_believed() {
    let place = Place::in_real_time();
    for (system, send) in [
        ("vrpn", &[][..]),
        ("natnet", &["--natnet", "3.1"]),
        ("natnet", &["--natnet", "4.1"]),
        ("natnet", &["--natnet", "4.2"]),
        ("vicon", &[]),
    ] {
        let output = probed(&place, system, send, &["--object", "quad"]);
        let text = said(&output);
        assert!(output.status.success(), "{system}: {text}");
        assert!(
            text.contains("believed") && text.contains("malformed 0, from strangers 0"),
            "{text}"
        );
        // One row for the body, whose name is shown in quotes.
        assert!(text.contains(" `quad` ") && !text.contains("no name"), "{text}");
    }
}

#[test]
fn a_name_that_is_nearly_the_sent_one_is_offered() {
    let place = Place::in_real_time();
    for (system, offered) in [
        ("vrpn", "announced: `Quad `"),
        ("natnet", "announced: `Quad `, which is `#1`"),
        ("vicon", "announced: `Quad `"),
    ] {
        let output = probed(&place, system, &["--object", "Quad "], &["--object", "quad"]);
        let text = said(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(text.contains(&format!("was accepted; {offered}")), "{text}");
    }
}

/// A probe refuses what `gerono check` refuses in a scenario.
#[test]
fn what_a_scenario_may_not_state_cannot_be_probed() {
    let place = Place::in_real_time();
    for (arguments, words) in [
        (
            ["--source", "vicon", "--object", "quadcopter_experiment_number_01"],
            "a name of 31 bytes, more than 24",
        ),
        (
            ["--source", "vrpn", "--interface", "0.0.0.0"],
            "on all interfaces",
        ),
        (
            ["--source", "natnet", "--object", "quad#one"],
            "there is no number after the #",
        ),
    ] {
        let output = output(&mut place.gerono(&[&["mocap", "probe"], &arguments[..]].concat()));
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains(words), "{}", said(&output));
    }
}

/// A Motive of a version that is not understood, which answers every request until the test ends.
#[test]
fn a_version_of_natnet_that_is_not_understood_is_named() {
    let place = Place::in_real_time();
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    server.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let port = server.local_addr().unwrap().port().to_string();
    let info = ServerInfo {
        version: Version { major: 2, minor: 8 },
        clock_frequency: 1_000_000,
        data_port: 1511,
        multicast: None,
    };
    let mut probe = place.gerono(&[
        "mocap",
        "probe",
        "--source",
        "natnet",
        "--port",
        &port,
        "--seconds",
        "2",
    ]);
    let probe = std::thread::spawn(move || output(&mut probe));
    let mut question = [0; 64];
    while !probe.is_finished() {
        let Ok((_, client)) = server.recv_from(&mut question) else {
            break;
        };
        server
            .send_to(&motion_capture::natnet::sender::server_info(&info), client)
            .unwrap();
        server.set_read_timeout(Some(Duration::from_secs(1))).unwrap();
    }
    let text = said(&probe.join().unwrap());
    assert!(
        text.contains("no frame could be decoded")
            && text.contains("Motive sends NatNet 2.8; 3.x and 4.x are supported"),
        "{text}"
    );
}

#[test]
fn a_body_that_nobody_sends_is_named_with_those_that_came() {
    let place = Place::in_real_time();
    let output = probed(&place, "vrpn", &[], &["--object", "drone"]);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(
        text.contains("no pose of `drone` was accepted") && text.contains(" `quad` "),
        "{text}"
    );
}

#[test]
fn nobody_there_is_told_as_that() {
    let place = Place::in_real_time();
    let port = free_port().to_string();
    let arguments = [
        "mocap",
        "probe",
        "--source",
        "vrpn",
        "--port",
        &port,
        "--seconds",
        "0.5",
    ];
    let output = output(&mut place.gerono(&arguments));
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("nothing was received from 127.0.0.1"));
}

/// A pipe has no live line: what is missing is said before the end, and once.
#[test]
fn a_hand_test_without_cameras_says_so_while_it_waits() {
    let place = Place::in_real_time();
    let port = format!("motion_capture.port={}", free_port());
    let address = [
        "--set",
        "motion_capture.server='127.0.0.1'",
        "--set",
        "motion_capture.interface='127.0.0.1'",
    ];
    let laboratory = common::scenario("laboratory");
    let mut arguments = vec![
        "lab",
        "check",
        laboratory.to_str().unwrap(),
        "--set",
        &port,
        "--seconds",
        "5.2",
    ];
    arguments.extend(address);
    let output = output(&mut place.gerono(&arguments));
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let shown = String::from_utf8(output.stdout).unwrap();
    let waits = "no pose so far: nothing was received from 127.0.0.1";
    assert_eq!(shown.matches(waits).count(), 1, "{shown}");
    assert!(!place.path("hand_test.json").exists());
}

/// The sections that were written are those of a scenario, and they let the body lie level at the origin.
#[test]
fn a_calibration_is_part_of_a_scenario() {
    let place = Place::in_real_time();
    let file = place.path("calibration.toml");
    let calibrate = ["--object", "quad", "--calibrate", file.to_str().unwrap()];
    let output = probed(&place, "natnet", &["--rest"], &calibrate);
    assert!(output.status.success(), "{}", said(&output));
    let written: toml::Table = std::fs::read_to_string(&file).unwrap().parse().unwrap();
    let stated = written["motion_capture"].clone();
    let stated: scenario::MotionCapture = stated.try_into().unwrap();
    assert_eq!(stated.source, scenario::PoseSource::Natnet);
    let calibration = motion_capture::conventions::Calibration::new(
        scenario::CaptureSystem::Natnet,
        stated.world_from_capture.as_ref(),
        stated.body_from_markers.as_ref(),
    );
    let sent = motion_capture::conventions::Calibration::new(scenario::CaptureSystem::Natnet, None, None);
    // The eight begins there, with the nose to the front right.
    let start = motion_capture::conventions::WorldPose {
        position_world: nalgebra::Vector3::new(0.0, -0.187_721, -1.185_226),
        world_from_body: shared_types::rotation::from_roll_pitch_yaw([0.0, 0.0, std::f64::consts::FRAC_PI_4]),
    };
    let pose = calibration.world_pose(&sent.capture_pose(&start));
    assert!(pose.position_world.norm() < 1e-3, "{pose:?}");
    assert!(
        (pose.world_from_body - nalgebra::Matrix3::identity()).norm() < 1e-2,
        "{pose:?}"
    );
}

#[test]
fn a_flight_never_takes_simulated_poses_for_those_of_a_network() {
    let place = Place::in_real_time();
    let scenario = common::scenario("fig3_6");
    let mut run = place.gerono(&[
        "run",
        scenario.to_str().unwrap(),
        "--out",
        "out",
        "--set",
        "motion_capture={source = \"vrpn\", server = \"127.0.0.1\", object = \"quad\"}",
    ]);
    let output = output(&mut run);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("motion_capture.source=simulated"));
    assert!(!place.path("out").exists());
}
