//! Encoder of the datagrams of Vicon Tracker.

use super::{OBJECT, OBJECT_LENGTH, Object};

/// Lengths to which datagrams are padded, bytes.
const LENGTHS: [usize; 3] = [256, 512, 1024];

/// Appends the datagram of a frame; omits objects beyond 255.
pub fn frame(number: u32, objects: &[Object], datagram: &mut Vec<u8>) {
    let objects = &objects[..objects.len().min(usize::from(u8::MAX))];
    let start = datagram.len();
    datagram.extend(number.to_le_bytes());
    datagram.extend(u8::try_from(objects.len()).unwrap_or(u8::MAX).to_le_bytes());
    for object in objects {
        datagram.push(OBJECT);
        datagram.extend(OBJECT_LENGTH.to_le_bytes());
        datagram.extend(object.name);
        for number in object.translation_mm.iter().chain(&object.rotation) {
            datagram.extend(number.to_le_bytes());
        }
    }
    let length = datagram.len() - start;
    let padded = LENGTHS
        .into_iter()
        .find(|&padded| padded >= length)
        .unwrap_or(length);
    datagram.resize(start + padded, 0);
}
