//! A port that cannot connect to that of another process of the run fails; without an observer it goes on.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::time::{Duration, Instant};

use runtime::ports::{BarePorts, Delivery, PortError, RunNode};
use rustix::process::{Resource, getrlimit, setrlimit};
use shared_types::{Schedule, ServiceId, Topic};

/// Runs `act` while this process may open no more files.
fn without_descriptors<R>(act: impl FnOnce() -> R) -> R {
    let limit = getrlimit(Resource::Nofile);
    let mut none = limit;
    none.current = Some(0);
    setrlimit(Resource::Nofile, none).unwrap();
    let done = act();
    setrlimit(Resource::Nofile, limit).unwrap();
    done
}

#[test]
fn a_missing_connection_is_an_error_unless_it_leads_to_an_observer() {
    let folder = tempfile::tempdir().unwrap();
    let configuration = folder.path().join("iceoryx2.toml");
    let prefix = format!("gerono_connections_{}_", std::process::id());
    let root = folder.path().join("root");
    let text = format!("[global]\nroot-path = {root:?}\nprefix = {prefix:?}\n");
    std::fs::write(&configuration, text).unwrap();
    let node = RunNode::join(&configuration, "connections").unwrap();
    let schedule = Schedule::ideal(1_000_000, 0);
    let create = |topic| node.create_topic(topic, &schedule, Delivery::NewestWins).unwrap();
    let others: Vec<_> = [Topic::ControlCommand, Topic::RcFrame].map(create).into();
    let ports = create(Topic::VehicleState);
    let mut sender = ports.newest_sender().unwrap();
    let mut send = || sender.loan().map(drop).and_then(|()| sender.send());

    let observer = BarePorts::open(&node, ServiceId::RcOutput, &schedule).unwrap();
    without_descriptors(&mut send).unwrap();
    let mut late = ports.receiver().unwrap();
    let at_first = without_descriptors(&mut send);
    let began = Instant::now();
    let failed = loop {
        match send() {
            Ok(()) => assert!(began.elapsed() < Duration::from_secs(10), "it does not fail"),
            Err(error) => break error,
        }
    };
    assert!(late.receive().is_ok_and(|has_come| !has_come));
    drop((late, observer));
    let recovered = send();
    drop((sender, ports, others, node));
    for segment in runtime::shared_memory::segments(&prefix) {
        std::fs::remove_file(segment).unwrap();
    }

    // The process of the other port might have been about to end.
    at_first.unwrap();
    let words = failed.to_string();
    assert!(
        words.contains("`vehicle/state`") && words.contains("`ulimit -n`"),
        "{words}"
    );
    assert!(matches!(failed, PortError::Unconnected { .. }), "{failed:?}");
    recovered.unwrap();
}
