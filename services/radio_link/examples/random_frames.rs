//! Random frames for other programs to read: `random_frames LINK COUNT SEED FRAMES VALUES`.
//!
//! Writes the frames one after another to the file FRAMES, and what they carry to VALUES: a line of numbers a frame. LINK is
//! crsf, sbus, multi, mavlink (`SET_ATTITUDE_TARGET`) or override (`RC_CHANNELS_OVERRIDE`).
//!
//! `random_frames msp COUNT SEED ADDRESS` talks with a flight controller instead: it sends channels by `MSP_SET_RAW_RC` and
//! asks with `MSP_RC` until they are what it has received, which must be so exactly.

use std::error::Error;
use std::fmt::Write;
use std::io::{Read, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use radio_link::frame::Frame;
use radio_link::mavlink::{AttitudeTarget, MavlinkPacket, Sender};
use radio_link::{ChannelCodes, crsf, mavlink, msp, multi, sbus};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Longest time until a flight controller reports the channels that it received.
const PATIENCE: Duration = Duration::from_secs(2);

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [link, count, seed, rest @ ..] = arguments.as_slice() else {
        return Err("usage: random_frames LINK COUNT SEED FRAMES VALUES".into());
    };
    let (count, mut random) = (count.parse()?, ChaCha8Rng::seed_from_u64(seed.parse()?));
    match rest {
        [address] if link == "msp" => talk_msp(count, &mut random, address),
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

/// Channels of which each is a whole number from `least` on, one of `count`.
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
            let said = [
                settings.model,
                settings.sub_protocol,
                option,
                settings.low_power.into(),
                settings.bind.into(),
            ];
            let carried = words(eleven_bits.into_iter().chain(said.map(u16::from)));
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

/// Pulses that a receiver could send, and back from the flight controller: sent as roll, pitch, thrust, yaw, told as roll,
/// pitch, yaw, thrust.
fn talk_msp(count: u32, random: &mut ChaCha8Rng, address: &str) -> Result<(), Box<dyn Error>> {
    let mut controller = TcpStream::connect(address)?;
    controller.set_nodelay(true)?;
    controller.set_read_timeout(Some(PATIENCE))?;
    let mut asked = 0;
    for number in 0..count {
        let sent = channels(random, 1000, 1001);
        let mut wanted = sent;
        wanted.swap(2, 3);
        let began = Instant::now();
        loop {
            // It takes a receiver for lost that does not go on.
            controller.write_all(&msp::encode(&sent))?;
            controller.write_all(&msp::request(msp::RC))?;
            asked += 1;
            let told = answer(&mut controller)?;
            if told == wanted {
                break;
            }
            if began.elapsed() > PATIENCE {
                return Err(format!("frame {number}: sent {wanted:?}, told {told:?}").into());
            }
        }
    }
    println!("{count} frames read back exactly by MSP_RC, asked {asked} times");
    Ok(())
}

/// The channels that the next answer to `MSP_RC` tells.
fn answer(controller: &mut TcpStream) -> Result<ChannelCodes, Box<dyn Error>> {
    let mut receiver = msp::Receiver::default();
    let mut byte = [0];
    loop {
        controller.read_exact(&mut byte)?;
        if let msp::Step::Whole(message) = receiver.push(byte[0])
            && message.command == msp::RC
        {
            return Ok(message.channels().0);
        }
    }
}
