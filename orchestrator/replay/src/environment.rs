//! Environment of a replay in service processes: run folder, shared memory and the files that the processes share.
//!
//! Each service has separate topics, on which the recorded samples are published: no service receives what the replay
//! of another one publishes.

use std::error::Error;

use runtime::checkpoints::Checkpoints;
use runtime::control::{Host, Role, Start, ToService};
use runtime::deployment::Scheduler;
use runtime::doorbell::Doorbell;
use runtime::ports::{RECORDER_BUFFER, RunNode, TopicPorts};
use runtime::shared_page::SharedPage;
use runtime::step_log::StepLog;
use scenario::Scenario;
use shared_types::{Schedule, ServiceId, Topic};

use super::service_process::{InputPort, OutputPort, ProcessFailure, ServiceProcess};
use flight::interrupt::Interrupt;
use run_client::run_root::RunRoot;
use supervisor::supervision::process::Process;

/// Environment of a replay in service processes, which have to be dropped before.
pub(super) struct ReplayEnvironment<'a> {
    schedule: &'a Schedule,
    scenario: Scenario,
    page: SharedPage,
    checkpoints: Checkpoints,
    step_log: StepLog,
    doorbells: Vec<Doorbell>,
    interrupt: Interrupt,
    node: RunNode,
    /// Must be the last field: dropping it removes all shared memory, after all that uses it.
    root: RunRoot,
}

impl<'a> ReplayEnvironment<'a> {
    /// Creates the environment. `interrupt` ends the replay.
    pub(super) fn open(
        scenario: &Scenario,
        schedule: &'a Schedule,
        interrupt: &Interrupt,
    ) -> Result<Self, ProcessFailure> {
        let root = RunRoot::create().map_err(setup)?;
        let doorbells = ServiceId::ALL.iter().map(|_| Doorbell::create());
        Ok(Self {
            schedule,
            // Without real-time settings: a replay needs none of the machine.
            scenario: scenario.experiment(),
            page: SharedPage::create().map_err(setup)?,
            checkpoints: Checkpoints::create().map_err(setup)?,
            step_log: StepLog::create().map_err(setup)?,
            doorbells: doorbells.collect::<Result<_, _>>().map_err(setup)?,
            interrupt: interrupt.clone(),
            node: RunNode::join(&root.configuration(), "orchestrator").map_err(setup)?,
            root,
        })
    }

    /// Creates the topics of a service and starts its process; does not wait until it is ready.
    pub(super) fn start(&self, service: ServiceId) -> Result<ServiceProcess, ProcessFailure> {
        let mut inputs = Vec::new();
        for input in service.inputs() {
            let ports = self.create(input.topic, service)?;
            let sender = ports.newest_sender().map_err(setup)?;
            inputs.push(InputPort::new(sender, ports));
        }
        let mut outputs = Vec::new();
        for output in self.schedule.outputs(service) {
            let ports = self.create(output.topic, service)?;
            let receiver = ports.recorder(RECORDER_BUFFER).map_err(setup)?;
            let publication = self.schedule.publication(output.topic);
            outputs.push(OutputPort::new(publication, receiver, ports));
        }
        let process = self.start_process(service)?;
        let process = ServiceProcess::new(service, process, inputs, outputs, self.interrupt.clone());
        process.send(&ToService::Start(Box::new(self.start_of(service))))?;
        process.send(&ToService::MakePorts)?;
        Ok(process)
    }

    fn create(&self, topic: Topic, replayed: ServiceId) -> Result<Box<dyn TopicPorts>, ProcessFailure> {
        let topic = self.node.create_replayed_topic(topic, replayed, self.schedule);
        topic.map_err(setup)
    }

    fn start_process(&self, service: ServiceId) -> Result<Process, ProcessFailure> {
        let shared = [
            self.page.file(),
            self.checkpoints.file(),
            self.step_log.file(),
            self.root.lock(),
        ];
        let label = run_client::runs::label(self.root.folder(), Host::Replay);
        Process::start(service.name(), label, shared, &self.doorbells).map_err(setup)
    }

    fn start_of(&self, service: ServiceId) -> Start {
        Start {
            scenario: self.scenario.clone(),
            iceoryx2_configuration: self.root.configuration(),
            core: None,
            scheduler: Scheduler::Fair,
            role: Some(Role { service, crash: None }),
            host: Host::Replay,
        }
    }
}

fn setup(error: impl Error + Send + Sync + 'static) -> ProcessFailure {
    ProcessFailure::Setup(error.into())
}
