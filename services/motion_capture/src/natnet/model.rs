//! MODELDEF: the names of the rigid bodies.

use super::{Described, Version};
use crate::wire::{Cursor, LONGEST_NAME, MOST_BODIES, Name, WireError};

/// Kinds of descriptions.
const MARKER_SET: i32 = 0;
const RIGID_BODY: i32 = 1;
const SKELETON: i32 = 2;

/// Reads the names of all rigid bodies.
///
/// From 4.1 on a description states its length. Name and id come first in all versions, so that what stands behind them
/// is not read: 4.2 put a rotation there, and later versions may put more. Returns the error of a description that has no
/// name and id, if there is one: the others are used.
///
/// Before 4.1 a description of an unknown kind has no length: the rest after it cannot be read, and is ignored. Motive
/// sends rigid bodies before force plates, devices and cameras.
///
/// # Errors
/// If the structure of the whole is wrong.
pub(super) fn read(
    payload: &mut Cursor<'_>,
    version: Version,
    bodies: &mut Vec<Described>,
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

/// Adds a body. Bodies that share an id or a name with another one are all ambiguous, and no others.
fn add(mut new: Described, bodies: &mut Vec<Described>) {
    for known in bodies.iter_mut() {
        if (known.id, known.name) == (new.id, new.name) {
            return;
        }
        let is_twin = known.id == new.id || known.name == new.name;
        known.is_shared |= is_twin;
        new.is_shared |= is_twin;
    }
    if bodies.len() < MOST_BODIES {
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

fn name_and_id(description: &mut Cursor<'_>) -> Result<Described, WireError> {
    let name = description.text("the name of a rigid body")?;
    Ok(Described {
        id: description.i32_le("the id of a rigid body")?,
        name: Name::cut(name),
        is_shared: false,
        is_cut: name.len() > LONGEST_NAME,
    })
}

/// Skips the rest of a rigid body's description of a version without lengths.
fn skip_rigid_body(description: &mut Cursor<'_>, version: Version) -> Result<(), WireError> {
    // Its parent's id, and its place relative to it.
    description.skip(4, 4, "a rigid body's description")?;
    let markers = description.u32_le("the number of markers")?;
    // Each marker's place and label.
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
        // Id, parent, and place relative to it.
        description.skip(5, 4, "a bone")?;
    }
    Ok(())
}
