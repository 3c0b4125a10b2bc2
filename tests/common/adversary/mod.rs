//! An adversary between a motion-capture system and the flight: it takes the system's frames, spoils them by a plan, and
//! serves them on as the same system.
//!
//! All randomness is in the plan, which a seed gives. Times of a plan begin when the test says so, so that the start of a
//! flight is never spoiled.

mod downstream;
mod plan;

use std::collections::VecDeque;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use motion_capture::transport::{Address, CaptureSource};
use motion_capture::wire::{CapturePose, Frame};
use nalgebra::{Matrix3, Unit, Vector3};
use runtime::flight_clock::monotonic_ns;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use scenario::CaptureSystem;
use shared_types::rotation::exp;

use downstream::{Downstream, OutBody, OutFrame};
pub(crate) use plan::{Event, KINDS, Kind, Spoil, plan};
use plan::{Part, Stranger};

/// Name of the vehicle's body.
const VEHICLE: &[u8] = b"quad";
/// Id of the vehicle's body and of the first stranger.
const VEHICLE_ID: i32 = 1;
const STRANGER_ID: i32 = 2;
/// Added to all stamps, ns, so that a clock that is set back stays above 0.
const EPOCH_NS: i64 = 1_000_000_000_000_000;
/// Longest wait of the thread, ns.
const WAIT_NS: u64 = 2_000_000;
/// Longest time without a frame of the system on a machine that does not stand still, ns.
const GAP_NS: u64 = 60_000_000;

/// A frame that was served: when, and whether the vehicle's pose in it was spoiled or beside strangers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Served {
    pub(crate) at_ns: u64,
    pub(crate) event: Option<usize>,
}

/// Facts of a proxy.
#[derive(Clone, Debug, Default)]
pub(crate) struct Record {
    /// The frames, from the begin of the plan on.
    pub(crate) served: Vec<Served>,
    /// Time at which the machine was first seen to have stood still, ns.
    pub(crate) stood_still_ns: Option<u64>,
}

/// The ports of a proxy.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ports {
    /// Of the system: its server's, with Vicon the one to which it sends.
    pub(crate) system: u16,
    /// The same of the flight.
    pub(crate) flight: u16,
    /// To which frames of `NatNet` go.
    pub(crate) frames: u16,
}

/// The adversary, which ends with its owner.
pub(crate) struct Adversary {
    stop: Arc<AtomicBool>,
    began_ns: Arc<AtomicU64>,
    record: Arc<Mutex<Record>>,
    thread: Option<JoinHandle<()>>,
}

impl Adversary {
    /// Begins to hand on the frames of a system.
    pub(crate) fn start(system: CaptureSystem, ports: Ports, plan: Vec<Event>) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let began_ns = Arc::new(AtomicU64::new(u64::MAX));
        let record = Arc::new(Mutex::new(Record::default()));
        let mut proxy = Proxy {
            source: Address {
                system,
                server: SocketAddrV4::new(Ipv4Addr::LOCALHOST, ports.system),
                interface: Ipv4Addr::LOCALHOST,
            }
            .open()
            .unwrap(),
            out: Downstream::open(system, ports),
            spoiler: Spoiler::new(plan),
            coming: VecDeque::new(),
            came_ns: None,
            record: Arc::clone(&record),
        };
        let (to_stop, began) = (Arc::clone(&stop), Arc::clone(&began_ns));
        let thread = std::thread::spawn(move || {
            while !to_stop.load(Ordering::Relaxed) {
                proxy.step(began.load(Ordering::Relaxed));
            }
        });
        Self {
            stop,
            began_ns,
            record,
            thread: Some(thread),
        }
    }

    /// Begins the plan now.
    pub(crate) fn begin(&self) {
        self.began_ns.store(monotonic_ns(), Ordering::Relaxed);
    }

    /// Returns whether the machine has stood still since the plan began.
    pub(crate) fn has_stood_still(&self) -> bool {
        self.record.lock().unwrap().stood_still_ns.is_some()
    }

    /// Ends it, and returns what it has done.
    pub(crate) fn end(mut self) -> Record {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
        std::mem::take(&mut *self.record.lock().unwrap())
    }
}

