//! Reads packets of a Crazyflie's own tools: `crazyflie_packets`.
//!
//! Binds one of the UDP ports at which they look for simulators, answers null packets, and prints a line per packet: the
//! port, then `rates` with the rates about forward, right, down in rad/s and the thrust of 65535, `stop`, `end` with its
//! time in ms, `supervisor` with a request and the bytes that we send for it, or `refused`. Ends at an empty packet.

use std::error::Error;
use std::net::UdpSocket;

use radio_link::crazyflie::{CrazyfliePacket, NULL, decode, encode};
use radio_link::frame::Frame;

fn main() -> Result<(), Box<dyn Error>> {
    let bound = (19850..19860).find_map(|port| UdpSocket::bind(("127.0.0.1", port)).ok());
    let socket = bound.ok_or("no port from 19850 to 19859 is free")?;
    println!("{}", socket.local_addr()?.port());
    let mut bytes = [0; 1024];
    loop {
        let (count, from) = socket.recv_from(&mut bytes)?;
        if count == 0 {
            return Ok(());
        }
        match decode(&bytes[..count]) {
            Ok(CrazyfliePacket::Rates(setpoint)) => {
                let [x, y, z] = setpoint.rates_body();
                println!("rates {x:?} {y:?} {z:?} {}", setpoint.thrust);
            }
            Ok(CrazyfliePacket::Stop) => println!("stop"),
            Ok(CrazyfliePacket::NotifySetpointsEnd(milliseconds)) => println!("end {milliseconds}"),
            Ok(packet @ CrazyfliePacket::Supervisor(request, _)) => {
                let mut frame = Frame::default();
                encode(&packet, &mut frame);
                let bytes: String = frame.bytes().iter().map(|byte| format!("{byte:02x}")).collect();
                println!("supervisor {request:?} {bytes}");
            }
            Ok(CrazyfliePacket::Null) => {
                socket.send_to(&[NULL], from)?;
            }
            Err(_) => println!("refused"),
        }
    }
}
