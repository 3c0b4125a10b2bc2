//! An external service as docs/process_contract.md describes it: the test program itself, started again in place of a service.

use std::fs::File;
use std::path::Path;

use host::step::{Slots, Timetable, Views};
use runtime::control::{Channel, ToOrchestrator, ToService};
use runtime::crash::CrashPoint;
use runtime::descriptors::inherited;
use runtime::doorbell::Doorbell;
use runtime::flight_clock::{FlightClock, nap_until};
use runtime::input_port::InputPort;
use runtime::input_queue::InputQueue;
use runtime::output_ports::OutputPorts;
use runtime::ports::{Receiver, RunNode, Topics};
use rustix::event::{PollFd, PollFlags, poll};
use scenario::Scenario;
use serde_json::Value;
use shared_types::service::ErasedService;
use shared_types::{Schedule, ServiceId};

/// Names what an external service of this test is to do.
pub(crate) const CONDUCT: &str = "GERONO_TEST_GUEST";

/// The launch manifest's descriptor.
pub(crate) const MANIFEST: i32 = 4;

/// A setting by which this test's `an_external_service` flies in place of a service.
pub(crate) fn external_service(service: ServiceId, conduct: &str) -> String {
    let test = std::env::current_exe().unwrap();
    let words = [
        "env",
        &format!("{CONDUCT}={conduct}"),
        test.to_str().unwrap(),
        "--exact",
        "an_external_service",
    ];
    program(service, &words)
}

/// A setting by which a program flies in place of a service.
pub(crate) fn program(service: ServiceId, words: &[&str]) -> String {
    format!("programs.{service}={}", serde_json::to_string(words).unwrap())
}

/// An external service as docs/process_contract.md describes it, around the service's own step logic.
pub(crate) struct ExternalService {
    pub(crate) about: Value,
    pub(crate) id: ServiceId,
    pub(crate) schedule: Schedule,
    pub(crate) service: Box<dyn ErasedService>,
    pub(crate) channel: Channel,
    pub(crate) topics: Topics,
    pub(crate) outputs: OutputPorts,
    pub(crate) bell: Doorbell,
    pub(crate) others: Vec<Doorbell>,
    _member: RunNode,
    /// Its misconduct beside its work, with each tick before its samples are sent.
    pub(crate) mischief: Mischief,
}

/// The misconduct of an external service: it gets the tick, and the bytes of each sample that it is about to send.
pub(crate) type Mischief = Box<dyn FnMut(u64, &mut [&mut [u8]])>;

impl ExternalService {
    pub(crate) fn join() -> Self {
        let about: Value = serde_json::from_reader(File::from(inherited(MANIFEST).unwrap())).unwrap();
        let descriptor =
            |number: &Value| inherited(i32::try_from(number.as_i64().unwrap()).unwrap()).unwrap();
        let scenario: Scenario = serde_json::from_value(about["scenario"].clone()).unwrap();
        let schedule = scenario.schedule().unwrap();
        let id = ServiceId::from_name(about["service"].as_str().unwrap()).unwrap();
        let channel = Channel::inherited(descriptor(&about["control"]));
        assert_eq!(channel.receive::<ToService>().unwrap(), ToService::MakePorts);
        let configuration = about["iceoryx2_configuration"].as_str().unwrap();
        let member = RunNode::join(Path::new(configuration), "external_service").unwrap();
        let topics = Topics::open(&member, id, &schedule).unwrap();
        let outputs = OutputPorts::open(&topics, id, &schedule, |topic| topic.newest_sender()).unwrap();
        let mut bells: Vec<&Value> = about["outputs"]
            .as_array()
            .unwrap()
            .iter()
            .flat_map(|output| output["bells"].as_array().unwrap())
            .collect();
        bells.sort_by_key(|number| number.as_i64());
        bells.dedup();
        Self {
            id,
            service: registry::build(id, &scenario).unwrap(),
            channel,
            outputs,
            topics,
            bell: Doorbell::inherited(descriptor(&about["bell"])),
            others: bells
                .into_iter()
                .map(|bell| Doorbell::inherited(descriptor(bell)))
                .collect(),
            schedule,
            about,
            _member: member,
            mischief: Box::new(|_, _| {}),
        }
    }

    pub(crate) fn receivers(&self) -> Vec<Box<dyn Receiver>> {
        let inputs = self.schedule.inputs(self.id);
        inputs
            .map(|(_, input)| self.topics.ports(input.topic).receiver().unwrap())
            .collect()
    }

