//! Ports on pseudo-terminals and sockets: a device that vanishes, blocks or is slow drops whole frames and never blocks.

use std::io::Read;
use std::net::{TcpListener, UdpSocket};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use radio_link::link::RadioLink;
use radio_link::port::{ByteFormat, Counts, FIRST_PAUSE_NS, LONGEST_PAUSE_NS, OpenError, Port, Sent, Target};
use radio_link::sender::Sender;
use radio_link::sticks::Sticks;
use radio_link::{crazyflie, crsf, sbus};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{ControlModes, tcgetattr};
use scenario::{CrazyflieUri, RadioProtocol, RcLink, Transmitter};

/// Longest wait for an event before a test gives up, s: only a broken test waits for it.
const WATCHDOG: i64 = 20;

/// A pseudo-terminal: the receiver's end, and the path of the transmitter's.
fn pseudo_terminal() -> (OwnedFd, PathBuf) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    (master, path.into())
}

fn serial(path: &Path) -> Target {
    Target::Serial {
        path: path.to_owned(),
        baud: 420_000,
        byte: ByteFormat::Plain,
    }
}

/// Reads `count` frames.
fn read_frames(master: &OwnedFd, count: usize) -> Vec<[u8; crsf::LENGTH]> {
    let mut bytes = vec![0; count * crsf::LENGTH];
    let mut filled = 0;
    while filled < bytes.len() {
        wait_for(master, PollFlags::IN);
        filled += rustix::io::read(master, &mut bytes[filled..]).unwrap();
    }
    bytes
        .chunks_exact(crsf::LENGTH)
        .map(|frame| frame.try_into().unwrap())
        .collect()
}

#[track_caller]
fn wait_for(descriptor: &OwnedFd, event: PollFlags) {
    let timeout = Timespec {
        tv_sec: WATCHDOG,
        tv_nsec: 0,
    };
    let ready = poll(&mut [PollFd::new(descriptor, event)], Some(&timeout)).unwrap();
    assert_eq!(ready, 1, "nothing has happened for {WATCHDOG} s");
}

fn frame(number: u16) -> [u8; crsf::LENGTH] {
    crsf::encode(&[number % 2048; 16])
}

#[test]
fn frames_arrive_as_they_were_sent_at_the_speed_and_format_of_the_link() {
    for (baud, byte, flags) in [
        (420_000, ByteFormat::Plain, ControlModes::empty()),
        (100_000, ByteFormat::EvenTwo, ControlModes::CSTOPB),
    ] {
        let (master, path) = pseudo_terminal();
        let mut port = Port::open(Target::Serial { path, baud, byte }).unwrap();
        let settings = tcgetattr(&master).unwrap();
        assert_eq!(settings.output_speed(), baud);
        // A pseudo-terminal keeps everything but the parity.
        assert_eq!(settings.control_modes & ControlModes::CSTOPB, flags);
        for number in 0..3 {
            assert_eq!(port.send(&frame(number), 0), Sent::Accepted);
        }
        assert_eq!(read_frames(&master, 3), [0, 1, 2].map(frame));
    }
}

#[test]
fn a_device_that_takes_nothing_loses_whole_frames_and_goes_on_with_whole_frames() {
    let (master, path) = pseudo_terminal();
    let mut port = Port::open(serial(&path)).unwrap();
    let mut taken = Vec::new();
    let mut number = 0;
    // Without a reader the buffer fills up, and no call blocks.
    while port.counts().busy < 100 {
        if port.send(&frame(number), 0) == Sent::Accepted {
            taken.push(frame(number));
        }
        number += 1;
        assert!(number < 60_000, "the buffer has no end");
    }
    assert!(taken.len() > 10);
    // A slow reader takes a few bytes at a time, so that the buffer ends within frames.
    let mut bytes = Vec::new();
    let mut piece = [0; 7];
    while bytes.len() < (taken.len() + 20) * crsf::LENGTH {
        let before = taken.len();
        if port.send(&frame(number), 0) == Sent::Accepted {
            taken.push(frame(number));
        }
        number += 1;
        assert!(taken.len() <= before + 1);
        wait_for(&master, PollFlags::IN);
        let count = rustix::io::read(&master, &mut piece).unwrap();
        bytes.extend_from_slice(&piece[..count]);
        if taken.len() > 2000 {
            break;
        }
    }
    for (read, sent) in bytes.chunks_exact(crsf::LENGTH).zip(&taken) {
        assert_eq!(read, sent, "frames are never mixed");
    }
    let counts = port.counts();
    assert_eq!(counts.sent, taken.len() as u64);
    assert_eq!(counts.sent + counts.busy, u64::from(number));
    assert_eq!((counts.closed, counts.losses), (0, 0));
}

