//! The service processes of a run: started, watched, stopped, and never left behind.

use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::control::{CONTROL_FD, Channel, ControlError, Start, ToOrchestrator, ToService};
use runtime::descriptors::hand_on;
use runtime::doorbell::Doorbell;
use runtime::shared_page::SharedPage;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use shared_types::ServiceId;

use super::FlightFailure;

/// How long the services may take to make their ports.
const READY_LIMIT: Duration = Duration::from_secs(30);
/// How long a service that was told to stop may take before it is killed.
const STOP_LIMIT: Duration = Duration::from_secs(2);

/// All service processes of a run. Dropping it ends them.
pub struct Crew {
    members: Vec<CrewMember>,
    page: SharedPage,
    doorbells: Vec<Doorbell>,
}

struct CrewMember {
    service: ServiceId,
    child: Child,
    death: OwnedFd,
    channel: Channel,
    exit: Option<ExitStatus>,
    finished: bool,
}

/// How a process ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exit {
    /// Whether a signal ended it.
    pub killed: bool,
    /// How it ended, in words.
    pub description: String,
}

/// What a service process told or did.
#[derive(Debug)]
pub enum CrewEvent {
    /// It made its ports.
    Ready {
        /// Which one.
        service: ServiceId,
        /// Ids of its receivers.
        receivers: Vec<String>,
        /// What it could not have of its deployment.
        warnings: Vec<String>,
    },
    /// It has flown its last tick.
    Finished(ServiceId),
    /// It cannot go on, or is gone.
    Lost(FlightFailure),
}

impl Crew {
    /// Starts one process a service and tells each what to fly.
    ///
    /// # Errors
    /// [`FlightFailure::Setup`].
    pub fn start(start: &Start) -> Result<Self, FlightFailure> {
        let page = SharedPage::create().map_err(setup)?;
        let doorbells = ServiceId::ALL
            .iter()
            .map(|_| Doorbell::create())
            .collect::<Result<_, _>>()
            .map_err(setup)?;
        let mut crew = Self {
            members: Vec::new(),
            page,
            doorbells,
        };
        for service in ServiceId::ALL {
            let member = crew.spawn(service)?;
            // Kept before it is spoken to, so that it is ended whatever happens next.
            crew.members.push(member);
            crew.say(service, &ToService::Start(Box::new(start.clone())))?;
        }
        Ok(crew)
    }

