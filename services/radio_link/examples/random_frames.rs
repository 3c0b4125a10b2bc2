//! Random frames for third-party decoders: `random_frames LINK COUNT SEED FRAMES VALUES`.
//!
//! Writes the concatenated frames to the file FRAMES, and their contents to VALUES: a line of numbers per frame. LINK is
//! crsf, sbus, multi, mavlink (`SET_ATTITUDE_TARGET`), override (`RC_CHANNELS_OVERRIDE`) or crazyflie. The contents of the
//! last are rates about forward, right, down in µrad/s, and the thrust of 65535.
//!
//! `random_frames msp COUNT SEED ADDRESS` tests a flight controller instead: it sends channels by `MSP_SET_RAW_RC` and
//! polls `MSP_RC` until the flight controller reports exactly these.

use std::error::Error;
use std::fmt::Write;
use std::io::{Read, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use radio_link::crazyflie::{self, CrazyfliePacket, RateSetpoint};
use radio_link::frame::Frame;
use radio_link::mavlink::{AttitudeTarget, MavlinkPacket, Sender};
use radio_link::{ChannelCodes, crsf, mavlink, msp, multi, sbus};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Timeout for a flight controller to report the channels that it received.
const TIMEOUT: Duration = Duration::from_secs(2);

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [link, count, seed, rest @ ..] = arguments.as_slice() else {
        return Err("usage: random_frames LINK COUNT SEED FRAMES VALUES".into());
    };
    let (count, mut random) = (count.parse()?, ChaCha8Rng::seed_from_u64(seed.parse()?));
    match rest {
        [address] if link == "msp" => exchange_msp(count, &mut random, address),
        [frames, values] => {
            let (mut bytes, mut lines) = (Vec::new(), String::new());
            for number in 0..count {
                let (frame, carried) = random_frame(link, number, &mut random)?;
                bytes.extend_from_slice(&frame);
                writeln!(lines, "{carried}")?;
            }
            result_file::write(Path::new(frames), bytes, &[])?;
            result_file::write(Path::new(values), lines, &[])?;
            Ok(())
        }
        _ => Err("give two files, or for msp an address".into()),
    }
}

/// Returns channels, each a whole number of `least..least + count`.
fn channels(random: &mut ChaCha8Rng, least: u16, count: u16) -> ChannelCodes {
    [(); 16].map(|()| {
        let [low, high, ..] = random.next_u32().to_le_bytes();
        least + u16::from_le_bytes([low, high]) % count
    })
}

fn words<T: ToString>(numbers: impl IntoIterator<Item = T>) -> String {
    let words: Vec<String> = numbers.into_iter().map(|number| number.to_string()).collect();
    words.join(" ")
}

fn random_frame(
    link: &str,
    number: u32,
    random: &mut ChaCha8Rng,
) -> Result<(Vec<u8>, String), Box<dyn Error>> {
    let eleven_bits = channels(random, 0, 2048);
    let bits = random.next_u32();
    let bit = |at: u32| bits >> at & 1 == 1;
    let sequence = number.to_le_bytes()[0];
    Ok(match link {
        "crsf" => (crsf::encode(&eleven_bits).to_vec(), words(eleven_bits)),
        "sbus" => {
            let flags = sbus::Flags {
                switches: [bit(0), bit(1)],
                frame_lost: bit(2),
                failsafe: bit(3),
            };
            let carried = words(eleven_bits.into_iter().chain([(bits & 0x0f) as u16]));
            (sbus::encode(&eleven_bits, flags).to_vec(), carried)
        }
        "multi" => {
            let [model, sub_protocol, option, ..] = bits.to_le_bytes();
            let settings = multi::Settings {
                model: model % 16,
                sub_protocol: sub_protocol % 4,
                option,
                low_power: bit(30),
                bind: bit(31),
            };
            let fields = [
                settings.model,
                settings.sub_protocol,
                option,
                settings.low_power.into(),
                settings.bind.into(),
            ];
            let carried = words(eleven_bits.into_iter().chain(fields.map(u16::from)));
            (multi::encode(&eleven_bits, settings).to_vec(), carried)
        }
        "override" => {
            let channels = channels(random, 0, u16::MAX);
            let message = MavlinkPacket::RcOverride {
                target: [1, 1],
                channels,
            };
            (mavlink_bytes(&message, sequence), words(channels))
        }
        "crazyflie" => {
            // Up to 35 rad/s.
            let rates = [(); 3].map(|()| f64::from(random.next_u32() % 70_000_001) - 35e6);
            let thrust = u32::from(channels(random, 0, u16::MAX)[0]);
            let setpoint = RateSetpoint::new(rates.map(|rate| 1e-6 * rate), f64::from(thrust) / 65_535.0);
            let mut frame = Frame::default();
            crazyflie::encode(&CrazyfliePacket::Rates(setpoint), &mut frame);
            let carried = words(rates.into_iter().chain([f64::from(thrust)]));
            (frame.bytes().to_vec(), carried)
        }
        "mavlink" => {
            let number = |random: &mut ChaCha8Rng| random.next_u32() as f32 / u32::MAX as f32;
            let target = AttitudeTarget {
                time_ms: bits,
                rates_body: [19.0, 19.0, 8.0].map(|most: f32| most * (2.0 * number(random) - 1.0)),
                thrust: number(random),
                target: [1, 1],
            };
            let [x, y, z] = target.rates_body.map(f32::to_bits);
            let carried = words([target.time_ms, x, y, z, target.thrust.to_bits()]);
            (
                mavlink_bytes(&MavlinkPacket::AttitudeTarget(target), sequence),
                carried,
            )
        }
        link => return Err(format!("there is no link {link}").into()),
    })
}

fn mavlink_bytes(message: &MavlinkPacket, sequence: u8) -> Vec<u8> {
    let sender = Sender {
        system: 255,
        component: 190,
    };
    let mut frame = Frame::default();
    mavlink::encode(message, sender, sequence, &mut frame);
    frame.bytes().to_vec()
}

/// Sends random pulses and reads them back. Sent as roll, pitch, thrust, yaw; reported as roll, pitch, yaw, thrust.
fn exchange_msp(count: u32, random: &mut ChaCha8Rng, address: &str) -> Result<(), Box<dyn Error>> {
    let mut controller = TcpStream::connect(address)?;
    controller.set_nodelay(true)?;
    controller.set_read_timeout(Some(TIMEOUT))?;
    let mut requests = 0;
    for number in 0..count {
        let sent = channels(random, 1000, 1001);
        let mut expected = sent;
        expected.swap(2, 3);
        let began = Instant::now();
        loop {
            // Repeated: a flight controller declares a silent receiver lost.
            controller.write_all(&msp::encode(&sent))?;
            controller.write_all(&msp::request(msp::RC))?;
            requests += 1;
            let received = read_channels(&mut controller)?;
            if received == expected {
                break;
            }
            if began.elapsed() > TIMEOUT {
                return Err(format!("frame {number}: sent {expected:?}, received {received:?}").into());
            }
        }
    }
    println!("{count} frames read back exactly by MSP_RC, {requests} requests");
    Ok(())
}

/// Returns the channels of the next response to `MSP_RC`.
fn read_channels(controller: &mut TcpStream) -> Result<ChannelCodes, Box<dyn Error>> {
    let mut receiver = msp::Receiver::default();
    let mut byte = [0];
    loop {
        controller.read_exact(&mut byte)?;
        if let msp::Step::Complete(message) = receiver.push(byte[0])
            && message.command == msp::RC
        {
            return Ok(message.channels().0);
        }
    }
}
