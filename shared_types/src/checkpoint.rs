//! Checkpoint of a service: its state after a step, with the step from which on it counts.

/// Largest state of a service, bytes.
pub const CAPACITY: usize = 40 * 1024;

/// State of a service after its last steps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// Tick of the first step that the state does not include.
    pub next_tick: u64,
    /// The state.
    pub state: Vec<u8>,
}
