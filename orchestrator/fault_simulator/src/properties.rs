//! What must hold in every history.

use std::fmt;
use std::time::Duration;

use decisions::restart_policy::{
    AFTER_CLOSING, BEAT_LIMIT, BEAT_PERIOD, END_LIMIT, FRESH_LIMIT, PREPARATION_LIMIT, READY_LIMIT,
    STOP_LIMIT, STUCK_LIMIT,
};

use crate::history::{Fault, FaultKind, History, Host, MS, Setting};
use crate::machine::latency;

/// Property of the decisions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Property {
    /// After a single fault on an idle machine no service is absent for longer than [`absence_limit`].
    ServiceReturnsInTime,
    /// After any faults, once they have ceased, every service flies again within [`settling_limit`], or the flight has
    /// failed because of a process that does not end.
    FaultsAreOvercome,
    /// Once all faults have ceased, there is a prepared standby process again within [`standby_limit`].
    StandbyReturns,
    /// The set-up ends: the flight begins, or it has failed.
    SetUpEnds,
    /// A flight whose end was requested, or whose last tick has passed, ends.
    FlightEnds,
    /// After `stop` everything has stopped within [`STOPPED_LIMIT`].
    EverythingStops,
    /// No action concerns a process that has ended, as far as an event has told it.
    NoActionOnEnded,
    /// No process is started for a service before the previous one has ended.
    SuccessorWaitsForEnd,
    /// There is at most one standby process that was not killed.
    AtMostOneStandby,
    /// No process is left behind after the end.
    NothingIsLeftBehind,
    /// A service without progress is restarted as often as its policy says, and after a failure of the flight once per
    /// longest pause.
    RestartsAreBounded,
    /// A process to which nothing was done but that it got no processor is not killed before its limits.
    PunctualIsNotKilled,
    /// A failure is true: its service was given up as its policy says, or has said it.
    VerdictIsTrue,
    /// Every end of a process is recorded once, with its service and its PID.
    ExitIsRecordedOnce,
    /// What the vehicle did it may do.
    VehicleIsSafe,
    /// The same seed leads to the same actions.
    IsDeterministic,
}

impl Property {
    /// All properties.
    pub const ALL: [Self; 16] = [
        Self::ServiceReturnsInTime,
        Self::FaultsAreOvercome,
        Self::StandbyReturns,
        Self::SetUpEnds,
        Self::FlightEnds,
        Self::EverythingStops,
        Self::NoActionOnEnded,
        Self::SuccessorWaitsForEnd,
        Self::AtMostOneStandby,
        Self::NothingIsLeftBehind,
        Self::RestartsAreBounded,
        Self::PunctualIsNotKilled,
        Self::VerdictIsTrue,
        Self::ExitIsRecordedOnce,
        Self::VehicleIsSafe,
        Self::IsDeterministic,
    ];
}

/// Violation of a property.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    pub property: Property,
    /// Time since the start of the first process, ns.
    pub at_ns: u64,
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let at = self.at_ns as f64 / 1e6;
        write!(formatter, "{:?} at {at:.3} ms: {}", self.property, self.what)
    }
}

pub(crate) fn ns(duration: Duration) -> u64 {
    duration.as_nanos() as u64
}

/// Period of the supervisor's loop, ns.
pub(crate) const LOOP_PERIOD: u64 = 10 * MS;

/// Period of the loop while a service restarts, ns.
pub(crate) const CARE_PERIOD: u64 = 100_000;

/// Time after which the loop is slower although a service restarts, ns: only the simulation's, to be quick.
pub(crate) const CARE_IS_QUICK_FOR: u64 = 30 * MS;

/// Period of the loop after that, ns.
pub(crate) const LONG_CARE_PERIOD: u64 = MS;

/// `[real_time] hang_limit` of the settings, ns: that of the program.
pub(crate) const HANG_LIMIT: u64 = 100 * MS;

/// Restart of a service when nothing else is wrong, ns: the loop notices the death (0.1 ms); a standby process that has
/// just been started loads (50 ms) or a new one is started (3 ms) and loads (40 ms), and creates its ports (8 ms); some
/// turns of the loop.
const RESTART: u64 = *latency::FORK.end() + *latency::LOAD_STANDBY.end() + *latency::PORTS.end() + 2 * MS;

/// Restart of a program in place of a service, ns: its start and its first step, and turns of the loop, which are rarer when
/// it takes long.
const RESTART_OF_PROGRAM: u64 = *latency::FORK.end()
    + *latency::LOAD_PROGRAM.end()
    + *latency::PORTS.end()
    + *latency::FIRST_STEP.end()
    + 4 * LONG_CARE_PERIOD;