impl Drop for Adversary {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// The thread's part.
struct Proxy {
    source: Box<dyn CaptureSource>,
    out: Downstream,
    spoiler: Spoiler,
    /// Frames that wait, with the time of their sending, ns.
    coming: VecDeque<(u64, OutFrame)>,
    came_ns: Option<u64>,
    record: Arc<Mutex<Record>>,
}

impl Proxy {
    fn step(&mut self, began_ns: u64) {
        let now_ns = monotonic_ns();
        let Self {
            source,
            spoiler,
            coming,
            came_ns,
            record,
            ..
        } = self;
        source.poll(now_ns, &mut |frame| {
            if now_ns >= began_ns {
                let mut record = record.lock().unwrap();
                if came_ns.is_some_and(|came_ns| now_ns - came_ns > GAP_NS) {
                    record.stood_still_ns.get_or_insert(now_ns);
                }
            }
            *came_ns = Some(now_ns);
            let since_ns = now_ns.checked_sub(began_ns);
            coming.push_back(spoiler.spoilt(frame, now_ns, since_ns));
        });
        self.out.serve(self.spoiler.strangers());
        let mut index = 0;
        while index < self.coming.len() {
            if self.coming[index].0 > now_ns {
                index += 1;
                continue;
            }
            let (_, frame) = self.coming.remove(index).unwrap();
            self.out.send(&frame);
            if now_ns >= began_ns {
                let served = Served {
                    at_ns: now_ns,
                    event: frame.event,
                };
                self.record.lock().unwrap().served.push(served);
            }
        }
        self.wait(now_ns);
    }

    fn wait(&self, now_ns: u64) {
        let due_ns = self.coming.iter().map(|(due_ns, _)| *due_ns).min();
        let wait_ns = due_ns.map_or(WAIT_NS, |due_ns| due_ns.saturating_sub(now_ns).min(WAIT_NS));
        let timeout = Timespec {
            tv_sec: 0,
            tv_nsec: wait_ns as i64,
        };
        let descriptors = self.source.descriptors();
        let mut waits: Vec<PollFd<'_>> = descriptors
            .iter()
            .flatten()
            .map(|descriptor| PollFd::from_borrowed_fd(descriptor.as_fd(), PollFlags::IN))
            .collect();
        let _ = poll(&mut waits, Some(&timeout));
    }
}

/// The plan under way.
struct Spoiler {
    plan: Vec<Event>,
    /// Number of frames so far, which numbers those of systems without numbers.
    frames: u32,
    active: Option<usize>,
    frozen: Option<CapturePose>,
    clock_ns: i64,
}

impl Spoiler {
    fn new(plan: Vec<Event>) -> Self {
        Self {
            plan,
            frames: 0,
            active: None,
            frozen: None,
            clock_ns: 0,
        }
    }

    /// Returns the names and ids of the strangers that are in the room now.
    fn strangers(&self) -> Vec<(Vec<u8>, i32)> {
        let spoil = self.active.map(|index| self.plan[index].spoil);
        let Some(Spoil::Strange(stranger)) = spoil else {
            return Vec::new();
        };
        let names: Vec<Vec<u8>> = match stranger {
            Stranger::Twins => vec![b"box".to_vec(), b"box".to_vec()],
            Stranger::LongName => vec![vec![b'x'; 300]],
            Stranger::LongTwins => vec![
                b"quadcopter_experiment_number_01".to_vec(),
                b"quadcopter_experiment_number_02".to_vec(),
            ],
            Stranger::Latin1 => vec![b"Drohne-\xc4rger".to_vec()],
            Stranger::Near => vec![b"Quad ".to_vec(), b"quad#2".to_vec()],
            _ => vec![b"wand".to_vec()],
        };
        names.into_iter().zip(STRANGER_ID..).collect()
    }

