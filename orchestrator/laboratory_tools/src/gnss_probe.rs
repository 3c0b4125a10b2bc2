//! Diagnosis of a satellite receiver, or of an autopilot that measures: its packets, and what to do about them.

mod arguments;
mod reception;

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use navigation_receivers::Packet;
use navigation_receivers::stream::Stream;
use runtime::flight_clock::monotonic_ns;

pub use arguments::{GnssCommand, GnssProbe};
use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::print;
use flight::interrupt::Interrupt;
use laboratory::receiver_port::{self, Opened, Port, Read};
use reception::{Arrival, Reception};

/// Time between two printed lines, ns.
const LINE_NS: u64 = 1_000_000_000;
/// Maximum sleep.
const SLEEP: Duration = Duration::from_millis(50);
/// Bytes of one read; a UDP packet is at most as long.
const PIECE: usize = 65_536;

/// Receives for some seconds, prints a line each second, and at the end the result; of a file, only the result.
///
/// # Errors
/// [`Failure`] if the source cannot be opened, or nothing that a flight could use was received.
pub fn probe(arguments: &GnssProbe) -> Result<Exit, Failure> {
    let &GnssProbe {
        ref source,
        baud,
        seconds,
    } = arguments;
    let opened = receiver_port::open(source, baud).map_err(Failure::trouble)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let mut reception = Reception::default();
    let mut stream = Stream::default();
    match opened {
        Opened::File(bytes) => {
            let mut add = |packet: &Packet| reception.add(packet, None);
            stream.push(&bytes, &mut add);
            stream.finish(&mut add);
        }
        Opened::Live(mut port) => {
            let listened = listen(&mut port, seconds, &mut stream, &mut reception, &interrupt)?;
            if let Some(signal) = listened.signal {
                return Ok(Exit::Signal(signal));
            }
            reception.listened = Some(listened.seconds);
            reception.line = source.is_serial_line().then_some(baud);
        }
    }
    let counts = stream.counts();
    print(reception.describe(counts));
    let findings = reception.findings(counts, source);
    match reception.is_usable() {
        true => {
            print(
                findings
                    .iter()
                    .map(|finding| format!("{finding}\n"))
                    .collect::<String>(),
            );
            Ok(Exit::Success)
        }
        false => Err(Failure::trouble(findings.join("; "))),
    }
}

/// End of listening.
struct Listened {
    /// Signal that ended it.
    signal: Option<i32>,
    /// Its duration, s.
    seconds: f64,
}

fn listen(
    port: &mut Port,
    seconds: f64,
    stream: &mut Stream,
    reception: &mut Reception,
    interrupt: &Interrupt,
) -> Result<Listened, Failure> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an hour at most"
    )]
    let duration_ns = (seconds * 1e9) as u64;
    let start_ns = monotonic_ns();
    let mut line_ns = start_ns + LINE_NS;
    let mut bytes = vec![0; PIECE];
    let ended = |now_ns: u64, signal| Listened {
        signal,
        seconds: (now_ns - start_ns) as f64 * 1e-9,
    };
    loop {
        if let Some(signal) = interrupt.take() {
            return Ok(ended(monotonic_ns(), Some(signal)));
        }
        let read = port.read(&mut bytes, SLEEP).map_err(Failure::trouble)?;
        let now_ns = monotonic_ns();
        let arrival = Arrival {
            seconds: (now_ns - start_ns) as f64 * 1e-9,
            utc_ns: utc_ns(),
        };
        if let Read::Bytes(count) = read {
            stream.push(&bytes[..count], &mut |packet| {
                reception.add(packet, Some(arrival));
            });
        }
        if now_ns >= line_ns {
            line_ns += LINE_NS;
            print(reception.line_of_second(stream.counts()));
        }
        if matches!(read, Read::End) || now_ns - start_ns >= duration_ns {
            return Ok(ended(now_ns, None));
        }
    }
}

/// Returns the time of this machine's clock, ns since 1970; 0 before.
fn utc_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}
