//! Reads what vehicles send back, made by programs that are not ours: `telemetry LINK FILE`.
//!
//! Prints the length of each frame of the file with the voltage of the battery in mV, or `other`.

use std::error::Error;

use radio_link::format::for_link;
use radio_link::telemetry::Reply;
use scenario::{RadioProtocol, RcLink, Transmitter};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, link, file] = arguments.as_slice() else {
        return Err("usage: telemetry LINK FILE".into());
    };
    let protocol = RadioProtocol::ALL
        .into_iter()
        .find(|protocol| protocol.name() == link)
        .ok_or("no such link")?;
    let link = RcLink {
        link: protocol,
        ..RcLink::default()
    };
    let mut format = for_link(&link, &Transmitter::default()).ok_or("the simulated link has no frames")?;
    let bytes = std::fs::read(file)?;
    let mut at = 0;
    while at < bytes.len() {
        at += match format.read_reply(&bytes[at..]) {
            Reply::Voltage(length, voltage) => {
                println!("{length} {:.0}", 1e3 * voltage);
                length
            }
            Reply::Other(length) => {
                println!("{length} other");
                length
            }
            reply => return Err(format!("byte {at}: {reply:?}").into()),
        };
    }
    Ok(())
}
