//! Sampling of piecewise polynomials in time at equal intervals.
//!
//! The curve through the points is C⁴ everywhere, also at the joints of polynomials, which are rarely so smooth, and starts
//! and ends at rest.

use std::ops::Range;

use scenario::{Vector, Waypoints};

use super::table::{Row, Table};
use super::{FileProblem, MAX_POINTS, Points};

/// Maximum time between points, s.
const SPACING: f64 = 0.1;

/// Maximum jump of the position, m, and of the velocity, m/s, at joints, for rounding.
const JUMP: f64 = 1e-3;
const VELOCITY_JUMP: f64 = 1e-2;

/// Polynomials of the three coordinates over an interval.
struct Piece {
    /// Length of the interval, s.
    duration: f64,
    /// Coefficients by axis, highest power first.
    coefficients: [Vec<f64>; 3],
    /// Position of its line in the file.
    span: Range<usize>,
}

/// Returns points of the polynomials of a table. A closed path omits the last point, which equals the first.
pub(super) fn points(table: &Table, is_closed: bool) -> Result<Points, FileProblem> {
    let pieces = pieces(table)?;
    refuse_jumps(&pieces)?;
    let whole: f64 = pieces.iter().map(|piece| piece.duration).sum();
    let count = whole / SPACING;
    if count > (MAX_POINTS - 1) as f64 {
        let reason = format!("the path takes {whole:?} s, more than {MAX_POINTS} points every {SPACING} s");
        return Err(FileProblem::new(&(0..0), reason, "split it into several paths"));
    }
    let count = (count.ceil() as usize).max(2);
    let interval = whole / count as f64;
    let mut points = sampled(&pieces, interval, count)?;
    if is_closed && let (Some(last), Some(end)) = (points.pop(), pieces.last()) {
        refuse_open(points[0], last, end)?;
    }
    Ok(Points {
        points,
        interval: Some(interval),
    })
}

/// Returns the points at the times 0, `interval`, …, `count` times that.
fn sampled(pieces: &[Piece], interval: f64, count: usize) -> Result<Vec<Vector>, FileProblem> {
    let mut points = Vec::with_capacity(count + 1);
    let (mut index_of_piece, mut start) = (0, 0.0);
    for index in 0..=count {
        let time = interval * index as f64;
        while index_of_piece + 1 < pieces.len() && time > start + pieces[index_of_piece].duration {
            start += pieces[index_of_piece].duration;
            index_of_piece += 1;
        }
        let piece = &pieces[index_of_piece];
        let point = piece.position((time - start).min(piece.duration));
        if points
            .last()
            .is_some_and(|last| Waypoints::coincide(last, &point))
        {
            let reason = format!("the path stops at {time:.2} s");
            return Err(FileProblem::new(
                &piece.span,
                reason,
                "remove this part; stops are not part of a path",
            ));
        }
        points.push(point);
    }
    Ok(points)
}

fn pieces(table: &Table) -> Result<Vec<Piece>, FileProblem> {
    let names = |axis: &'static str| {
        (0..)
            .map(move |power| format!("{axis}^{power}"))
            .take_while(move |name| table.has(name))
    };
    let known: Vec<String> = ["x", "y", "z", "yaw"].into_iter().flat_map(&names).collect();
    let known: Vec<&str> = known.iter().map(String::as_str).chain(["duration"]).collect();
    table.refuse_columns_but(&known)?;
    table.refuse_yaw(|name| name.starts_with("yaw"))?;
    let duration = table.column("duration")?;
    for axis in ["x^0", "y^0", "z^0"] {
        table.column(axis)?;
    }
    let axes = ["x", "y", "z"].map(|axis| {
        let columns = names(axis).filter_map(|name| table.column(&name).ok());
        columns.collect::<Vec<_>>()
    });
    let piece = |row: &Row| {
        let coefficients =
            |columns: &Vec<usize>| columns.iter().rev().map(|column| row.numbers[*column]).collect();
        let piece = Piece {
            duration: row.numbers[duration],
            coefficients: axes.each_ref().map(coefficients),
            span: row.span.clone(),
        };
        if piece.duration > 0.0 {
            return Ok(piece);
        }
        let reason = format!("the duration {:?} s is not above 0", piece.duration);
        Err(FileProblem::new(
            &piece.span,
            reason,
            "give the duration of the polynomial",
        ))
    };
    if table.rows.is_empty() {
        return Err(FileProblem::new(
            &(0..0),
            "the file has no polynomials",
            "write one polynomial per line",
        ));
    }
    table.rows.iter().map(piece).collect()
}

/// Refuses polynomials that do not continue the position and velocity of the previous one.
fn refuse_jumps(pieces: &[Piece]) -> Result<(), FileProblem> {
    for pair in pieces.windows(2) {
        let [before, piece] = pair else { continue };
        let end = before.duration;
        let gap = distance(before.position(end), piece.position(0.0));
        let change = distance(before.velocity(end), piece.velocity(0.0));
        let found = if gap > JUMP {
            format!("this starts {gap:.3} m from the end of the previous polynomial")
        } else if change > VELOCITY_JUMP {
            format!("the velocity jumps by {change:.3} m/s here")
        } else {
            continue;
        };
        return Err(FileProblem::new(
            &piece.span,
            found,
            "continue position and velocity from each polynomial to the next",
        ));
    }
    Ok(())
}

/// Refuses a closed path that does not end at its start.
fn refuse_open(first: Vector, last: Vector, end: &Piece) -> Result<(), FileProblem> {
    let gap = distance(first, last);
    if gap <= JUMP {
        return Ok(());
    }
    let reason = format!("it ends {gap:.3} m from its start, and `closed` is stated");
    Err(FileProblem::new(&end.span, reason, "leave `closed` out"))
}

fn distance(a: Vector, b: Vector) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}

impl Piece {
    fn position(&self, time: f64) -> Vector {
        self.coefficients.each_ref().map(|coefficients| {
            coefficients
                .iter()
                .fold(0.0, |sum, coefficient| sum * time + coefficient)
        })
    }

    fn velocity(&self, time: f64) -> Vector {
        self.coefficients.each_ref().map(|coefficients| {
            let powers = (0..coefficients.len()).rev();
            let slopes = coefficients.iter().zip(powers).filter(|(_, power)| *power > 0);
            slopes.fold(0.0, |sum, (coefficient, power)| {
                sum * time + coefficient * power as f64
            })
        })
    }
}
