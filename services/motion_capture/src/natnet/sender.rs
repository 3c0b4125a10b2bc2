//! Encoder of the datagrams of a `NatNet` server.

use super::{RigidBody, SERVER_NAME_LENGTH, ServerInfo, Times, Version, message};

/// Encodes a datagram of SERVERINFO.
#[must_use]
pub fn server_info(server: &ServerInfo) -> Vec<u8> {
    let mut payload = vec![0; SERVER_NAME_LENGTH];
    payload[..6].copy_from_slice(b"gerono");
    payload.extend([1, 0, 0, 0]);
    payload.extend([server.version.major, server.version.minor, 0, 0]);
    payload.extend(server.clock_frequency.to_le_bytes());
    payload.extend(server.data_port.to_le_bytes());
    payload.push(u8::from(server.multicast.is_some()));
    payload.extend(server.multicast.unwrap_or_default());
    datagram(message::SERVERINFO, &payload)
}

/// Rotation offset of the described rigid bodies, from 4.2 on. Not the identity: a decoder that ignores the field would
/// misread its zeros without an error.
const ROTATION_OFFSET: [f32; 4] = [0.1, 0.0, 0.0, 0.994_987_4];

/// Encodes a datagram of MODELDEF with rigid bodies and, like Motive, a marker set of all of them.
#[must_use]
pub fn names(version: Version, bodies: &[(i32, impl AsRef<[u8]>)]) -> Vec<u8> {
    let mut payload = Vec::new();
    extend_count(&mut payload, bodies.len() + 1);
    let set = [&b"all\0"[..], &0_u32.to_le_bytes()].concat();
    description(version, 0, &set, &mut payload);
    for (id, name) in bodies {
        let mut body = Vec::new();
        body.extend(name.as_ref());
        body.push(0);
        body.extend(id.to_le_bytes());
        body.extend([0; 16]);
        if version >= (Version { major: 4, minor: 2 }) {
            body.extend(ROTATION_OFFSET.iter().flat_map(|part| part.to_le_bytes()));
        }
        let markers = 3_u32;
        body.extend(markers.to_le_bytes());
        body.extend(vec![0; 16 * markers as usize]);
        if version.major >= 4 {
            body.extend(b"a\0b\0c\0");
        }
        description(version, 1, &body, &mut payload);
    }
    datagram(message::MODELDEF, &payload)
}

/// Encodes a datagram of FRAME with rigid bodies, a marker set and a skeleton of one bone.
#[must_use]
pub fn frame(version: Version, number: u32, bodies: &[RigidBody], times: &Times) -> Vec<u8> {
    let mut payload = number.to_le_bytes().to_vec();
    let set = [&b"all\0"[..], &1_u32.to_le_bytes(), &[0; 12]].concat();
    section(version, 1, &set, &mut payload);
    section(version, 0, &[], &mut payload);
    let mut section_of_bodies = Vec::new();
    for body in bodies {
        rigid_body(body, &mut section_of_bodies);
    }
    section(version, bodies.len(), &section_of_bodies, &mut payload);
    let skeleton = [&7_u32.to_le_bytes()[..], &1_u32.to_le_bytes(), &[0; 38]].concat();
    section(version, 1, &skeleton, &mut payload);
    if version.has_lengths() {
        section(version, 0, &[], &mut payload);
    }
    section(version, 1, &[0; 26], &mut payload);
    section(version, 0, &[], &mut payload);
    section(version, 0, &[], &mut payload);
    payload.extend([0; 8]);
    payload.extend(times.timestamp.to_le_bytes());
    for ticks in [times.exposed, times.received, times.sent] {
        payload.extend(ticks.to_le_bytes());
    }
    if version.has_lengths() {
        payload.extend([0; 8]);
    }
    payload.extend([0; 6]);
    datagram(message::FRAME, &payload)
}

/// Encodes a datagram of any kind.
#[must_use]
pub fn datagram(kind: u16, payload: &[u8]) -> Vec<u8> {
    let length = u16::try_from(payload.len()).unwrap_or(u16::MAX);
    [&kind.to_le_bytes()[..], &length.to_le_bytes(), payload].concat()
}

fn rigid_body(body: &RigidBody, section: &mut Vec<u8>) {
    section.extend(body.id.to_le_bytes());
    for number in body.position.iter().chain(&body.quaternion) {
        section.extend(number.to_le_bytes());
    }
    section.extend(body.error.to_le_bytes());
    section.extend(u16::from(body.tracked).to_le_bytes());
}

fn section(version: Version, count: usize, elements: &[u8], payload: &mut Vec<u8>) {
    extend_count(payload, count);
    if version.has_lengths() {
        extend_count(payload, elements.len());
    }
    payload.extend(elements);
}

fn description(version: Version, kind: i32, description: &[u8], payload: &mut Vec<u8>) {
    payload.extend(kind.to_le_bytes());
    if version.has_lengths() {
        extend_count(payload, description.len());
    }
    payload.extend(description);
}

fn extend_count(payload: &mut Vec<u8>, count: usize) {
    payload.extend(u32::try_from(count).unwrap_or(u32::MAX).to_le_bytes());
}