    /// Returns the frame to be sent for one of the system, and when.
    fn spoilt(&mut self, frame: &Frame, now_ns: u64, since_ns: Option<u64>) -> (u64, OutFrame) {
        let event = since_ns.and_then(|since_ns| {
            let is_now = |event: &Event| (event.from_ns..event.until_ns).contains(&since_ns);
            self.plan.iter().position(is_now)
        });
        self.set_the_clock(since_ns);
        if event != self.active {
            self.frozen = None;
            self.active = event;
        }
        self.frames += 1;
        let mut pose = frame.bodies().first().and_then(|body| body.pose);
        let mut due_ns = now_ns;
        let mut bodies = Vec::new();
        if let (Some(index), Some(since_ns)) = (event, since_ns) {
            let Event { from_ns, spoil, .. } = self.plan[index];
            match spoil {
                Spoil::Turned { gap_ns, axis, angle } => {
                    let axis = Unit::new_normalize(Vector3::from(axis)).into_inner();
                    pose = pose.filter(|_| since_ns - from_ns >= gap_ns);
                    if let Some(pose) = &mut pose {
                        pose.capture_from_markers *= exp(&(axis * angle));
                    }
                }
                Spoil::Frozen(part) => {
                    if let (Some(pose), Some(frozen)) = (&mut pose, self.frozen) {
                        if part != Part::Attitude {
                            pose.position = frozen.position;
                        }
                        if part != Part::Position {
                            pose.capture_from_markers = frozen.capture_from_markers;
                        }
                    }
                    self.frozen = pose;
                }
                Spoil::Strange(stranger) => {
                    for (name, id) in self.strangers() {
                        bodies.push(strange(stranger, &name, id, pose.as_ref(), since_ns));
                    }
                }
                Spoil::Delayed(delay_ns) => due_ns += delay_ns,
                Spoil::Burst(hold_ns) => {
                    due_ns += hold_ns - (since_ns - from_ns) % hold_ns;
                }
                Spoil::Reordered => due_ns += u64::from(self.frames % 2) * 15_000_000,
                Spoil::ClockStep(_) => {}
            }
        }
        // Between the strangers: no protocol promises an order.
        let place = bodies.len().min(1);
        bodies.insert(place, OutBody::new(VEHICLE, VEHICLE_ID, pose.as_ref()));
        let stamp = frame
            .stamp
            .map_or([0; 2], |stamp| [stamp.exposed_ns, stamp.sent_ns]);
        let [exposed_ns, sent_ns] = stamp.map(|ns| ns + EPOCH_NS + self.clock_ns);
        let frame = OutFrame {
            number: frame.number.unwrap_or(self.frames),
            exposed_ns,
            sent_ns,
            bodies,
            event,
        };
        (due_ns, frame)
    }

    fn set_the_clock(&mut self, since_ns: Option<u64>) {
        let steps = self.plan.iter().filter_map(|event| match event.spoil {
            Spoil::ClockStep(step_ns) if since_ns.is_some_and(|ns| ns >= event.from_ns) => Some(step_ns),
            _ => None,
        });
        self.clock_ns = steps.sum();
    }
}

/// Returns a stranger beside the vehicle.
fn strange(stranger: Stranger, name: &[u8], id: i32, near: Option<&CapturePose>, since_ns: u64) -> OutBody {
    let mut place = near.copied().unwrap_or(CapturePose {
        position: Vector3::zeros(),
        capture_from_markers: Matrix3::identity(),
    });
    let phase = 1e-9 * since_ns as f64;
    let (sine, cosine) = libm::sincos(phase);
    place.position += Vector3::new(1.5 + 0.5 * sine, 0.5 * cosine, 0.1 * f64::from(id));
    let mut body = OutBody::new(name, id, Some(&place));
    match stranger {
        Stranger::NotANumber => {
            body.position[1] = f64::NAN;
            body.angles[1] = f64::NAN;
        }
        Stranger::NoRotation => {
            body.quaternion = [0.0; 4];
            body.angles[0] = 12.0;
        }
        Stranger::FarAway => body.position[0] = 1500.0,
        Stranger::Degrees => {
            body.quaternion = [0.0, 0.0, 57.3, 0.0];
            body.angles[2] = 57.3;
        }
        _ => {}
    }
    body
}
