//! The file of a path: points or polynomials that other programs have written, read once and numbers from there on.
//!
//! The names in the first line of the CSV say which of two forms it has:
//!
//! * `x,y,z`: a point a line. With a column `t`, s, at equal times, they follow each other in γ as in time. `id` is ignored.
//! * `duration,x^0,…,x^7,y^0,…,z^0,…`: a polynomial a line, of the time since its begin, as `uav_trajectories` and Crazyswarm
//!   have them. Points are taken of it every 0.1 s, and γ is the time.
//!
//! z points up in both, and down in {I}: (x, y, z) of the file is (x, −y, −z) there.

mod polynomials;
mod table;

use std::ops::Range;
use std::path::Path;

use scenario::{Curve, Key, Scenario, Vector, Waypoints};
use sha2::{Digest, Sha256};
use shared_types::sample::hex;
use toml::Spanned;
use toml::de::DeTable;

use super::sources::Sources;
use super::{Finding, document, read};
use table::Table;

/// Most points of a path: what is longer is a recording and no path.
const MOST_POINTS: usize = 10_000;

/// Largest difference of a time from equal times, in intervals: files round.
const UNEVEN: f64 = 0.01;

/// Reason why a file is no path, with the place in it.
#[derive(Debug)]
struct Wrong {
    span: Range<usize>,
    reason: String,
    fix: String,
}

impl Wrong {
    fn new(span: &Range<usize>, reason: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            span: span.clone(),
            reason: reason.into(),
            fix: fix.into(),
        }
    }
}

/// The content of a file.
#[derive(Debug, PartialEq)]
struct Points {
    /// The points in {I}, m.
    points: Vec<Vector>,
    /// γ from one to the next; none if the file has no times.
    interval: Option<f64>,
}

/// What a scenario states of its waypoints.
struct Stated<'a> {
    sources: &'a Sources,
    document: &'a Spanned<DeTable<'a>>,
}

impl Stated<'_> {
    fn key(name: &str) -> Key {
        let segments = ["path", "curve", "waypoints", name];
        segments.into_iter().collect()
    }

    fn has(&self, name: &str) -> bool {
        document::states(self.document, &Self::key(name))
    }

    fn refused(&self, name: &str, reason: impl Into<String>, fix: &str) -> Box<Finding> {
        let key = Self::key(name);
        let span = document::deepest_span(self.document, &key);
        let title = format!("`{key}` cannot be used");
        Box::new(self.sources.finding(span, title, reason, fix))
    }
}

/// Reads the file of a scenario's path, if one is stated, in the folder of the scenario.
pub(super) fn read_into<'a>(
    scenario: &mut Scenario,
    folder: &Path,
    sources: &'a Sources,
    document: &'a Spanned<DeTable<'a>>,
) -> Result<(), Box<Finding>> {
    let Curve::Waypoints(way) = &mut scenario.path.curve else {
        return Ok(());
    };
    let stated = Stated { sources, document };
    let Some(file) = way.file.clone() else {
        let idle = ["offset", "sha256"].into_iter().find(|name| stated.has(name));
        return idle.map_or(Ok(()), |name| {
            Err(stated.refused(
                name,
                "it is about a file, and none is stated",
                "leave it out, or state `file`",
            ))
        });
    };
    if stated.has("points") {
        let reason = "both points and a file of points are stated";
        return Err(stated.refused("points", reason, "leave `points` or `file` out"));
    }
    let path = folder.join(file);
    let bytes = bytes_of(&path, &stated)?;
    let found = hex(&Sha256::digest(&bytes));
    if way.sha256.as_ref().is_some_and(|sha256| *sha256 != found) {
        let reason = format!("the file has changed since: its SHA-256 is {found}");
        return Err(stated.refused("sha256", reason, "name the other file, or leave `sha256` out"));
    }
    let (name, text) = (path.display().to_string(), String::from_utf8_lossy(&bytes));
    let Points { points, interval } = points(&text, way.closed).map_err(|Wrong { span, reason, fix }| {
        Sources::new(&name, &text, &[]).finding(span, "this file is no path", reason, fix)
    })?;
    if interval.is_some() && stated.has("interval") {
        let fix = "leave it out; `path.speed` says how fast the path is flown";
        return Err(stated.refused("interval", "the file states times, from which it follows", fix));
    }
    let offset = way.offset.unwrap_or_default();
    let moved = |point: Vector| std::array::from_fn(|axis| point[axis] + offset[axis]);
    way.points = points.into_iter().map(moved).collect();
    way.interval = interval.unwrap_or(way.interval);
    way.file = path.file_name().map(Into::into);
    way.sha256 = Some(found);
    Ok(())
}

