//! What the machine did, as samples of `host.mcap`.

use shared_types::ServiceId;
use shared_types::sample::Record;
use zerocopy::FromZeros;

/// A sample that goes to `host.mcap`.
pub trait HostSample: Record {
    /// Name of its channel.
    const CHANNEL: &'static str;

    /// Wall time since the start of the run, ns.
    fn time_ns(&self) -> u64;
}

shared_types::sample! {
    /// Something that happened to a run's processes.
    pub struct HostEvent {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        #[values(SERVICE_NONE = 255)]
        /// Position of the service in the wiring table.
        pub service: u32,
        #[values(
            KIND_NOTE = 0, KIND_SPAWNED = 1, KIND_READY = 2, KIND_EXITED = 3, KIND_KILLED = 4, KIND_FINISHED = 5,
            KIND_REBORN = 6, KIND_HUNG = 7
        )]
        /// What happened.
        pub kind: u32,
        /// Process id of the service, 0 if there is none.
        pub pid: u32,
        /// Length of `text`, bytes.
        pub text_length: u32,
        /// What happened, in words, UTF-8, filled up with zeros.
        pub text: [u8; 200],
    }

    /// How a service's process fares; all counts since its start.
    pub struct ServiceHealth {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        /// Position of the service in the wiring table.
        pub service: u32,
        /// Process id.
        pub pid: u32,
        /// Last base tick that the service has stepped.
        pub tick: u64,
        /// Steps.
        pub steps: u64,
        /// Waits that ended while yielding the core.
        pub waits_by_yield: u64,
        /// Waits that ended after sleeping.
        pub waits_by_blocking: u64,
        /// CPU time of the process, user and system, ns.
        pub cpu_time_ns: u64,
    }

    /// One step of a service in real time: what it consumed and when.
    pub struct ServiceStep {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        /// When it began, ns since the start of the flight: its time had come, and what it waited for was here or given up.
        pub began_ns: u64,
        /// When all that it had to publish was published, ns since the start of the flight; 0 if the process died before.
        pub published_ns: u64,
        /// Tick of the step.
        pub tick: u64,
        /// 1 + the tick of the step before it that the service remembers; 0 if there is none.
        pub previous: u64,
        /// Of each input, 1 + the sequence number of the sample that it saw; 0 if it saw none.
        pub consumed: [u64; 4],
        /// Position of the service in the wiring table.
        pub service: u32,
        /// Steps before it that were left out because their time had passed.
        pub missed: u32,
        /// Inputs of its own tick that had not come when it was given up waiting for them: bit i for input i.
        pub late_inputs: u32,
        /// Inputs of which it saw another sample than the step before: bit i for input i.
        pub fresh_inputs: u32,
        /// What the operator asked for: bit 0 armed, bit 1 land, bit 2 killed.
        pub operator: u32,
        /// Explicit padding.
        pub pad0: u32,
    }
}

const _: () = assert!(
    shared_types::schedule::MAX_PORTS == 4,
    "a step tells of each input"
);

impl HostEvent {
    /// An event of a service or, without one, of the run; a text too long for its place is cut.
    #[must_use]
    pub fn new(time_ns: u64, service: Option<ServiceId>, kind: u32, pid: u32, text: &str) -> Self {
        let mut event = Self {
            time_ns,
            service: service.map_or(Self::SERVICE_NONE, |service| service.index() as u32),
            kind,
            pid,
            ..Self::new_zeroed()
        };
        let length = text.floor_char_boundary(event.text.len());
        event.text[..length].copy_from_slice(&text.as_bytes()[..length]);
        event.text_length = length as u32;
        event
    }
}

impl HostSample for HostEvent {
    const CHANNEL: &'static str = "host/events";

    fn time_ns(&self) -> u64 {
        self.time_ns
    }
}

impl HostSample for ServiceStep {
    const CHANNEL: &'static str = "host/steps";

    fn time_ns(&self) -> u64 {
        self.time_ns
    }
}

impl HostSample for ServiceHealth {
    const CHANNEL: &'static str = "host/health";

    fn time_ns(&self) -> u64 {
        self.time_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_text_is_cut_only_where_a_character_ends(text in "\\PC{0,150}") {
            let event = HostEvent::new(0, None, HostEvent::KIND_NOTE, 0, &text);
            let kept = std::str::from_utf8(&event.text[..event.text_length as usize]).unwrap();
            prop_assert!(text.starts_with(kept));
            let next = text[kept.len()..].chars().next().map_or(0, char::len_utf8);
            prop_assert!(kept.len() == text.len() || kept.len() + next > event.text.len());
            prop_assert!(event.text[kept.len()..].iter().all(|&byte| byte == 0));
        }
    }
}
