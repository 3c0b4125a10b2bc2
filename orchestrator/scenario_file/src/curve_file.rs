//! File of a path: points or polynomials of other programs, which replace the waypoints of the scenario.
//!
//! The names in the first line of the CSV select one of two forms:
//!
//! * `x,y,z`: one point per line. An optional column `t`, s, must be equidistant and gives the interval of γ. `id` is ignored.
//! * `duration,x^0,…,x^7,y^0,…,z^0,…`: one polynomial per line, in the time since its start, as in `uav_trajectories` and
//!   Crazyswarm. They are sampled every 0.1 s, and γ is the time.
//!
//! z points up in both: (x, y, z) of the file is (x, −y, −z) in {I}.

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

/// Maximum number of points of a path: a longer file is a recording.
const MAX_POINTS: usize = 10_000;

/// Tolerance of equidistant times, in intervals, for rounding.
const TIME_TOLERANCE: f64 = 0.01;

/// Reason why a file is not a path, with the position in the file.
#[derive(Debug)]
struct FileProblem {
    span: Range<usize>,
    reason: String,
    fix: String,
}

impl FileProblem {
    fn new(span: &Range<usize>, reason: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            span: span.clone(),
            reason: reason.into(),
            fix: fix.into(),
        }
    }
}

/// Points of a file.
#[derive(Debug, PartialEq)]
struct Points {
    /// The points in {I}, m.
    points: Vec<Vector>,
    /// γ between points; `None` if the file has no times.
    interval: Option<f64>,
}

/// Keys of the waypoints in the document.
struct WaypointKeys<'a> {
    sources: &'a Sources,
    document: &'a Spanned<DeTable<'a>>,
}

impl WaypointKeys<'_> {
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

/// Reads the file of a scenario's path, if stated, relative to the scenario's folder.
pub(super) fn read_into<'a>(
    scenario: &mut Scenario,
    folder: &Path,
    sources: &'a Sources,
    document: &'a Spanned<DeTable<'a>>,
) -> Result<(), Box<Finding>> {
    let Curve::Waypoints(way) = &mut scenario.path.curve else {
        return Ok(());
    };
    let keys = WaypointKeys { sources, document };
    let Some(file) = way.file.clone() else {
        let unused = ["offset", "sha256"].into_iter().find(|name| keys.has(name));
        return unused.map_or(Ok(()), |name| {
            Err(keys.refused(
                name,
                "it needs a `file`, and none is stated",
                "leave it out, or state `file`",
            ))
        });
    };
    if keys.has("points") {
        let reason = "both points and a file of points are stated";
        return Err(keys.refused("points", reason, "leave `points` or `file` out"));
    }
    let path = folder.join(file);
    let bytes = read_file(&path, &keys)?;
    let found = hex(&Sha256::digest(&bytes));
    if way.sha256.as_ref().is_some_and(|sha256| *sha256 != found) {
        let reason = format!("the file has changed since: its SHA-256 is {found}");
        return Err(keys.refused("sha256", reason, "state the original file, or leave `sha256` out"));
    }
    let (name, text) = (path.display().to_string(), String::from_utf8_lossy(&bytes));
    let Points { points, interval } =
        points(&text, way.closed).map_err(|FileProblem { span, reason, fix }| {
            Sources::new(&name, &text, &[]).finding(span, "this file is not a path", reason, fix)
        })?;
    if interval.is_some() && keys.has("interval") {
        let fix = "leave it out; `path.speed` scales the speed along the path";
        return Err(keys.refused("interval", "it follows from the times in the file", fix));
    }
    let offset = way.offset.unwrap_or_default();
    let shifted = |point: Vector| std::array::from_fn(|axis| point[axis] + offset[axis]);
    way.points = points.into_iter().map(shifted).collect();
    way.interval = interval.unwrap_or(way.interval);
    way.file = path.file_name().map(Into::into);
    way.sha256 = Some(found);
    Ok(())
}

/// Reads the file.
fn read_file(path: &Path, keys: &WaypointKeys<'_>) -> Result<Vec<u8>, Box<Finding>> {
    let bytes = read::bytes(path).map_err(|error| {
        let fix = "name a CSV file, by its path from the folder of the scenario";
        keys.refused("file", format!("cannot read {}: {error}", path.display()), fix)
    })?;
    if bytes.len() as u64 > read::MAX_FILE {
        let reason = format!("{} is longer than {} bytes", path.display(), read::MAX_FILE);
        return Err(keys.refused("file", reason, "remove points: a path needs about ten per second"));
    }
    Ok(bytes)
}

/// Returns the points of a file's text.
fn points(text: &str, is_closed: bool) -> Result<Points, FileProblem> {
    let table = Table::read(text)?;
    let found = if table.has("duration") {
        polynomials::points(&table, is_closed)?
    } else {
        points_in_rows(&table)?
    };
    Ok(Points {
        // Adding the offset removes the sign of zeros.
        points: found.points.iter().map(|&[x, y, z]| [x, -y, -z]).collect(),
        ..found
    })
}

/// Returns the points of a file with one point per line.
fn points_in_rows(table: &Table) -> Result<Points, FileProblem> {
    table.refuse_columns_but(&["id", "t", "x", "y", "z", "yaw"])?;
    let columns = [table.column("x")?, table.column("y")?, table.column("z")?];
    table.refuse_yaw(|name| name == "yaw")?;
    table.refuse_more_rows_than(MAX_POINTS)?;
    let points: Vec<Vector> = table
        .rows
        .iter()
        .map(|row| columns.map(|column| row.numbers[column]))
        .collect();
    for (index, pair) in points.windows(2).enumerate() {
        if Waypoints::coincide(&pair[0], &pair[1]) {
            let reason = "this point equals that of the previous line";
            return Err(FileProblem::new(
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

/// Returns the time between points, which must be equidistant.
fn interval(table: &Table, column: usize) -> Result<f64, FileProblem> {
    let times = || table.rows.iter().map(|row| row.numbers[column]);
    let (Some(first), Some(last)) = (times().next(), times().next_back()) else {
        return Err(FileProblem::new(
            &(0..0),
            "the file has no points",
            "write one point per line",
        ));
    };
    let equal = |row: usize| first + (last - first) * row as f64 / (table.rows.len().max(2) - 1) as f64;
    let interval = equal(1) - first;
    for (index, (row, time)) in table.rows.iter().zip(times()).enumerate() {
        let is_even = (time - equal(index)).abs() <= TIME_TOLERANCE * interval;
        if !is_even || interval <= 0.0 {
            let reason = format!(
                "the time {time:?} s is not {:?} s, which is required for equal intervals from {first:?} s to {last:?} s",
                equal(index)
            );
            let fix = "write points at equal intervals, or leave the column `t` out: `interval` then states γ between points";
            return Err(FileProblem::new(&row.span, reason, fix));
        }
    }
    Ok(interval)
}
