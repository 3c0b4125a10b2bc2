//! A sweep as it is about to be flown, merged or told: checked, and with the build that does it.

use std::fs::File;
use std::io::{self, Read};

use command_line::failure::Failure;
use sha2::{Digest, Sha256};

use crate::definition::{Source, hexadecimal};
use crate::plan::Plan;
use crate::row::{Kind, Layout};
use crate::shard::{Header, Shard};

/// A sweep with the layout of its rows and the program that flies it.
pub(crate) struct Prepared {
    pub(crate) plan: Plan,
    pub(crate) layout: Layout,
    pub(crate) program: String,
}

impl Prepared {
    pub(crate) fn new(source: Source) -> Result<Self, Failure> {
        let plan = Plan::new(source)?;
        let layout = Layout::new(&plan).map_err(|error| Failure::bad_input(format!("`judge`: {error}")))?;
        check_names(&plan, &layout)?;
        let program = program_hash().map_err(Failure::trouble)?;
        Ok(Self {
            plan,
            layout,
            program,
        })
    }

    pub(crate) fn header(&self, shard: Shard) -> Header {
        Header::new(shard, &self.plan.source, &self.layout.columns, &self.program)
    }
}

/// Refuses ranks and maps of what no row has.
fn check_names(plan: &Plan, layout: &Layout) -> Result<(), Failure> {
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
        Some((key, name, known)) => Err(Failure::bad_input(format!(
            "`{key}`: a row has no `{name}`; it has {}",
            known.join(", ")
        ))),
    }
}

/// Returns the SHA-256 of the program that runs, in hexadecimal.
fn program_hash() -> io::Result<String> {
    let mut program = File::open("/proc/self/exe")?;
    let (mut hash, mut part) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match program.read(&mut part)? {
            0 => return Ok(hexadecimal(&hash.finalize())),
            count => hash.update(&part[..count]),
        }
    }
}
