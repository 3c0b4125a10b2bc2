//! Polynomials of the time, one after another, as points at equal times.
//!
//! The curve through the points is C⁴ also where polynomials meet, which are rarely so smooth there, and starts and ends
//! at rest.

use std::ops::Range;

use scenario::{Vector, Waypoints};

use super::table::{Row, Table};
use super::{MOST_POINTS, Points, Wrong};

/// Largest time from one point to the next, s.
const SPACING: f64 = 0.1;

/// Largest jump of the position, m, and of the velocity, m/s, where polynomials meet: files round.
const JUMP: f64 = 1e-3;
const VELOCITY_JUMP: f64 = 1e-2;

/// Polynomials of the three coordinates for some time.
struct Piece {
    /// Its time, s.
    duration: f64,
    /// Coefficients by axis, those of the highest power first.
    coefficients: [Vec<f64>; 3],
    /// Its line.
    span: Range<usize>,
}

/// Returns points of the polynomials of a table; of closed ones without the last, which is the first.
pub(super) fn points(table: &Table, is_closed: bool) -> Result<Points, Wrong> {
    let pieces = pieces(table)?;
    refuse_jumps(&pieces)?;
    let whole: f64 = pieces.iter().map(|piece| piece.duration).sum();
    let count = whole / SPACING;
    if count > (MOST_POINTS - 1) as f64 {
        let reason =
            format!("the path takes {whole:?} s, and {MOST_POINTS} points every {SPACING} s are the most");
        return Err(Wrong::new(&(0..0), reason, "cut it into several paths"));
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
fn sampled(pieces: &[Piece], interval: f64, count: usize) -> Result<Vec<Vector>, Wrong> {
    let mut points = Vec::with_capacity(count + 1);
    let (mut at, mut begin) = (0, 0.0);
    for index in 0..=count {
        let time = interval * index as f64;
        while at + 1 < pieces.len() && time > begin + pieces[at].duration {
            begin += pieces[at].duration;
            at += 1;
        }
        let piece = &pieces[at];
        let point = piece.position((time - begin).min(piece.duration));
        if points
            .last()
            .is_some_and(|last| Waypoints::coincide(last, &point))
        {
            let reason = format!("the path stands still at {time:.2} s");
            return Err(Wrong::new(
                &piece.span,
                reason,
                "leave this part out; stops are not part of a path",
            ));
        }
        points.push(point);
    }
    Ok(points)
}

fn pieces(table: &Table) -> Result<Vec<Piece>, Wrong> {
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
        Err(Wrong::new(
            &piece.span,
            reason,
            "give the time that the polynomial is flown for",
        ))
    };
    if table.rows.is_empty() {
        return Err(Wrong::new(
            &(0..0),
            "there is no polynomial in it",
            "write a polynomial a line",
        ));
    }
    table.rows.iter().map(piece).collect()
}

/// Refuses polynomials that do not begin where and as the ones before end.
fn refuse_jumps(pieces: &[Piece]) -> Result<(), Wrong> {
    for pair in pieces.windows(2) {
        let [before, piece] = pair else { continue };
        let end = before.duration;
        let way = distance(before.position(end), piece.position(0.0));
        let change = distance(before.velocity(end), piece.velocity(0.0));
        let found = if way > JUMP {
            format!("this begins {way:.3} m from where the polynomial before ends")
        } else if change > VELOCITY_JUMP {
            format!("the velocity jumps by {change:.3} m/s here")
        } else {
            continue;
        };
        return Err(Wrong::new(
            &piece.span,
            found,
            "let every polynomial go on as the one before ends",
        ));
    }
    Ok(())
}

/// Refuses a path that is to be closed and does not end where it begins.
fn refuse_open(first: Vector, last: Vector, end: &Piece) -> Result<(), Wrong> {
    let way = distance(first, last);
    if way <= JUMP {
        return Ok(());
    }
    let reason = format!("it ends {way:.3} m from where it begins, and `closed` is stated");
    Err(Wrong::new(&end.span, reason, "leave `closed` out"))
}

fn distance(a: Vector, b: Vector) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}

impl Piece {
    fn position(&self, time: f64) -> Vector {
        self.coefficients.each_ref().map(|of_axis| {
            of_axis
                .iter()
                .fold(0.0, |sum, coefficient| sum * time + coefficient)
        })
    }

    fn velocity(&self, time: f64) -> Vector {
        self.coefficients.each_ref().map(|of_axis| {
            let powers = (0..of_axis.len()).rev();
            let slopes = of_axis.iter().zip(powers).filter(|(_, power)| *power > 0);
            slopes.fold(0.0, |sum, (coefficient, power)| {
                sum * time + coefficient * power as f64
            })
        })
    }
}
