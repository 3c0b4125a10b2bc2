//! MODELDEF: the names of the rigid bodies.

use super::Version;
use crate::wire::{Cursor, MOST_BODIES, Name, WireError};

/// Kinds of descriptions.
const MARKER_SET: i32 = 0;
const RIGID_BODY: i32 = 1;
const SKELETON: i32 = 2;

/// Reads the names of all rigid bodies, which replace the known ones.
///
/// Before 4.1 a description of an unknown kind has no length: the rest after it cannot be read, and is ignored. Motive
/// sends rigid bodies before force plates, devices and cameras.
pub(super) fn read(
    payload: &mut Cursor<'_>,
    version: Version,
    names: &mut Vec<(i32, Name)>,
) -> Result<(), WireError> {
    names.clear();
    for _ in 0..payload.u32_le("the number of descriptions")? {
        let kind = payload.i32_le("the kind of a description")?;
        let mut description = if version.has_lengths() {
            let length = payload.u32_le("the length of a description")?;
            Cursor::new(payload.slice(length as usize, "a description")?)
        } else {
            *payload
        };
        match kind {
            MARKER_SET => marker_set(&mut description)?,
            RIGID_BODY => {
                let named = rigid_body(&mut description, version)?;
                if names.len() == MOST_BODIES {
                    return Err(WireError::Oversized("the number of rigid bodies"));
                }
                if names.iter().any(|(id, name)| *id == named.0 || *name == named.1) {
                    return Err(WireError::Invalid("an id or a name that two rigid bodies have"));
                }
                names.push(named);
            }
            SKELETON if !version.has_lengths() => skeleton(&mut description)?,
            _ if !version.has_lengths() => return Ok(()),
            _ => {}
        }
        if !version.has_lengths() {
            *payload = description;
        }
    }
    Ok(())
}

fn marker_set(description: &mut Cursor<'_>) -> Result<(), WireError> {
    description.text("the name of a marker set")?;
    for _ in 0..description.u32_le("the number of markers")? {
        description.text("the name of a marker")?;
    }
    Ok(())
}

fn rigid_body(description: &mut Cursor<'_>, version: Version) -> Result<(i32, Name), WireError> {
    let name = Name::new(description.text("the name of a rigid body")?)?;
    let id = description.i32_le("the id of a rigid body")?;
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
    Ok((id, name))
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