    /// Says that it is ready and waits for the start: when tick 0 begins.
    pub(crate) fn await_go(&self, receivers: &[Box<dyn Receiver>]) -> u64 {
        let ready = ToOrchestrator::Ready {
            warnings: Vec::new(),
            receivers: receivers
                .iter()
                .map(|receiver| format!("{:x}", receiver.id()))
                .collect(),
        };
        self.channel.send(&ready).unwrap();
        let ToService::Go { start_ns, .. } = self.channel.receive().unwrap() else {
            std::process::exit(0);
        };
        start_ns
    }

    /// Sleeps until a bell rings or the orchestrator speaks, connects to restarted services, and ends with the run.
    pub(crate) fn rest(&mut self, inputs: &mut [InputPort]) {
        let mut files = [
            PollFd::new(&self.bell, PollFlags::IN),
            PollFd::new(&self.channel, PollFlags::IN),
        ];
        poll(&mut files, None).unwrap();
        let [has_rung, has_spoken] = files.map(|file| !file.revents().is_empty());
        if has_rung {
            self.bell.sleep();
        }
        if has_spoken {
            let Ok(ToService::Connect { birth }) = self.channel.receive() else {
                std::process::exit(0);
            };
            self.outputs.connect().unwrap();
            inputs
                .iter_mut()
                .for_each(|input| input.receiver().connect().unwrap());
            self.channel.send(&ToOrchestrator::Connected { birth }).unwrap();
        }
    }

    pub(crate) fn publish(&mut self, timetable: &Timetable, tick: u64, views: &Views<'_>) {
        let mut slots = Slots::default();
        self.outputs.loan(tick, &mut slots).unwrap();
        timetable
            .step(self.service.as_mut(), tick, views, &mut slots)
            .unwrap();
        let mut samples: Vec<&mut [u8]> = slots
            .iter_mut()
            .filter_map(|slot| slot.bytes.as_deref_mut())
            .collect();
        (self.mischief)(tick, &mut samples);
        self.outputs.send(tick, CrashPoint::default()).unwrap();
        self.others.iter().for_each(Doorbell::ring);
    }

    pub(crate) fn fly_in_lock_step(&mut self, until: u64) {
        let receivers = self.receivers();
        self.await_go(&receivers);
        let timetable = Timetable::new(&self.schedule, self.id);
        let mut inputs: Vec<_> = receivers
            .into_iter()
            .enumerate()
            .map(|(index, receiver)| {
                let edge = self.schedule.edge(self.id, index);
                let publisher = edge.topic.publisher().unwrap();
                InputPort::new(index, edge, publisher, receiver)
            })
            .collect();
        let ticks =
            (0..=self.schedule.last_tick().min(until)).filter(|&tick| timetable.steps.occurs_at(tick));
        for tick in ticks {
            for at in 0..inputs.len() {
                let Some(due) = inputs[at].edge.due_sample(tick) else {
                    continue;
                };
                while !inputs[at].advance(tick, due).unwrap() {
                    self.rest(&mut inputs);
                }
            }
            let mut views = Views::default();
            for input in &mut inputs {
                if let Some(due) = input.edge.due_sample(tick) {
                    let index = input.index;
                    views[index] = input.view(tick, due);
                }
            }
            self.publish(&timetable, tick, &views);
        }
    }

    pub(crate) fn fly_in_real_time(&mut self, until: u64) {
        let receivers = self.receivers();
        let start_ns = self.await_go(&receivers);
        let tick_ns = self.about["tick_ns"].as_u64().unwrap();
        let clock = FlightClock { start_ns, tick_ns };
        let timetable = Timetable::new(&self.schedule, self.id);
        let mut queues: Vec<_> = receivers
            .into_iter()
            .enumerate()
            .map(|(index, receiver)| {
                let publisher = self.schedule.edge(self.id, index).topic.publisher().unwrap();
                InputQueue::new(&self.schedule, self.id, index, publisher, receiver)
            })
            .collect();
        let mut next = Some(0);
        while let Some(due) = next.filter(|&tick| tick <= self.schedule.last_tick().min(until)) {
            let now = timetable
                .steps
                .last_at_or_before(clock.tick().min(self.schedule.last_tick()));
            let tick = due.max(now.unwrap_or(due));
            nap_until(clock.begins_at(tick));
            let give_up = clock.begins_at(tick) + self.about["grace_ns"].as_u64().unwrap();
            for queue in &mut queues {
                while !queue.has_arrived(tick).unwrap() && clock.start_ns + clock.elapsed_ns() < give_up {
                    self.bell.sleep_with_timeout(tick_ns / 10);
                }
            }
            let mut views = Views::default();
            for queue in &mut queues {
                let index = queue.index;
                if let Some(delivery) = queue.deliver(tick) {
                    views[index] = delivery.view;
                }
            }
            self.publish(&timetable, tick, &views);
            next = timetable.steps.first_at_or_after(tick + 1);
        }
    }
}
