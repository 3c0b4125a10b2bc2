//! Encoder of the stream of a VRPN server.

use super::{HEADER, POSE_TYPE, PoseReport, SENDER_DESCRIPTION, TYPE_DESCRIPTION};

/// Number of the message type of poses, defined by [`types`].
const POSES: i32 = 4;

/// Appends the definition of a sender's name.
pub fn sender(number: i32, name: impl AsRef<[u8]>, stream: &mut Vec<u8>) {
    message(
        [0, 0],
        number,
        SENDER_DESCRIPTION,
        &described(name.as_ref()),
        stream,
    );
}

/// Appends the definition of the message type of poses.
pub fn types(stream: &mut Vec<u8>) {
    message(
        [0, 0],
        POSES,
        TYPE_DESCRIPTION,
        &described(POSE_TYPE.as_bytes()),
        stream,
    );
}

/// Appends a pose of a sender with its time, s and µs.
pub fn report(time: [u32; 2], sender: i32, report: &PoseReport, stream: &mut Vec<u8>) {
    let mut payload = Vec::with_capacity(64);
    payload.extend(report.sensor.to_be_bytes());
    payload.extend(report.sensor.to_be_bytes());
    for number in report.position.iter().chain(&report.quaternion) {
        payload.extend(number.to_be_bytes());
    }
    message(time, sender, POSES, &payload, stream);
}

/// Appends any message.
pub fn message(time: [u32; 2], sender: i32, kind: i32, payload: &[u8], stream: &mut Vec<u8>) {
    let length = u32::try_from(HEADER + payload.len()).unwrap_or(u32::MAX);
    stream.extend(length.to_be_bytes());
    stream.extend(time[0].to_be_bytes());
    stream.extend(time[1].to_be_bytes());
    stream.extend(sender.to_be_bytes());
    stream.extend(kind.to_be_bytes());
    stream.extend([0; 4]);
    stream.extend(payload);
    stream.resize(
        stream.len() + payload.len().next_multiple_of(8) - payload.len(),
        0,
    );
}

fn described(name: &[u8]) -> Vec<u8> {
    let length = u32::try_from(name.len() + 1).unwrap_or(u32::MAX);
    [&length.to_be_bytes()[..], name, &[0]].concat()
}
