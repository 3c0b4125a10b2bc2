//! FRAME: rigid bodies and times are read, other sections are skipped.

use super::{Description, RigidBody, ServerInfo, Times, Version};
use crate::wire::{CapturePose, Cursor, Frame, MAX_BODIES, Name, PoseError, Stamp, WireError};

/// Length of a rigid body or a skeleton's bone, bytes.
pub(crate) const RIGID_BODY_LENGTH: usize = 38;
/// Length of a labelled marker, bytes.
const LABELED_MARKER_LENGTH: usize = 26;
/// Length of the precision time, which is optional from 4.1 on, bytes.
const PRECISION_TIME_LENGTH: usize = 8;
/// Length of the part after the times, bytes.
const FOOT_LENGTH: usize = 6;
/// Flag of a rigid body that is tracked.
pub(crate) const TRACKED: u16 = 1;
/// Flag of a frame: the bodies have changed.
const MODELS_CHANGED: u16 = 2;

/// Reads a frame. Returns whether the names should be requested again.
pub(super) fn read(
    payload: &mut Cursor<'_>,
    server: &ServerInfo,
    described: &[Description],
    frame: &mut Frame,
) -> Result<bool, WireError> {
    let version = server.version;
    frame.number = Some(payload.u32_le("the frame number")?);
    section(payload, version, "the marker sets", marker_sets)?;
    section(payload, version, "the other markers", |markers, count| {
        markers.skip(count, 12, "the other markers")
    })?;
    let has_unnamed = rigid_bodies(payload, version, described, frame)?;
    section(payload, version, "the skeletons", skeletons)?;
    if version.has_lengths() {
        section(payload, version, "the assets", |_, _| Ok(()))?;
    }
    section(payload, version, "the labelled markers", |markers, count| {
        markers.skip(count, LABELED_MARKER_LENGTH, "the labelled markers")
    })?;
    section(payload, version, "the force plates", channels)?;
    section(payload, version, "the devices", channels)?;
    let times = times(payload)?;
    if version.has_lengths() && payload.remaining() >= FOOT_LENGTH + PRECISION_TIME_LENGTH {
        payload.skip(1, PRECISION_TIME_LENGTH, "the precision time")?;
    }
    let flags = payload.u16_le("the frame's flags")?;
    // The last four bytes mark the end of the frame.
    payload.skip(1, 4, "the end of the frame")?;
    // Later versions may append data. Without lengths, remaining bytes mean that the frame was misread.
    if !version.has_lengths() && payload.remaining() > 0 {
        return Err(WireError::Invalid("the end of the frame"));
    }
    frame.stamp = Some(stamp(&times, server.clock_frequency)?);
    Ok(has_unnamed || flags & MODELS_CHANGED != 0)
}

/// Skips a section by its length, from 4.1 on. Before, `read` skips the elements.
fn section<'a>(
    payload: &mut Cursor<'a>,
    version: Version,
    what: &'static str,
    read: impl FnOnce(&mut Cursor<'a>, usize) -> Result<(), WireError>,
) -> Result<(), WireError> {
    let count = payload.u32_le(what)? as usize;
    if !version.has_lengths() {
        return read(payload, count);
    }
    let length = payload.u32_le(what)? as usize;
    payload.skip(1, length, what)
}

fn marker_sets(sets: &mut Cursor<'_>, count: usize) -> Result<(), WireError> {
    for _ in 0..count {
        sets.text("the name of a marker set")?;
        let markers = sets.u32_le("the number of markers")? as usize;
        sets.skip(markers, 12, "the markers of a set")?;
    }
    Ok(())
}

