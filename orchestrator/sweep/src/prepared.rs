//! A sweep as it is about to be flown, merged or told: checked, and with the build that does it.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;

use sha2::{Digest, Sha256};

use crate::definition::{Source, hexadecimal};
use crate::error::SweepError;
use crate::plan::Plan;
use crate::row::{Kind, Layout};
use crate::shard::{Header, Shard};

/// A sweep with the layout of its rows and the program that flies it.
pub struct Prepared {
    /// The samples.
    pub plan: Plan,
    /// The columns of a row.
    pub layout: Layout,
    /// SHA-256 of the program, in hexadecimal.
    pub program: String,
}

impl Prepared {
    /// Checks a sweep.
    ///
    /// # Errors
    /// [`SweepError`] with the reason and the fix.
    pub fn new(source: Source) -> Result<Self, SweepError> {
        let plan = Plan::new(source)?;
        let layout =
            Layout::new(&plan).map_err(|error| SweepError::bad_input(format!("`judge`: {error}")))?;
        check_columns(&layout)?;
        check_names(&plan, &layout)?;
        let program = program_hash().map_err(SweepError::trouble)?;
        Ok(Self {
            plan,
            layout,
            program,
        })
    }

    /// Returns the first line of a shard's file.
    #[must_use]
    pub fn header(&self, shard: Shard) -> Header {
        Header::new(shard, self)
    }
}

/// Refuses two columns of one name, which most readers of tables do not tell apart; some take capital letters for small ones.
fn check_columns(layout: &Layout) -> Result<(), SweepError> {
    let mut names = BTreeSet::new();
    let mut columns = layout.columns.iter().map(|column| column.name.as_str());
    match columns.find(|name| !names.insert(name.to_lowercase())) {
        None => Ok(()),
        Some(name) => Err(SweepError::bad_input(format!(
            "a row has two columns `{name}`: give what is varied or judged under this name another one, such as \
             `{name}_{}`",
            if layout.criteria().any(|criterion| criterion == name) {
                "met"
            } else {
                "drawn"
            }
        ))),
    }
}

/// Refuses ranks and maps of what no row has.
fn check_names(plan: &Plan, layout: &Layout) -> Result<(), SweepError> {
    let definition = &plan.source.definition;
    let columns = |kinds: &[Kind]| -> Vec<&str> {
        let of_kind = layout
            .columns
            .iter()
            .filter(|column| kinds.contains(&column.kind));
        of_kind.map(|column| column.name.as_str()).collect()
    };
    let (numbers, drawn) = (columns(&[Kind::Number]), columns(&[Kind::Number, Kind::Flag]));
    let ranks = std::iter::once(("rank".to_owned(), &definition.rank, &numbers));
    let maps = definition.map.iter().enumerate().flat_map(|(index, map)| {
        let (x, y) = (format!("map.{index}.x"), format!("map.{index}.y"));
        let value = format!("map.{index}.value");
        [
            (x, &map.x, &numbers),
            (y, &map.y, &numbers),
            (value, &map.value, &drawn),
        ]
    });
    match ranks
        .chain(maps)
        .find(|(_, name, known)| !known.contains(&name.as_str()))
    {
        None => Ok(()),
        Some((key, name, known)) => Err(SweepError::bad_input(format!(
            "`{key}`: a row has no `{name}`; it has {}",
            known.join(", ")
        ))),
    }
}

/// Returns the SHA-256 of the build that flies, in hexadecimal: of the file that this code was loaded from, which is the
/// program, or the module of an interpreter.
fn program_hash() -> io::Result<String> {
    let mut program = File::open(mapped_file(program_hash as fn() -> io::Result<String> as usize)?)?;
    let (mut hash, mut part) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match program.read(&mut part)? {
            0 => return Ok(hexadecimal(&hash.finalize())),
            count => hash.update(&part[..count]),
        }
    }
}

/// Returns the file that is mapped at an address of this process.
fn mapped_file(address: usize) -> io::Result<PathBuf> {
    let maps = std::fs::read_to_string("/proc/self/maps")?;
    let path = maps.lines().find_map(|line| {
        let (range, rest) = line.split_once(' ')?;
        let (from, to) = range.split_once('-')?;
        let limit = |text| usize::from_str_radix(text, 16).ok();
        let path = &rest[rest.find('/')?..];
        (limit(from)?..limit(to)?)
            .contains(&address)
            .then(|| path.to_owned())
    });
    let path = path.ok_or_else(|| io::Error::other("no file is mapped where this program is"))?;
    let own = PathBuf::from("/proc/self/exe");
    // The link leads to the program also after its file was replaced.
    let is_program = std::fs::read_link(&own).is_ok_and(|target| target.as_os_str() == path.as_str());
    Ok(if is_program { own } else { path.into() })
}
