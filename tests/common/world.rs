//! The simulated laboratory: `gerono world`, and the commands of a flight in it.

use std::path::Path;

use rustix::process::Signal;

use super::processes::signal;
use super::{Begun, Place, begin, finish, said, scenario, wait};

/// For how long the machine may stand still, s: half of what the oldest state may be before the vehicle is levelled.
pub(crate) const STANDSTILL: f64 = 0.1;

/// Scenario of the simulated laboratory.
const LABORATORY: &str = "laboratory_simulated";

/// A world that is ended with the test.
pub(crate) struct World(Option<Begun>);

impl World {
    pub(crate) fn begin(place: &Place, settings: &[String], more: &[&str]) -> Self {
        Self::begin_of(LABORATORY, place, settings, more)
    }

    /// Begins the world of a scenario.
    pub(crate) fn begin_of(name: &str, place: &Place, settings: &[String], more: &[&str]) -> Self {
        Self::begin_with(place, &arguments_of(name, "world", settings, more))
    }

    /// Begins a world with these arguments of `gerono`.
    pub(crate) fn begin_with(place: &Place, arguments: &[&str]) -> Self {
        Self(Some(begin(&mut place.gerono(arguments))))
    }

    /// Ends it as its user would.
    pub(crate) fn end(mut self) {
        let child = self.0.take().unwrap();
        signal(child.id(), Signal::INT);
        let ended = finish(child);
        assert!(ended.status.success(), "{}", said(&ended));
    }
}

impl Drop for World {
    fn drop(&mut self) {
        if let Some(mut child) = self.0.take() {
            signal(child.id(), Signal::INT);
            wait(&mut child);
        }
    }
}

/// `gerono COMMAND` of the simulated laboratory.
pub(crate) fn arguments<'a>(command: &'a str, settings: &'a [String], more: &[&'a str]) -> Vec<&'a str> {
    arguments_of(LABORATORY, command, settings, more)
}

/// `gerono COMMAND` of a scenario.
pub(crate) fn arguments_of<'a>(
    name: &str,
    command: &'a str,
    settings: &'a [String],
    more: &[&'a str],
) -> Vec<&'a str> {
    let file = Box::leak(
        scenario(name)
            .into_os_string()
            .into_string()
            .unwrap()
            .into_boxed_str(),
    );
    let mut arguments = vec![command, &*file];
    arguments.extend(settings.iter().flat_map(|setting| ["--set", setting.as_str()]));
    arguments.extend(more);
    arguments
}

/// All samples of a topic in a log.
pub(crate) fn samples<T: shared_types::Published>(log: &Path) -> Vec<T> {
    run_log::LogReader::open(log)
        .unwrap()
        .samples()
        .map(Result::unwrap)
        .collect()
}

/// Returns whether a world kept its time: one that stands still for longer than samples may be old is no laboratory.
pub(crate) fn kept_time(place: &Place, world: &str) -> bool {
    latest(place, world) < STANDSTILL
}

/// Returns the largest lateness of a world's steps, s.
pub(crate) fn latest(place: &Place, world: &str) -> f64 {
    place.summary(world)["late"][2].as_f64().unwrap()
}
