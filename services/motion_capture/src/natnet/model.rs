//! MODELDEF: the names of the rigid bodies.

use super::{Description, Version};
use crate::wire::{Cursor, MAX_BODIES, MAX_NAME_LENGTH, Name, WireError};

/// Kinds of descriptions.
const MARKER_SET: i32 = 0;
const RIGID_BODY: i32 = 1;
const SKELETON: i32 = 2;

/// Reads the names of all rigid bodies.
///
/// From 4.1 on a description states its length. Only name and id are read, which come first in all versions: 4.2 inserted a
/// rotation after them, and later versions may add more. Returns the error of a description without name and id, if there
/// is one; the others are used.
///
/// Before 4.1 descriptions have no length: everything after one of an unknown kind is ignored. Motive sends rigid bodies
/// before force plates, devices and cameras.
///
/// # Errors
/// If the structure of the message is wrong.
pub(super) fn read(
    payload: &mut Cursor<'_>,
    version: Version,
    bodies: &mut Vec<Description>,
) -> Result<Option<WireError>, WireError> {
    bodies.clear();
    let mut unreadable = None;
    for _ in 0..payload.u32_le("the number of descriptions")? {
        let kind = payload.i32_le("the kind of a description")?;
        if version.has_lengths() {
            let length = payload.u32_le("the length of a description")? as usize;
            let mut description = Cursor::new(payload.slice(length, "a description")?);
            if kind == RIGID_BODY {
                match name_and_id(&mut description) {
                    Ok(described) => add(described, bodies),
                    Err(error) => unreadable = Some(error),
                }
            }
            continue;
        }
        match kind {
            MARKER_SET => marker_set(payload)?,
            RIGID_BODY => {
                let described = name_and_id(payload)?;
                skip_rigid_body(payload, version)?;
                add(described, bodies);
            }
            SKELETON => skeleton(payload)?,
            _ => break,
        }
    }
    Ok(unreadable)
}

/// Adds a body. Marks all bodies that share a name or an id.
fn add(mut new: Description, bodies: &mut Vec<Description>) {
    for known in bodies.iter_mut() {
        if (known.id, known.name) == (new.id, new.name) {
            return;
        }
        let is_twin = known.id == new.id || known.name == new.name;
        known.is_shared |= is_twin;
        new.is_shared |= is_twin;
    }
    if bodies.len() < MAX_BODIES {
        bodies.push(new);
    }
}

fn marker_set(description: &mut Cursor<'_>) -> Result<(), WireError> {
    description.text("the name of a marker set")?;
    for _ in 0..description.u32_le("the number of markers")? {
        description.text("the name of a marker")?;
    }
    Ok(())
}

fn name_and_id(description: &mut Cursor<'_>) -> Result<Description, WireError> {
    let name = description.text("the name of a rigid body")?;
    Ok(Description {
        id: description.i32_le("the id of a rigid body")?,
        name: Name::truncated(name),
        is_shared: false,
        is_truncated: name.len() > MAX_NAME_LENGTH,
    })
}

/// Skips the remainder of a rigid body's description in versions without lengths.
fn skip_rigid_body(description: &mut Cursor<'_>, version: Version) -> Result<(), WireError> {
    // Id of the parent, and position relative to it.
    description.skip(4, 4, "a rigid body's description")?;
    let markers = description.u32_le("the number of markers")?;
    // Position and label of each marker.
    description.skip(markers as usize, 16, "a rigid body's markers")?;
    if version.major >= 4 {
        for _ in 0..markers {
            description.text("the name of a marker")?;
        }
    }
    Ok(())
}

fn skeleton(description: &mut Cursor<'_>) -> Result<(), WireError> {
    description.text("the name of a skeleton")?;
    description.skip(1, 4, "the id of a skeleton")?;
    for _ in 0..description.u32_le("the number of bones")? {
        description.text("the name of a bone")?;
        // Id, parent, and position relative to it.
        description.skip(5, 4, "a bone")?;
    }
    Ok(())
}
