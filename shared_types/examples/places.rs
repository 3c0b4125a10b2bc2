//! Positions in {I} as places on the earth and back, for programs that compare them with another library.
//!
//! Reads lines of ten numbers: latitude, longitude (degrees) and height (m) of the datum; azimuth of the x axis (rad); a position in {I}
//! (m); latitude, longitude and height of a place. Writes a line for each: the place of the position, and the position of the place.

use nalgebra::Vector3;
use shared_types::geodesy::{Geodetic, LocalFrame};

fn main() -> std::io::Result<()> {
    for line in std::io::stdin().lines() {
        let numbers: Vec<f64> = line?
            .split_whitespace()
            .map(|word| word.parse().expect("a number"))
            .collect();
        let &[north, east, above, azimuth, x, y, z, latitude, longitude, height] = numbers.as_slice() else {
            panic!("a line has ten numbers");
        };
        let place = |latitude, longitude, height| Geodetic {
            latitude,
            longitude,
            height,
        };
        let frame = LocalFrame::new(place(north, east, above), azimuth);
        let found = frame.to_geodetic(&Vector3::new(x, y, z));
        let back = frame.to_world(place(latitude, longitude, height));
        println!(
            "{:?} {:?} {:?} {:?} {:?} {:?}",
            found.latitude, found.longitude, found.height, back.x, back.y, back.z
        );
    }
    Ok(())
}
