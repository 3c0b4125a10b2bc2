//! A process's membership in a run, through which it comes to topics.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use iceoryx2::prelude::*;
use shared_types::{Schedule, ServiceId, Topic};

use super::topic::{Access, Enter};
use super::{Delivery, PortError, TopicPorts, consumer_buffer};
use crate::shared_memory;
use crate::watchdog::{self, Work};

/// The configuration file of the run that this process belongs to: iceoryx2 keeps one for the whole process.
static RUN: OnceLock<PathBuf> = OnceLock::new();

/// A process's membership in the run.
pub struct RunNode {
    node: Node<ipc::Service>,
    /// What the names of the run's shared memory begin with.
    prefix: String,
}

impl RunNode {
    /// Joins the run of the given iceoryx2 configuration file. Must be the process's first use of iceoryx2:
    /// cleaning up after the dead falls back to the global configuration, whatever a node was given.
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
        // The orchestrator alone cleans up after the dead, and knows when: nobody looks for them besides, which
        // takes longer than all else at every topic.
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

    /// For ports that carry no topic of the wiring table.
    #[must_use]
    pub fn node(&self) -> &Node<ipc::Service> {
        &self.node
    }

    /// Frees what processes that have died held of the run. They must have been waited for.
    pub fn clean_up_after_the_dead(&self) {
        shared_memory::without_waiting_for_the_unfinished(&self.prefix, || {
            // What cannot be freed now is tried again after the next death, and goes with the run at the latest.
            watchdog::during(Work::CleanUp, || self.node.try_cleanup_dead_nodes());
        });
        self.remove_unfinished();
    }

    /// Removes shared memory of the run that the dead had only begun to make, and for which others may be waiting.
    pub fn remove_unfinished(&self) {
        shared_memory::remove_unfinished(&self.prefix);
    }

    /// Makes the topic; the orchestrator does so before any service starts.
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

    /// Makes a topic of the replay of a service, which nobody has but that one and the orchestrator.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn create_replayed_topic(
        &self,
        topic: Topic,
        replayed: ServiceId,
        schedule: &Schedule,
    ) -> Result<Box<dyn TopicPorts>, PortError> {
        // A loss would be noticed, by whoever misses what was ordered.
        let access = Access::Create(Delivery::NewestWins);
        self.enter(topic, Some(replayed), schedule, access)
    }

    /// Opens a topic that the orchestrator has made, if its layout is the one of this build.
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