#[test]
fn a_device_that_vanishes_is_tried_again_after_longer_and_longer_pauses() {
    let (master, path) = pseudo_terminal();
    let mut port = Port::open(serial(&path)).unwrap();
    drop(master);
    assert_eq!(port.send(&frame(0), 0), Sent::Closed);
    assert!(!port.is_open());
    // The path leads nowhere until the device is back.
    let folder = std::env::temp_dir().join(format!("gerono-radio-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let link = folder.join("radio");
    let (master, device) = pseudo_terminal();
    std::os::unix::fs::symlink(&device, &link).unwrap();
    let mut port = Port::open(serial(&link)).unwrap();
    std::fs::remove_file(&link).unwrap();
    drop(master);
    let (mut now_ns, mut pause_ns) = (1_000, FIRST_PAUSE_NS);
    assert_eq!(port.send(&frame(0), now_ns), Sent::Closed);
    for _ in 0..7 {
        now_ns += pause_ns;
        assert_eq!(port.send(&frame(0), now_ns), Sent::Closed);
        pause_ns = (2 * pause_ns).min(LONGEST_PAUSE_NS);
    }
    let (master, device) = pseudo_terminal();
    std::os::unix::fs::symlink(&device, &link).unwrap();
    assert_eq!(
        port.send(&frame(1), now_ns + pause_ns - 1),
        Sent::Closed,
        "the pause is not over"
    );
    assert_eq!(port.send(&frame(2), now_ns + pause_ns), Sent::Accepted);
    assert_eq!(read_frames(&master, 1), [frame(2)]);
    let counts = port.counts();
    assert_eq!((counts.sent, counts.closed), (1, 9));
    assert_eq!((counts.losses, counts.recoveries), (1, 1));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_is_no_device_or_in_use_is_refused_with_the_fix() {
    let refusal = |path: &str| Port::open(serial(Path::new(path))).unwrap_err();
    assert!(matches!(refusal("/dev/no-such-radio"), OpenError::Missing { .. }));
    assert!(matches!(refusal("/dev/null"), OpenError::NotSerial { .. }));
    let (_master, path) = pseudo_terminal();
    let _port = Port::open(serial(&path)).unwrap();
    let second = Port::open(serial(&path)).unwrap_err();
    assert!(matches!(second, OpenError::Busy { .. }), "{second}");
}

#[test]
fn a_connection_carries_frames_and_comes_back() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let mut port = Port::open(Target::Tcp(address)).unwrap();
    let (mut peer, _) = listener.accept().unwrap();
    assert_eq!(port.send(&frame(1), 0), Sent::Accepted);
    let mut read = [0; crsf::LENGTH];
    peer.read_exact(&mut read).unwrap();
    assert_eq!(read, frame(1));
    drop(peer);
    // The end of the connection is an event on the socket, which the next look at it finds.
    let mut now_ns = 0;
    while port.counts().losses == 0 {
        port.receive(&mut [0; 16], now_ns);
    }
    while port.counts().recoveries == 0 {
        now_ns += LONGEST_PAUSE_NS;
        port.send(&frame(2), now_ns);
    }
    let (mut peer, _) = listener.accept().unwrap();
    while port.send(&frame(3), now_ns) != Sent::Accepted {}
    peer.read_exact(&mut read).unwrap();
    assert!([frame(2), frame(3)].contains(&read));
}

#[test]
fn a_connection_without_a_reader_drops_frames_rather_than_wait() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut port = Port::open(Target::Tcp(listener.local_addr().unwrap())).unwrap();
    let (mut peer, _) = listener.accept().unwrap();
    let mut number = 0;
    let mut taken = Vec::new();
    while port.counts().busy < 100 {
        if port.send(&frame(number), 0) == Sent::Accepted {
            taken.push(frame(number));
        }
        number = number.wrapping_add(1);
    }
    drop(port);
    let mut bytes = Vec::new();
    // What was taken arrives, as long as it is whole frames.
    peer.read_to_end(&mut bytes).unwrap();
    for (read, sent) in bytes.chunks_exact(crsf::LENGTH).zip(&taken) {
        assert_eq!(read, sent);
    }
}

#[test]
fn packets_without_a_receiver_are_counted_and_the_socket_stays() {
    let nobody = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = nobody.local_addr().unwrap();
    drop(nobody);
    let mut port = Port::open(Target::Udp(address)).unwrap();
    while port.counts().closed == 0 {
        port.send(&frame(0), 0);
    }
    assert!(port.is_open());
    let peer = UdpSocket::bind(address).unwrap();
    while port.send(&frame(5), 0) != Sent::Accepted {}
    let mut read = [0; 64];
    let (count, _) = peer.recv_from(&mut read).unwrap();
    assert_eq!(read[..count], frame(5));
}

/// Every second packet seems to be accepted, for a refusal comes after its packet. A vehicle without power must not be armed.
#[test]
fn a_port_whose_frames_nobody_takes_is_lost_until_somebody_does() {
    let nobody = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = nobody.local_addr().unwrap();
    let mut port = Port::open(Target::Udp(address)).unwrap();
    let mut now_ns = 0;
    let mut send_for = |port: &mut Port, frames: u64| {
        for _ in 0..frames {
            now_ns += 10_000_000;
            port.send(&[1, 2, 3], now_ns);
            port.receive(&mut [0; 16], now_ns);
        }
        (port.is_open(), port.counts().losses, port.counts().recoveries)
    };
    assert_eq!(send_for(&mut port, 100), (true, 0, 0));
    drop(nobody);
    assert_eq!(send_for(&mut port, 45), (true, 0, 0));
    assert_eq!(send_for(&mut port, 200), (false, 1, 0));
    let _peer = UdpSocket::bind(address).unwrap();
    assert_eq!(send_for(&mut port, 20), (true, 1, 1));
}

/// A simulator of a Crazyflie, and the thread that answers its first packet.
fn answering_once(server: UdpSocket) -> std::thread::JoinHandle<UdpSocket> {
    std::thread::spawn(move || {
        let mut read = [0; 64];
        let (count, from) = server.recv_from(&mut read).unwrap();
        assert_eq!(read[..count], [crazyflie::NULL]);
        server.send_to(&[crazyflie::NULL], from).unwrap();
        server
    })
}

fn packet_at(server: &UdpSocket) -> Vec<u8> {
    let mut read = [0; 64];
    let (count, _) = server.recv_from(&mut read).unwrap();
    read[..count].to_vec()
}

#[test]
fn a_simulator_of_a_crazyflie_is_greeted_before_the_first_packet_and_after_its_restart() {
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap();
    let answering = answering_once(server);
    let mut port = Port::open(Target::Crazyflie(address)).unwrap();
    let server = answering.join().unwrap();
    let stop = [0x7c, 0];
    assert_eq!(port.send(&stop, 0), Sent::Accepted);
    assert_eq!(packet_at(&server), stop, "a packet is a datagram");
    drop(server);
    while port.counts().closed == 0 {
        port.send(&stop, 0);
    }
    let server = UdpSocket::bind(address).unwrap();
    while port.send(&stop, 0) != Sent::Accepted {}
    assert_eq!(
        [packet_at(&server), packet_at(&server)],
        [vec![crazyflie::NULL], stop.to_vec()]
    );
    assert_eq!((port.counts().losses, port.is_open()), (0, true));
}

#[test]
fn a_simulator_that_does_not_answer_is_an_error_with_the_fix() {
    let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = silent.local_addr().unwrap();
    let refused = Port::open(Target::Crazyflie(address)).unwrap_err();
    assert_eq!(refused, OpenError::Unanswered { address });
    assert!(refused.to_string().contains("start the simulator first"));
}

#[test]
fn a_dongle_that_cannot_be_used_is_an_error_with_the_fix() {
    let CrazyflieUri::Radio(address) = "radio://15/80".parse().unwrap() else {
        panic!()
    };
    let shown = Port::open(Target::Dongle(address)).unwrap_err().to_string();
    if cfg!(feature = "crazyradio") {
        assert!(shown.contains("dongle 15"), "{shown}");
    } else {
        assert!(shown.contains("--features crazyradio"), "{shown}");
    }
    // In flight the link is a lost one that is tried again.
    let mut port = Port::lost(Target::Dongle(address));
    assert_eq!(port.send(&[0x7c, 0], 0), Sent::Closed);
    assert!(!port.is_open());
}

#[test]
fn a_crazyflie_whose_command_is_lost_gets_stop_for_as_long_as_the_sender_lives() {
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    let link = RcLink {
        link: RadioProtocol::Crazyflie,
        transmitter: Some(Transmitter {
            uri: Some(format!("udp://{}", server.local_addr().unwrap())),
            silence_after: 0.02,
            ..Transmitter::default()
        }),
        ..RcLink::default()
    };
    let answering = answering_once(server);
    let opened = RadioLink::open(&link).unwrap().unwrap();
    let server = answering.join().unwrap();
    let sender = Sender::start(opened, 1_000_000).unwrap();
    sender.set(&Sticks::flying([1500, 1000, 1000, 1000]));
    while packet_at(&server)[1] != 11 {}
    let sticks = Sticks {
        is_lost: true,
        rests: false,
        ..Sticks::MOTORS_OFF
    };
    sender.set(&sticks);
    while packet_at(&server)[1] != 0 {}
    // Nothing renews these sticks either.
    for _ in 0..100 {
        assert_eq!(packet_at(&server), [0x7c, 0]);
    }
    let report = sender.stop().unwrap();
    assert_eq!(report.silent, 0);
}

/// What cflib 0.1.34 sends to disarm, to arm and as an emergency stop, by protocol version 12 and before.
const CFLIB: [[&[u8]; 2]; 3] = [
    [&[0x9d, 1, 0], &[0xdc, 1, 0]],
    [&[0x9d, 1, 1], &[0xdc, 1, 1]],
    [&[0x9d, 3], &[0x6d, 3]],
];

#[test]
fn a_crazyflie_is_disarmed_armed_and_stopped_beside_its_setpoints() {
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    let link = RcLink {
        link: RadioProtocol::Crazyflie,
        transmitter: Some(Transmitter {
            uri: Some(format!("udp://{}", server.local_addr().unwrap())),
            ..Transmitter::default()
        }),
        ..RcLink::default()
    };
    let answering = answering_once(server);
    let mut opened = RadioLink::open(&link).unwrap().unwrap();
    let server = answering.join().unwrap();
    let killed = Sticks {
        is_killed: true,
        ..Sticks::MOTORS_OFF
    };
    let all = [
        Sticks::MOTORS_OFF,
        Sticks::flying([1500, 1000, 1000, 1000]),
        killed,
    ];
    for (sticks, requests) in all.into_iter().zip(CFLIB) {
        for request in requests {
            opened.transmit(Some((sticks, 0)), 0).unwrap();
            let setpoint = packet_at(&server);
            assert_eq!(setpoint[..2], [0x7c, if sticks.codes.is_some() { 11 } else { 0 }]);
            assert_eq!(packet_at(&server), request);
        }
    }
    // Its inputs are gone too.
    let lost = Sticks {
        is_lost: true,
        ..killed
    };
    opened.transmit(Some((lost, 0)), 10_000_000_000).unwrap();
    assert_eq!(packet_at(&server), [0x7c, 0]);
    assert_eq!(packet_at(&server), CFLIB[2][0]);
    assert_eq!(opened.port().counts().sent, 7, "requests are no frames");
}

fn crsf_link(path: &Path) -> RcLink {
    RcLink {
        link: RadioProtocol::Crsf,
        transmitter: Some(Transmitter {
            device: Some(path.to_string_lossy().into_owned()),
            arming_channel: Some(5),
            silence_after: 0.02,
            ..Transmitter::default()
        }),
        ..RcLink::default()
    }
}

#[test]
fn a_sender_repeats_the_newest_sticks_and_stops_when_they_are_not_renewed() {
    let (master, path) = pseudo_terminal();
    let link = RadioLink::open(&crsf_link(&path)).unwrap().unwrap();
    let sender = Sender::start(link, 1_000_000).unwrap();
    let at_rest = crsf::decode(&read_frames(&master, 1)[0]).unwrap();
    // Roll, pitch and yaw in the middle, thrust at its lowest, disarmed.
    assert_eq!(at_rest[..5], [992, 992, 172, 992, 172]);
    let sticks = Sticks::flying([2047, 0, 2047, 2047]);
    let flown = [172, 1811, 1811, 1811, 1811];
    // Sticks are renewed even while no frame arrives: on a busy machine they would become stale.
    let mut bytes = Vec::new();
    while bytes
        .chunks_exact(crsf::LENGTH)
        .all(|frame| crsf::decode(frame).unwrap()[..5] != flown)
    {
        sender.set(&sticks);
        let mut piece = [0; 256];
        let is_ready = poll(
            &mut [PollFd::new(&master, PollFlags::IN)],
            Some(&Timespec::default()),
        )
        .unwrap()
            > 0;
        let count = if is_ready {
            rustix::io::read(&master, &mut piece).unwrap()
        } else {
            0
        };
        bytes.extend_from_slice(&piece[..count]);
        std::thread::yield_now();
    }
    // Sticks are no longer renewed: frames stop, which triggers the receiver's failsafe.
    while sender.condition().silent == 0 {
        std::thread::yield_now();
    }
    let silenced = sender.condition();
    while sender.condition().silent < silenced.silent + 5 {
        std::thread::yield_now();
    }
    let report = sender.stop().unwrap();
    assert!(silenced.is_open && silenced.sent > 0);
    assert_eq!(report.counts.sent, silenced.sent);
    assert_eq!(report.lateness_ns.len(), report.counts.sent + report.silent);
    let Counts { busy, closed, .. } = report.counts;
    assert_eq!((busy, closed), (0, 0));
}

#[test]
fn the_last_frame_has_the_sticks_that_were_put_last() {
    let (master, path) = pseudo_terminal();
    let link = RadioLink::open(&crsf_link(&path)).unwrap().unwrap();
    let sender = Sender::start(link, 1_000_000).unwrap();
    let flying = Sticks::flying([1000; 4]);
    sender.set(&flying);
    sender.set(&Sticks::MOTORS_OFF);
    let report = sender.stop().unwrap();
    let sent = usize::try_from(report.counts.sent).unwrap();
    let frames = read_frames(&master, sent);
    let last = crsf::decode(frames.last().unwrap()).unwrap();
    assert_eq!(last[..5], [992, 992, 172, 992, 172]);
}

/// Every way to stop the motors, on a link whose frames go on in each: before the first sticks, disarmed, lost, lost for
/// long, and no longer renewed.
#[test]
fn a_reversed_channel_asks_for_no_thrust_whatever_stops_the_motors() {
    const SECOND: u64 = 1_000_000_000;
    for (reversed, slope, rest) in [
        ("", 3.0, 172),
        ("T", 3.0, 1811),
        ("", -3.0, 1811),
        ("T", -3.0, 172),
    ] {
        let (master, path) = pseudo_terminal();
        let link = RcLink {
            link: RadioProtocol::Sbus,
            thrust_slope: slope,
            transmitter: Some(Transmitter {
                device: Some(path.to_str().unwrap().to_owned()),
                reversed: reversed.to_owned(),
                ..Transmitter::default()
            }),
            ..RcLink::default()
        };
        let mut link = RadioLink::open(&link).unwrap().unwrap();
        let lost = Sticks {
            is_lost: true,
            ..Sticks::MOTORS_OFF
        };
        let flying = Sticks::flying([1500; 4]);
        for (newest, now_ns, is_flagged) in [
            (None, 0, false),
            (Some((Sticks::MOTORS_OFF, SECOND)), SECOND, false),
            (Some((lost, 2 * SECOND)), 2 * SECOND, false),
            (Some((lost, 3 * SECOND)), 3 * SECOND, true),
            (Some((flying, 4 * SECOND)), 5 * SECOND, true),
        ] {
            assert_eq!(link.transmit(newest, now_ns), Some(Sent::Accepted));
            let mut frame = [0; sbus::LENGTH];
            wait_for(&master, PollFlags::IN);
            assert_eq!(rustix::io::read(&master, &mut frame).unwrap(), sbus::LENGTH);
            let (codes, flags) = sbus::decode(&frame).unwrap();
            assert_eq!(
                (codes[2], flags.failsafe),
                (rest, is_flagged),
                "{reversed:?} {slope}"
            );
        }
    }
}

#[test]
fn the_link_of_a_dead_process_is_opened_again_whether_its_device_is_there_or_not() {
    let folder = std::env::temp_dir().join(format!("gerono-reopened-{}", std::process::id()));
    std::fs::create_dir(&folder).unwrap();
    let device = folder.join("radio");
    let mut link = RadioLink::reopen(&crsf_link(&device)).unwrap();
    assert_eq!(
        link.transmit(Some((Sticks::MOTORS_OFF, 0)), 0),
        Some(Sent::Closed)
    );
    let (master, path) = pseudo_terminal();
    std::os::unix::fs::symlink(&path, &device).unwrap();
    let now_ns = FIRST_PAUSE_NS;
    let sent = link.transmit(Some((Sticks::MOTORS_OFF, now_ns)), now_ns);
    assert_eq!(sent, Some(Sent::Accepted));
    assert_eq!(read_frames(&master, 1).len(), 1);
    let counts = link.port().counts();
    assert_eq!((counts.losses, counts.recoveries), (1, 1));
    std::fs::remove_dir_all(&folder).unwrap();
}