/// Reads the rigid bodies. Returns whether one has no description.
fn rigid_bodies(
    payload: &mut Cursor<'_>,
    version: Version,
    described: &[Description],
    frame: &mut Frame,
) -> Result<bool, WireError> {
    const WHAT: &str = "the rigid bodies";
    let count = payload.u32_le(WHAT)? as usize;
    if version.has_lengths() && payload.u32_le(WHAT)? as usize != count.saturating_mul(RIGID_BODY_LENGTH) {
        return Err(WireError::Invalid("the length of the rigid bodies"));
    }
    if count > MAX_BODIES {
        return Err(WireError::Oversized("the number of rigid bodies"));
    }
    let mut has_unnamed = false;
    for index in 0..count {
        let body = rigid_body(payload)?;
        // Descriptions usually have the same order.
        let here = described.get(index).filter(|known| known.id == body.id);
        let known = here.or_else(|| described.iter().find(|known| known.id == body.id));
        has_unnamed |= known.is_none() && described.len() < MAX_BODIES;
        let name = known.map_or(Name::EMPTY, Description::unique_name);
        let twin = frame.bodies().iter().position(|other| other.number == body.id);
        let pose = match twin {
            Some(twin) => {
                frame.refuse(twin, PoseError::SharedId);
                Err(PoseError::SharedId)
            }
            None => pose(&body),
        };
        frame.push_pose(name, body.id, pose)?;
    }
    Ok(has_unnamed)
}

fn rigid_body(bodies: &mut Cursor<'_>) -> Result<RigidBody, WireError> {
    let id = bodies.i32_le("a rigid body")?;
    let mut numbers = [0.0; 8];
    for number in &mut numbers {
        *number = bodies.f32_le("a rigid body")?;
    }
    let [x, y, z, qx, qy, qz, qw, error] = numbers;
    Ok(RigidBody {
        id,
        position: [x, y, z],
        quaternion: [qx, qy, qz, qw],
        error,
        tracked: bodies.u16_le("a rigid body")? & TRACKED != 0,
    })
}

fn pose(body: &RigidBody) -> Result<Option<CapturePose>, PoseError> {
    if !body.tracked {
        return Ok(None);
    }
    CapturePose::from_quaternion(body.position.map(f64::from), body.quaternion.map(f64::from)).map(Some)
}

fn skeletons(skeletons: &mut Cursor<'_>, count: usize) -> Result<(), WireError> {
    for _ in 0..count {
        skeletons.skip(1, 4, "a skeleton")?;
        let bones = skeletons.u32_le("the number of bones")? as usize;
        skeletons.skip(bones, RIGID_BODY_LENGTH, "the bones of a skeleton")?;
    }
    Ok(())
}

/// Skips force plates or devices.
fn channels(plates: &mut Cursor<'_>, count: usize) -> Result<(), WireError> {
    for _ in 0..count {
        plates.skip(1, 4, "a force plate or device")?;
        for _ in 0..plates.u32_le("the number of channels")? {
            let values = plates.u32_le("the number of values")? as usize;
            plates.skip(values, 4, "the values of a channel")?;
        }
    }
    Ok(())
}

fn times(payload: &mut Cursor<'_>) -> Result<Times, WireError> {
    payload.skip(1, 8, "the time code")?;
    Ok(Times {
        timestamp: payload.f64_le("the time stamp")?,
        exposed: payload.u64_le("the time of the exposure")?,
        received: payload.u64_le("the time of the cameras' data")?,
        sent: payload.u64_le("the time of sending")?,
    })
}

/// Converts the times to ns. Without an exposure time, the time stamp is used for both.
fn stamp(times: &Times, frequency: u64) -> Result<Stamp, WireError> {
    let ns = |ticks: u64| {
        let ns = u128::from(ticks) * 1_000_000_000 / u128::from(frequency);
        i64::try_from(ns).map_err(|_| WireError::Invalid("a time of the frame"))
    };
    if times.exposed != 0 && times.sent >= times.exposed {
        return Ok(Stamp {
            exposed_ns: ns(times.exposed)?,
            sent_ns: ns(times.sent)?,
        });
    }
    // Ten years.
    if !(0.0..3e8).contains(&times.timestamp) {
        return Err(WireError::Invalid("the time stamp"));
    }
    #[expect(clippy::cast_possible_truncation, reason = "far below 2^63 ns")]
    let at_ns = (times.timestamp * 1e9) as i64;
    Ok(Stamp {
        exposed_ns: at_ns,
        sent_ns: at_ns,
    })
}
