//! Run state and CPU time of a process.

/// Run state and CPU time of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Activity {
    /// `true` if it runs or waits for a processor or a page of memory; `false` if it waits for an event or is stopped.
    pub is_runnable: bool,
    /// `true` if it runs or waits for a processor.
    pub is_ready: bool,
    /// CPU time, ns.
    pub cpu_time_ns: u64,
    /// Time that it was ready and waited for a processor, ns, up to its last dispatch.
    pub run_delay_ns: u64,
}
