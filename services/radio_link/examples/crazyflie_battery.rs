//! A Crazyflie with a battery of 3.75 V, for its own library: `crazyflie_battery`.
//!
//! Binds one of the UDP ports at which the library looks for simulators, answers null packets and requests to the log, and
//! ends at an empty packet.

use std::error::Error;
use std::net::UdpSocket;
use std::time::{Duration, Instant};

use radio_link::crazyflie::log::LogServer;
use radio_link::crazyflie::{CrazyfliePacket, NULL, decode};
use radio_link::frame::Frame;

fn main() -> Result<(), Box<dyn Error>> {
    let bound = (19850..19860).find_map(|port| UdpSocket::bind(("127.0.0.1", port)).ok());
    let socket = bound.ok_or("no port from 19850 to 19859 is free")?;
    println!("{}", socket.local_addr()?.port());
    socket.set_read_timeout(Some(Duration::from_millis(10)))?;
    let (mut log, mut peer, started) = (LogServer::default(), None, Instant::now());
    let mut bytes = [0; 1024];
    loop {
        let mut answer = Frame::default();
        if let Ok((count, from)) = socket.recv_from(&mut bytes) {
            peer = Some(from);
            match &bytes[..count] {
                [] => return Ok(()),
                packet if decode(packet) == Ok(CrazyfliePacket::Null) => answer.push(&[NULL]),
                packet => {
                    log.answer(packet, &mut answer);
                }
            }
        }
        let mut data = Frame::default();
        log.report(3.75, u64::try_from(started.elapsed().as_nanos())?, &mut data);
        for frame in [answer, data] {
            if let Some(peer) = peer
                && !frame.bytes().is_empty()
            {
                socket.send_to(frame.bytes(), peer)?;
            }
        }
    }
}
