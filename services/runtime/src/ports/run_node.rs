//! Node of a process in a run, by which it opens topics.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use iceoryx2::prelude::*;
use shared_types::{Schedule, ServiceId, Topic};

use super::topic::{Access, Enter};
use super::{Delivery, PortError, TopicPorts, consumer_buffer};
use crate::shared_memory;
use host::watchdog::{self, Work};

/// Configuration file of this process's run: iceoryx2 has one global configuration a process.
static RUN: OnceLock<PathBuf> = OnceLock::new();

/// Node of a process in the run.
pub struct RunNode {
    node: Node<ipc::Service>,
    /// Prefix of the names of the run's shared memory.
    prefix: String,
}

impl RunNode {
    /// Joins the run of the given iceoryx2 configuration file. It must be the process's first use of iceoryx2: the
    /// clean-up after dead processes uses the global configuration instead of the node's.
    ///
    /// # Errors
    /// [`PortError::Configuration`] or [`PortError::Node`].
    pub fn join(configuration: &Path, name: &str) -> Result<Self, PortError> {
        set_log_level_from_env_or(LogLevel::Fatal);
        let bad_configuration = |source| PortError::Configuration {
            path: configuration.to_owned(),
            source,
        };
        let path = FilePath::new(configuration.as_os_str().as_encoded_bytes())
            .map_err(|error| bad_configuration(error.into()))?;
        if RUN.get_or_init(|| configuration.to_owned()) != configuration {
            return Err(bad_configuration(
                "this process already belongs to another run".into(),
            ));
        }
        let mut config = Config::setup_global_config_from_file(&path)
            .map_err(|error| bad_configuration(error.into()))?
            .clone();
        // Only the orchestrator cleans up, after each death. A search for dead processes at every topic would take most of
        // the start of a process.
        config.global.service.cleanup_dead_nodes_on_open = false;
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        let name = NodeName::new(name).map_err(|error| PortError::Node(error.into()))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled);
        let node = watchdog::during(Work::Join, || node.create::<ipc::Service>())
            .map_err(|error| PortError::Node(shared_memory::explained(error)))?;
        let prefix = config.global.prefix.to_string();
        shared_memory::close_to_others(&prefix).map_err(|error| PortError::Node(error.into()))?;
        Ok(Self { node, prefix })
    }

    /// Returns the node for ports outside of the wiring table.
    #[must_use]
    pub(super) fn node(&self) -> &Node<ipc::Service> {
        &self.node
    }

    /// Frees the resources of dead processes of the run, which must have been reaped.
    pub fn clean_up_after_the_dead(&self) {
        shared_memory::without_waiting_for_the_unfinished(&self.prefix, || {
            // A failure is retried after the next death; the end of the run frees all remaining resources.
            watchdog::during(Work::CleanUp, || self.node.try_cleanup_dead_nodes());
        });
        self.remove_unfinished();
    }

    /// Removes unfinished shared memory of dead processes of the run, for which other processes may wait.
    pub fn remove_unfinished(&self) {
        shared_memory::remove_unfinished(&self.prefix);
    }

    /// Creates the topic; the orchestrator does so before any service starts.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn create_topic(
        &self,
        topic: Topic,
        schedule: &Schedule,
        delivery: Delivery,
    ) -> Result<Box<dyn TopicPorts>, PortError> {
        self.enter(topic, None, schedule, Access::Create(delivery))
    }

    /// Creates a topic for the replay of a service, opened only by that service and the orchestrator.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn create_replayed_topic(
        &self,
        topic: Topic,
        replayed: ServiceId,
        schedule: &Schedule,
    ) -> Result<Box<dyn TopicPorts>, PortError> {
        // No sample is lost silently: a service that misses one reports it.
        let access = Access::Create(Delivery::NewestWins);
        self.enter(topic, Some(replayed), schedule, access)
    }

    /// Opens a topic that the orchestrator has created, if it has the layout of this build.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn open_topic(&self, topic: Topic, schedule: &Schedule) -> Result<Box<dyn TopicPorts>, PortError> {
        self.enter(topic, None, schedule, Access::Open)
    }

    /// Opens a topic of the replay of a service.
    pub(super) fn open_replayed_topic(
        &self,
        topic: Topic,
        replayed: ServiceId,
        schedule: &Schedule,
    ) -> Result<Box<dyn TopicPorts>, PortError> {
        self.enter(topic, Some(replayed), schedule, Access::Open)
    }

    fn enter(
        &self,
        topic: Topic,
        replayed: Option<ServiceId>,
        schedule: &Schedule,
        access: Access,
    ) -> Result<Box<dyn TopicPorts>, PortError> {
        let enter = Enter {
            node: &self.node,
            topic,
            replayed,
            consumer_buffer: consumer_buffer(schedule, topic),
            access,
        };
        watchdog::during(Work::Topics, || topic.dispatch(enter))
    }
}
