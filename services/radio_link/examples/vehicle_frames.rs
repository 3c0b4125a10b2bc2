//! Frames for third-party decoders: `vehicle_frames FILE`.
//!
//! Writes a line of JSON per frame: the vehicle in pulses of its receiver, the commanded thrust and rates (`null` to stop
//! the motors), the tolerance, and the frame. These are the cases of the test `meaning`. The channel map is left out, so
//! that the decoders check it independently.

use std::error::Error;
use std::fmt::Write as _;

use radio_link::encoder::Encoder;
use radio_link::frame::Frame;

#[path = "../tests/it/vehicles.rs"]
mod vehicles;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: vehicle_frames FILE")?;
    let mut lines = String::new();
    for case in vehicles::cases() {
        let vehicle = &case.vehicle;
        let transmitter = case
            .link
            .transmitter
            .as_ref()
            .ok_or("the case has no transmitter")?;
        let mut encoder = Encoder::new(&case.link, transmitter).ok_or("the link is simulated")?;
        let channels: Vec<_> = ['T', 'A', 'E', 'R']
            .iter()
            .filter_map(|letter| transmitter.order.find(*letter))
            .collect();
        for (sticks, asked) in vehicles::asked(&case) {
            let mut frame = Frame::default();
            encoder.encode(&sticks, false, 0, &mut frame);
            let asked = asked.map_or("null".to_owned(), |asked| format!("{asked:?}"));
            write!(
                lines,
                "{{\"link\":\"{}\",\"channels\":{channels:?},\"thrust\":{:?},\"largest\":{:?},\"idle_share\":{:?},\
                 \"rates\":{:?},\"rate\":{:?},\"stopped\":{:?},\"tolerance\":{:?},\"asked\":{asked},\"frame\":\"",
                case.link.link.name(),
                vehicle.thrust,
                vehicles::LARGEST,
                case.idle_share,
                vehicle.rates,
                vehicle.rate,
                case.stopped(),
                case.tolerance,
            )?;
            for byte in frame.bytes() {
                write!(lines, "{byte:02x}")?;
            }
            lines.push_str("\"}\n");
        }
    }
    result_file::write(std::path::Path::new(&path), lines, &[])?;
    Ok(())
}