/// Returns the maximum time for which a service may be absent after the only fault of a history, ns.
#[must_use]
pub fn absence_limit(fault: &Fault, setting: Setting, service: usize, longest_period: u64) -> u64 {
    let is_external = setting.external == Some(service as u8);
    let restart = match is_external {
        true => RESTART_OF_PROGRAM,
        false => RESTART,
    };
    // A hang is found in a turn of the loop after its limit, which begins with the turn that has found the last step; and
    // counts whole ticks. What spins is granted a tick of each turn, because its processor time is counted in whole ticks.
    // The first step of a program has the limit of its start.
    let limit = match is_external {
        true => ns(FRESH_LIMIT),
        false => HANG_LIMIT,
    };
    let hang = limit.max(longest_period) + HANG_LIMIT / 8 + 3 * LOOP_PERIOD;
    // A process that has reported a failure ends by itself, is given up, and retried after the pause.
    let given_up = *latency::END.end() + *latency::CLOSE.end() + 100 * MS + *latency::KILL.end();
    // The fault may strike in the first step of a program, in which it was absent before.
    let first_step = match is_external {
        true => *latency::FIRST_STEP.end(),
        false => 0,
    };
    let lasts = fault.for_ns;
    let found = match fault.kind {
        FaultKind::Stopped | FaultKind::Spins => hang.min(lasts) + *latency::KILL.end(),
        FaultKind::Starves | FaultKind::MachineStalls => lasts,
        FaultKind::OrchestratorDies => lasts + 20 * MS,
        FaultKind::ClosesChannel => ns(AFTER_CLOSING) + LOOP_PERIOD + *latency::KILL.end(),
        FaultKind::Fails | FaultKind::Refuses | FaultKind::SendsGarbage => given_up,
        FaultKind::NonFinite => *latency::END.end() + *latency::CLOSE.end(),
        _ => LOOP_PERIOD + *latency::KILL.end(),
    };
    first_step + found + restart + longest_period + MS
}

/// Returns the maximum time from the end of the last fault until all services fly again, ns.
#[must_use]
pub fn settling_limit(history: &History) -> u64 {
    let base = match (history.faults.len(), history.setting.host) {
        // A stopped process may have got the role: the limit of any start; and of its end, before the flight fails.
        (0..=2, Host::RealTime) => ns(FRESH_LIMIT) + ns(STUCK_LIMIT) + 1_000 * MS,
        // The limits of a start double up to eightfold.
        (_, Host::RealTime) => 8 * ns(FRESH_LIMIT) + ns(STUCK_LIMIT) + 4_000 * MS,
        // A start has 30 s, as nothing is in the air; and what does not end when it is killed has them again.
        (_, Host::LockStep) => 2 * ns(READY_LIMIT) + 5_000 * MS,
    };
    let of_program = match history.setting.external {
        // Up to 5 s, and again for the first step; doubled.
        Some(_) if history.faults.len() > 2 => 2 * 8 * 5_000 * MS,
        Some(_) => 2 * 2 * 5_000 * MS,
        None => 0,
    };
    base + of_program
}

/// Returns the maximum time from the end of the last fault until a standby process is prepared, ns: one that is stopped is
/// asked for a sign of life, or has its time to become prepared; its successor waits for its pause.
#[must_use]
pub fn standby_limit(history: &History) -> u64 {
    settling_limit(history)
        + ns(PREPARATION_LIMIT.max(BEAT_PERIOD + BEAT_LIMIT))
        + ns(END_LIMIT)
        + ns(decisions::restart_policy::PREPARATION_LIMIT)
}

/// Maximum time from `stop` until everything has stopped, ns: what does not end is killed, and what is killed and does not
/// end is given up; some turns of the loop.
pub const STOPPED_LIMIT: u64 = STOP_LIMIT.as_nanos() as u64 + END_LIMIT.as_nanos() as u64 + 5 * LOOP_PERIOD;

/// Maximum time from the landing until the end of the flight, ns: 2 s in which the motors are seen to rest, some turns of
/// the loop, none of which may be long.
pub(crate) const LANDED_LIMIT: u64 = 2_000 * MS + 500 * MS;

/// Returns whether a history is one on which the limits of absence hold: one fault, in a flight in real time, by a loop that
/// is punctual.
pub(crate) fn is_tight(history: &History) -> bool {
    history.faults.len() == 1 && history.setting.host == Host::RealTime && history.setting.loop_delay_ns < MS
}
