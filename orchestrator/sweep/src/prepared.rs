//! A checked sweep, with the layout of its rows and the hash of the program.

use std::collections::BTreeSet;

use ::flight::identity::program_hash;
use scenario::suggest::known_names;

use crate::definition::Source;
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

/// Refuses columns with equal names, ignoring case: most readers of tables require unique names, and some ignore case.
fn check_columns(layout: &Layout) -> Result<(), SweepError> {
    let mut names = BTreeSet::new();
    let mut columns = layout.columns.iter().map(|column| column.name.as_str());
    match columns.find(|name| !names.insert(name.to_lowercase())) {
        None => Ok(()),
        Some(name) => Err(SweepError::bad_input(format!(
            "a row has two columns `{name}`: rename the varied value or the criterion, such as to `{name}_{}`",
            if layout.criteria().any(|criterion| criterion == name) {
                "met"
            } else {
                "drawn"
            }
        ))),
    }
}

/// Refuses ranks and maps of columns that do not exist.
fn check_names(plan: &Plan, layout: &Layout) -> Result<(), SweepError> {
    let definition = &plan.source.definition;
    let columns = |kinds: &[Kind]| -> Vec<&str> {
        let matching = layout
            .columns
            .iter()
            .filter(|column| kinds.contains(&column.kind));
        matching.map(|column| column.name.as_str()).collect()
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
            "`{key}`: a row has no `{name}`; {}",
            known_names(name, known)
        ))),
    }
}