/// Returns the content of the file.
fn bytes_of(path: &Path, stated: &Stated<'_>) -> Result<Vec<u8>, Box<Finding>> {
    let bytes = read::bytes(path).map_err(|error| {
        let fix = "name a CSV file, by its path from the folder of the scenario";
        stated.refused("file", format!("cannot read {}: {error}", path.display()), fix)
    })?;
    if bytes.len() as u64 > read::LONGEST_FILE {
        let reason = format!("{} is longer than {} bytes", path.display(), read::LONGEST_FILE);
        return Err(stated.refused("file", reason, "leave points out: a path needs some ten a second"));
    }
    Ok(bytes)
}

/// Returns the points of a file's text.
fn points(text: &str, is_closed: bool) -> Result<Points, Wrong> {
    let table = Table::read(text)?;
    let found = if table.has("duration") {
        polynomials::points(&table, is_closed)?
    } else {
        points_in_rows(&table)?
    };
    Ok(Points {
        // The sign of a zero is lost when the offset is added.
        points: found.points.iter().map(|&[x, y, z]| [x, -y, -z]).collect(),
        ..found
    })
}

/// Returns the points of a file with one a line.
fn points_in_rows(table: &Table) -> Result<Points, Wrong> {
    table.refuse_columns_but(&["id", "t", "x", "y", "z", "yaw"])?;
    let columns = [table.column("x")?, table.column("y")?, table.column("z")?];
    table.refuse_yaw(|name| name == "yaw")?;
    table.refuse_more_rows_than(MOST_POINTS)?;
    let points: Vec<Vector> = table
        .rows
        .iter()
        .map(|row| columns.map(|column| row.numbers[column]))
        .collect();
    for (index, pair) in points.windows(2).enumerate() {
        if Waypoints::coincide(&pair[0], &pair[1]) {
            let reason = "this is the point of the line before";
            return Err(Wrong::new(
                &table.rows[index + 1].span,
                reason,
                "leave it out; stops are not part of a path",
            ));
        }
    }
    let interval = match table.column("t") {
        Ok(column) => Some(interval(table, column)?),
        Err(_) => None,
    };
    Ok(Points { points, interval })
}

/// Returns the time from a point to the next, which is the same for all.
fn interval(table: &Table, column: usize) -> Result<f64, Wrong> {
    let times = || table.rows.iter().map(|row| row.numbers[column]);
    let (Some(first), Some(last)) = (times().next(), times().next_back()) else {
        return Err(Wrong::new(
            &(0..0),
            "there is no point in it",
            "write a point a line",
        ));
    };
    let equal = |row: usize| first + (last - first) * row as f64 / (table.rows.len().max(2) - 1) as f64;
    let interval = equal(1) - first;
    for (index, (row, time)) in table.rows.iter().zip(times()).enumerate() {
        let is_even = (time - equal(index)).abs() <= UNEVEN * interval;
        if !is_even || interval <= 0.0 {
            let reason = format!(
                "the time {time:?} s is not {:?} s, as equal times from {first:?} s to {last:?} s are",
                equal(index)
            );
            let fix = "write points of equal times, or leave the column `t` out: `interval` then states γ from one to the next";
            return Err(Wrong::new(&row.span, reason, fix));
        }
    }
    Ok(interval)
}