    fn spawn(&self, service: ServiceId) -> Result<CrewMember, FlightFailure> {
        let (channel, theirs) = Channel::pair().map_err(setup)?;
        // The running program itself, even if its file has been replaced meanwhile.
        let mut command = Command::new("/proc/self/exe");
        command
            .args(["service", service.name()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            // Ctrl-C in a terminal is for the orchestrator alone.
            .process_group(0);
        let doorbells = self.doorbells.iter().map(AsFd::as_fd);
        let files = [theirs.as_fd(), self.page.file()].into_iter().chain(doorbells);
        hand_on(&mut command, CONTROL_FD, files).map_err(setup)?;
        let child = command.spawn().map_err(setup)?;
        let pid = Pid::from_child(&child);
        let death = pidfd_open(pid, PidfdFlags::empty()).map_err(|error| setup(error.into()))?;
        Ok(CrewMember {
            service,
            child,
            death,
            channel,
            exit: None,
            finished: false,
        })
    }

    /// The words that the crew shares.
    #[must_use]
    pub fn page(&self) -> &SharedPage {
        &self.page
    }

    /// The processes, by service.
    pub fn processes(&self) -> impl Iterator<Item = (ServiceId, u32)> {
        self.members
            .iter()
            .map(|member| (member.service, member.child.id()))
    }

    /// How the processes that have ended did.
    pub fn exits(&self) -> impl Iterator<Item = (ServiceId, u32, Exit)> {
        self.members.iter().filter_map(|member| {
            let status = member.exit?;
            let exit = Exit {
                killed: status.signal().is_some(),
                description: describe(status),
            };
            Some((member.service, member.child.id(), exit))
        })
    }

    /// Waits until every service has made its ports; the ids of their receivers and their warnings.
    ///
    /// # Errors
    /// [`FlightFailure`] if one of them fails or takes too long.
    pub fn await_ready(&mut self) -> Result<(Vec<String>, Vec<String>), FlightFailure> {
        let deadline = Instant::now() + READY_LIMIT;
        let mut missing: Vec<ServiceId> = ServiceId::ALL.to_vec();
        let (mut ids, mut notes) = (Vec::new(), Vec::new());
        while !missing.is_empty() {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let services = missing.iter().map(ToString::to_string).collect();
                return Err(FlightFailure::NotReady {
                    services,
                    limit: READY_LIMIT,
                });
            }
            for event in self.watch(left) {
                match event {
                    CrewEvent::Ready {
                        service,
                        receivers,
                        warnings,
                    } => {
                        missing.retain(|&other| other != service);
                        ids.extend(receivers);
                        notes.extend(warnings);
                    }
                    CrewEvent::Lost(failure) => return Err(failure),
                    CrewEvent::Finished(_) => {}
                }
            }
        }
        notes.sort();
        notes.dedup();
        Ok((ids, notes))
    }

    /// Lets everybody fly, in the order of the ring.
    ///
    /// # Errors
    /// [`FlightFailure`] if one of them is gone.
    pub fn go(&mut self, receivers: &[String]) -> Result<(), FlightFailure> {
        let message = ToService::Go {
            receivers: receivers.to_vec(),
        };
        ServiceId::ALL
            .into_iter()
            .try_for_each(|service| self.say(service, &message))
    }

    /// Waits up to `limit` for something to happen and tells what did.
    pub fn watch(&mut self, limit: Duration) -> Vec<CrewEvent> {
        let timeout = Timespec {
            tv_sec: i64::try_from(limit.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: i64::from(limit.subsec_nanos()),
        };
        let living: Vec<usize> = (0..self.members.len())
            .filter(|&at| self.members[at].exit.is_none())
            .collect();
        let mut files: Vec<PollFd<'_>> = Vec::with_capacity(2 * living.len());
        for &at in &living {
            let member = &self.members[at];
            files.push(PollFd::from_borrowed_fd(member.channel.as_fd(), PollFlags::IN));
            files.push(PollFd::from_borrowed_fd(member.death.as_fd(), PollFlags::IN));
        }
        // An interrupted poll is one in which nothing happened.
        let happened = poll(&mut files, Some(&timeout)).unwrap_or(0) > 0;
        if !happened {
            return Vec::new();
        }
        let called: Vec<usize> = living
            .iter()
            .zip(files.chunks_exact(2))
            .filter(|(_, pair)| pair.iter().any(|file| !file.revents().is_empty()))
            .map(|(&at, _)| at)
            .collect();
        drop(files);
        called
            .into_iter()
            .flat_map(|at| self.members[at].listen(&self.page))
            .collect()
    }

    /// Wakes everybody to look again, whatever has become of their wake-ups.
    pub fn rouse(&self) {
        self.doorbells.iter().for_each(Doorbell::ring);
    }

    /// Tells everybody to stop, waits until all are gone, and kills who does not go.
    pub fn stop(&mut self) {
        let words = self.page.words();
        words.stopping.store(1, Ordering::SeqCst);
        for member in &self.members {
            // Who is gone already need not be told.
            let _ = member.channel.send(&ToService::Stop);
        }
        self.rouse();
        let deadline = Instant::now() + STOP_LIMIT;
        while self.members.iter().any(|member| member.exit.is_none()) {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            self.watch(left);
        }
        self.members.iter_mut().for_each(CrewMember::kill);
    }

    fn say(&mut self, service: ServiceId, message: &ToService) -> Result<(), FlightFailure> {
        let member = &mut self.members[service.index()];
        match member.channel.send(message) {
            Ok(()) => Ok(()),
            // It is gone: its exit status says more than the broken line.
            Err(ControlError::Closed) => Err(member.died(&self.page)),
            Err(error) => Err(FlightFailure::Setup(error.to_string())),
        }
    }
}

impl Drop for Crew {
    fn drop(&mut self) {
        self.stop();
    }
}

impl CrewMember {
    /// Everything that the process has said, and its end if it has ended.
    fn listen(&mut self, page: &SharedPage) -> Vec<CrewEvent> {
        let mut events = Vec::new();
        loop {
            match self.channel.try_receive::<ToOrchestrator>() {
                Ok(Some(message)) => events.push(self.understand(message)),
                Ok(None) => break,
                Err(ControlError::Closed) => {
                    events.extend(self.end(page));
                    break;
                }
                Err(error) => {
                    events.push(CrewEvent::Lost(FlightFailure::GaveUp {
                        service: self.service.to_string(),
                        reason: error.to_string(),
                    }));
                    break;
                }
            }
        }
        events
    }

    fn understand(&mut self, message: ToOrchestrator) -> CrewEvent {
        match message {
            ToOrchestrator::Ready { receivers, warnings } => CrewEvent::Ready {
                service: self.service,
                receivers,
                warnings,
            },
            ToOrchestrator::Finished => {
                self.finished = true;
                CrewEvent::Finished(self.service)
            }
            ToOrchestrator::NonFinite(found) => CrewEvent::Lost(FlightFailure::NonFinite(found)),
            ToOrchestrator::Failed { reason } => CrewEvent::Lost(FlightFailure::GaveUp {
                service: self.service.to_string(),
                reason,
            }),
        }
    }

    /// The process has closed its line; an end before its last tick is an event.
    fn end(&mut self, page: &SharedPage) -> Option<CrewEvent> {
        let failure = self.died(page);
        let stopping = page.words().stopping.load(Ordering::Relaxed) != 0;
        (!self.finished && !stopping).then_some(CrewEvent::Lost(failure))
    }

    fn died(&mut self, page: &SharedPage) -> FlightFailure {
        let status = self.child.wait().ok();
        self.exit = status;
        let steps = page.words().cells[self.service.index()]
            .steps_until
            .load(Ordering::Relaxed);
        FlightFailure::Died {
            service: self.service.to_string(),
            pid: self.child.id(),
            tick: steps.saturating_sub(1),
            how: status.map_or_else(|| "it cannot be told how".to_owned(), describe),
        }
    }

    /// Kills the process if it still lives, and takes its exit status.
    fn kill(&mut self) {
        if self.exit.is_none() {
            // Both fail only for a process that is gone.
            let _ = self.child.kill();
            self.exit = self.child.wait().ok();
        }
    }
}

fn describe(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(signal), _) => match rustix::process::Signal::from_named_raw(signal) {
            Some(name) => format!("killed by {name:?}"),
            None => format!("killed by signal {signal}"),
        },
        (None, Some(code)) => format!("it exited with code {code}"),
        (None, None) => "it cannot be told how".to_owned(),
    }
}

#[expect(
    clippy::needless_pass_by_value,
    reason = "used to map errors, which come by value"
)]
fn setup(error: std::io::Error) -> FlightFailure {
    FlightFailure::Setup(error.to_string())
}
