//! `gerono view` as browsers have it, and as a flight has it: not at all.

use crate::common;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use common::logs::host_samples;
use common::processes::signal;
use common::{Begun, Place, begin, complaint, finish, fly_to_the_end, output, succeed, until};
use run_log::ServiceStep;
use runtime::deployment::use_idle;
use rustix::process::Signal;
use serde_json::Value;
use shared_types::ServiceId;

/// Browsers that may watch at once.
const MOST_WATCHERS: usize = 8;

/// A server, with its address.
struct View {
    child: Begun,
    address: SocketAddr,
    /// What follows the path in its address: the token, if it needs one.
    query: String,
}

/// Answer of a server: status, header lines and body.
struct Answer {
    status: u16,
    head: String,
    body: String,
}

impl View {
    /// `gerono view` with these arguments, at a free port.
    fn begin(place: &Place, arguments: &[&str]) -> Self {
        Self::try_to_begin(place, arguments).expect("it prints an address")
    }

    /// The same; none if it finds nothing to show.
    fn try_to_begin(place: &Place, arguments: &[&str]) -> Option<Self> {
        let mut child = begin(&mut place.gerono(&[&["view", "--port", "0"], arguments].concat()));
        let mut line = String::new();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        out.read_line(&mut line).unwrap();
        let (_, url) = line.trim().split_once("http://")?;
        let (address, query) = url.split_once('/').unwrap();
        Some(Self {
            child,
            address: address.parse().unwrap(),
            query: query.to_owned(),
        })
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    /// Asks with these first lines.
    fn ask(&self, lines: &str) -> Answer {
        let mut stream = self.connect();
        stream.write_all(format!("{lines}\r\n\r\n").as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        Answer {
            status: head.split(' ').nth(1).unwrap().parse().unwrap(),
            head: head.to_owned(),
            body: body.to_owned(),
        }
    }

    fn get(&self, path: &str) -> Answer {
        self.ask(&format!("GET {path} HTTP/1.1\r\nHost: {}", self.address))
    }

    /// A browser that watches.
    fn watch(&self) -> Events {
        let mut stream = self.connect();
        let request = format!("GET /live HTTP/1.1\r\nHost: {}\r\n\r\n", self.address);
        stream.write_all(request.as_bytes()).unwrap();
        Events(BufReader::new(stream))
    }
}

/// The events that a browser gets.
struct Events(BufReader<TcpStream>);

impl Events {
    /// The next event, with its name; none at the end.
    fn next(&mut self) -> Option<(String, Value)> {
        let mut name = String::new();
        loop {
            let mut line = String::new();
            if self.0.read_line(&mut line).unwrap() == 0 {
                return None;
            }
            if let Some(event) = line.strip_prefix("event: ") {
                name = event.trim_end().to_owned();
            } else if let Some(data) = line.strip_prefix("data: ") {
                return Some((name, serde_json::from_str(data).unwrap()));
            }
        }
    }

    /// The next event of a name.
    fn await_event(&mut self, wanted: &str) -> Value {
        loop {
            let (name, data) = self.next().unwrap_or_else(|| panic!("never came: {wanted}"));
            if name == wanted {
                return data;
            }
        }
    }
}

fn digest(place: &Place, out: &str) -> String {
    String::from_utf8(succeed(&mut place.gerono(&["digest", out])).stdout).unwrap()
}

/// A process that has a browser's connection and is stopped.
fn stopped(watcher: Events) -> Begun {
    let stream = watcher.0.into_inner();
    rustix::net::sockopt::set_socket_recv_buffer_size(&stream, 4096).unwrap();
    let cat = Command::new("cat")
        .stdin(Stdio::from(std::os::fd::OwnedFd::from(stream)))
        .stdout(Stdio::null())
        .spawn();
    let cat = Begun::from(cat.unwrap());
    signal(cat.id(), Signal::STOP);
    cat
}

#[test]
fn a_flight_with_eight_browsers_of_which_one_is_stopped_has_the_bytes_of_one_with_none() {
    let place = Place::new();
    let arguments = ["--host", "inprocess", "--quiet"];
    fly_to_the_end(&mut place.short_flight("alone", 600.0, &arguments));
    let flight = begin(&mut place.short_flight("watched", 600.0, &["--quiet"]));
    let view = until("a flight that can be watched", || View::try_to_begin(&place, &[]));
    // A browser that does not read is dropped after a while, so each reads by itself.
    let (has_frame, first_frames) = std::sync::mpsc::channel();
    let readers = (1..MOST_WATCHERS).map(|_| {
        let (mut watcher, has_frame) = (view.watch(), has_frame.clone());
        std::thread::spawn(move || {
            let flight = watcher.await_event("flight");
            assert_eq!(flight["is_in_real_time"], false);
            let frame = watcher.await_event("frame");
            let channels = flight["channels"].as_array().unwrap();
            assert_eq!(frame["v"].as_array().unwrap().len(), channels.len());
            has_frame.send(()).unwrap();
            while watcher.await_event("contact")["state"] != "ended" {}
            assert_eq!(watcher.next(), None);
        })
    });
    let readers: Vec<_> = readers.collect();
    drop(has_frame);
    assert_eq!(first_frames.iter().take(readers.len()).count(), readers.len());
    let mut last = view.watch();
    last.await_event("frame");
    assert_eq!(view.get("/live").status, 503);
    let _stopped = stopped(last);
    assert!(finish(flight).status.success());
    for reader in readers {
        reader.join().unwrap();
    }
    assert_eq!(finish(view.child).status.code(), Some(0));
    assert_eq!(digest(&place, "watched"), digest(&place, "alone"));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_flight_in_real_time_is_shown_and_outlives_its_watchers() {
    let place = Place::new();
    let flight = begin(&mut place.live_hover("out", &["--quiet"]));
    until("a flight that can be looked at", || place.look());
    let mut killed = View::begin(&place, &[]);
    let mut watcher = killed.watch();
    let description = watcher.await_event("flight");
    assert_eq!(description["run"], format!("{}-0", flight.id()));
    assert_eq!(description["path"].as_array().unwrap().len(), 1, "a hover");
    let status = watcher.await_event("status");
    assert_eq!(status["snapshot"]["services"].as_array().unwrap().len(), 5);
    let [first, second] = [(); 2].map(|()| watcher.await_event("frame")["t"].as_f64().unwrap());
    assert!(second > first);
    killed.child.kill().unwrap();

    let view = View::begin(&place, &[]);
    only_the_page_is_to_be_had(&view);
    let mut watcher = view.watch();
    watcher.await_event("frame");
    signal(flight.id(), Signal::INT);
    assert_eq!(finish(flight).status.code(), Some(130));
    while watcher.await_event("contact")["state"] != "ended" {}
    assert_eq!(finish(view.child).status.code(), Some(0));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

fn only_the_page_is_to_be_had(view: &View) {
    let page = view.get("/");
    assert_eq!(page.status, 200);
    assert!(
        page.head
            .contains("Content-Security-Policy: default-src 'none'; script-src 'sha256-")
    );
    assert!(page.body.contains("EventSource"));
    assert_eq!(view.get("/etc/passwd").status, 404);
    assert_eq!(view.ask("GET / HTTP/1.1\r\nHost: evil.example").status, 421);
    assert_eq!(view.ask("GET / HTTP/1.1").status, 421);
    let host = format!("Host: {}", view.address);
    for method in ["POST", "PUT", "DELETE", "HEAD", "OPTIONS"] {
        assert_eq!(view.ask(&format!("{method} / HTTP/1.1\r\n{host}")).status, 405);
    }
    let other_site = format!("GET /live HTTP/1.1\r\n{host}\r\nSec-Fetch-Site: cross-site");
    assert_eq!(view.ask(&other_site).status, 403);
    assert_eq!(
        view.ask(&format!("GET / HTTP/1.1\r\nX: {}", "x".repeat(9000)))
            .status,
        431
    );
    assert_eq!(view.ask("\x16\x03\x01").status, 400);
}

#[test]
fn a_finished_flight_is_shown_until_a_signal_comes() {
    let place = Place::new();
    fly_to_the_end(&mut place.short_flight("out", 1.0, &["--host", "inprocess", "--quiet"]));
    let view = View::begin(&place, &["out"]);
    let page = view.get("/");
    assert_eq!(page.status, 200);
    assert!(page.body.contains("id=\"moment\""), "there is a slider of time");
    assert_eq!(view.get("/live").status, 404);
    signal(view.child.id(), Signal::TERM);
    assert_eq!(finish(view.child).status.code(), Some(143));
}

#[test]
fn who_watches_from_elsewhere_needs_the_token_and_then_has_a_cookie() {
    let place = Place::new();
    fly_to_the_end(&mut place.short_flight("out", 1.0, &["--host", "inprocess", "--quiet"]));
    // Of this machine too, but not the one that browsers on it call `localhost`.
    let view = View::begin(
        &place,
        &["out", "--bind", "127.0.0.2", "--allow-host", "lab.example"],
    );
    let token = view.query.strip_prefix("?t=").expect("a token is printed");
    assert_eq!(token.len(), 32);
    let with = |query: &str, host: &str, more: &str| {
        view.ask(&format!("GET /{query} HTTP/1.1\r\nHost: {host}{more}"))
    };
    let host = view.address.to_string();
    let page = with(&view.query, &host, "");
    assert_eq!(page.status, 200);
    let cookie = page
        .head
        .lines()
        .find_map(|line| line.strip_prefix("Set-Cookie: "));
    let cookie = cookie.expect("the browser gets a cookie");
    assert!(cookie.ends_with("; HttpOnly; SameSite=Strict"), "{cookie}");
    let pair = cookie.split(';').next().unwrap();

    let cookie = format!("\r\nCookie: {pair}");
    assert_eq!(with("", &host, &cookie).status, 200);
    assert_eq!(with("", "lab.example", &cookie).status, 200);
    assert_eq!(with(&view.query, "evil.example", &cookie).status, 421);
    assert_eq!(with("", &host, "").status, 401);
    assert_eq!(with(&format!("?t={}", "0".repeat(32)), &host, "").status, 401);

    // Each start has another: an old address is good for nothing.
    let other = View::begin(&place, &["out", "--bind", "127.0.0.2"]);
    assert_ne!(other.query, view.query);
    // A proxy is for others, even where it is on this machine.
    let behind = View::begin(&place, &["out", "--allow-host", "lab.example"]);
    assert_eq!(behind.get("/").status, 401);
    let refused = output(&mut place.gerono(&["view", "out", "--bind", "192.0.2.1"]));
    assert_eq!(refused.status.code(), Some(1));
    assert!(complaint(&refused).contains("--bind"), "{}", complaint(&refused));
    for view in [view, other, behind] {
        signal(view.child.id(), Signal::TERM);
        assert_eq!(finish(view.child).status.code(), Some(143));
    }
}

#[test]
fn without_a_flight_or_a_port_it_says_what_to_do() {
    let place = Place::new();
    let none = output(&mut place.gerono(&["view"]));
    assert_eq!(none.status.code(), Some(1));
    assert!(
        complaint(&none).contains("no flight is under way"),
        "{}",
        complaint(&none)
    );

    let waits = View::begin(&place, &["--follow"]);
    let port = waits.address.port().to_string();
    let taken = output(&mut place.gerono(&["view", "--follow", "--port", &port]));
    assert_eq!(taken.status.code(), Some(1));
    assert!(complaint(&taken).contains("--port 0"), "{}", complaint(&taken));

    // A flight that comes later is shown all the same.
    let mut watcher = waits.watch();
    let flight = begin(&mut place.short_flight("out", 200.0, &["--quiet"]));
    let run = watcher.await_event("flight")["run"].clone();
    assert_eq!(run, format!("{}-0", flight.id()));
    while watcher.await_event("contact")["state"] != "ended" {}
    assert!(finish(flight).status.success());
    signal(waits.child.id(), Signal::INT);
    assert_eq!(finish(waits.child).status.code(), Some(130));
}

/// A stretch of a flight, ns since its start.
type Stretch = std::ops::Range<u64>;

/// Length of the stretches that are compared.
const STRETCH: Duration = Duration::from_secs(5);

/// Time that a view has before it is measured.
const SETTLING: Duration = Duration::from_secs(1);

/// Tick of the hover, ns.
const TICK_NS: u64 = 1_000_000;

/// Pairs of stretches.
const PAIRS: usize = 10;

#[test]
#[ignore = "prints the figures of docs/developers.md, which takes four minutes"]
fn what_eight_browsers_cost_a_flight_and_the_machine() {
    let place = Place::new();
    let flight = begin(&mut place.live_flight("hover", "out", &["duration=1000.0"]));
    let snapshot = until("a flight that can be looked at", || place.look());
    let began = Instant::now() - Duration::from_secs_f64(snapshot.time);
    let stretch = || {
        let from = began.elapsed();
        std::thread::sleep(STRETCH);
        let [from, to] = [from, began.elapsed()].map(|time| time.as_nanos() as u64);
        from..to
    };
    let mut pairs = Vec::new();
    let mut cost = [(); 3].map(|()| Vec::new());
    for pair in 0..PAIRS {
        // Now one first, now the other: the machine may change meanwhile.
        let before = pair.is_multiple_of(2).then(stretch);
        let watched = watched(&place, stretch, &mut cost);
        pairs.push((before.unwrap_or_else(stretch), watched));
    }
    signal(flight.id(), Signal::INT);
    finish(flight);
    let steps: Vec<ServiceStep> = host_samples(&place, "out", "host/steps");
    let took = |step: &ServiceStep| step.published_ns - step.began_ns;
    let late = |step: &ServiceStep| step.began_ns.saturating_sub(step.tick * TICK_NS);
    for service in ServiceId::ALL {
        compare(&format!("{service}: step took"), &pairs, |stretch| {
            times_of(&steps, service, stretch, took)
        });
        compare(&format!("{service}: step began late by"), &pairs, |stretch| {
            times_of(&steps, service, stretch, late)
        });
    }
    let [idle, one, eight] = cost.map(|values| median(&values));
    println!(
        "the view: {idle:.2} % of a core without a browser, {one:.2} % with one, {eight:.2} % with eight"
    );
}

/// The stretch in which eight browsers watch, of which one is stopped; adds what the view takes of a core, % (with none, one,
/// and eight).
fn watched(place: &Place, stretch: impl Fn() -> Stretch, cost: &mut [Vec<f64>; 3]) -> Stretch {
    let mut view = View::begin(place, &[]);
    let pid = view.child.id();
    let taken = |cost: &mut Vec<f64>| {
        std::thread::sleep(SETTLING);
        let before = cpu_seconds(pid);
        let stretch = stretch();
        cost.push(100.0 * (cpu_seconds(pid) - before) / STRETCH.as_secs_f64());
        stretch
    };
    taken(&mut cost[0]);
    // A browser runs elsewhere: here it must not compete with the flight.
    let read = |mut watcher: Events| {
        std::thread::spawn(move || {
            use_idle().unwrap();
            while watcher.next().is_some() {}
        })
    };
    let mut readers = vec![read(view.watch())];
    taken(&mut cost[1]);
    readers.extend((2..MOST_WATCHERS).map(|_| read(view.watch())));
    let stopped = stopped(view.watch());
    let stretch = taken(&mut cost[2]);
    view.child.kill().unwrap();
    drop(stopped);
    for reader in readers {
        reader.join().unwrap();
    }
    stretch
}

/// CPU time of a process, s.
fn cpu_seconds(pid: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let (_, fields) = stat.rsplit_once(')').unwrap();
    // User and system time are the 14th and 15th field, in hundredths of a second.
    let times = fields.split_whitespace().skip(11).take(2);
    times.map(|time| time.parse::<f64>().unwrap() / 100.0).sum()
}

/// Prints the medians of p50 and p99 over all pairs, and those of their ratios, pair by pair.
fn compare(what: &str, pairs: &[(Stretch, Stretch)], times: impl Fn(&Stretch) -> Vec<f64>) {
    let compared: Vec<_> = pairs
        .iter()
        .map(|(alone, watched)| (times(alone), times(watched)))
        .collect();
    for (name, share) in [("p50", 0.5), ("p99", 0.99)] {
        let of_pair = |(alone, watched): &(Vec<f64>, Vec<f64>)| {
            let [alone, watched] = [alone, watched].map(|times| quantile(times, share));
            [alone, watched, watched / alone]
        };
        let found: Vec<_> = compared.iter().map(of_pair).collect();
        let [alone, watched, ratio] =
            [0, 1, 2].map(|place| median(&found.iter().map(|pair| pair[place]).collect::<Vec<_>>()));
        println!("{what} {name} {alone:.1} us alone, {watched:.1} us watched; ratio {ratio:.3}");
    }
}

/// Times of the steps of a service that began in a stretch, us.
fn times_of(
    steps: &[ServiceStep],
    service: ServiceId,
    stretch: &Stretch,
    time_ns: impl Fn(&ServiceStep) -> u64,
) -> Vec<f64> {
    let is_in = |step: &&ServiceStep| {
        step.service as usize == service.index() && step.published_ns > 0 && stretch.contains(&step.began_ns)
    };
    let time = |step: &ServiceStep| time_ns(step) as f64 / 1e3;
    steps.iter().filter(is_in).map(time).collect()
}

fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}
