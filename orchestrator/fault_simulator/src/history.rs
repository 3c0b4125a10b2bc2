//! A history: the setting of a flight, and the faults in it. It determines everything that happens.

use std::fmt;

use crate::random::Draws;

/// Nanoseconds of a millisecond.
pub(crate) const MS: u64 = 1_000_000;

/// Duration of a fault that does not end by itself.
pub const FOR_EVER: u64 = u64::MAX;

/// Host of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Host {
    RealTime,
    LockStep,
}

/// Setting of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    pub host: Host,
    /// Length of the flight, ms.
    pub length_ms: u64,
    /// `true` if the vehicle takes off and can land.
    pub has_phases: bool,
    /// `true` if services step every 10 or 22 ms, and not every millisecond.
    pub is_slow: bool,
    /// Index of the service that a program replaces.
    pub external: Option<u8>,
    /// Maximum number of consecutive restarts without progress.
    pub restarts: u32,
    /// Maximum delay of the supervisor's loop, beside that of its period, ns.
    pub loop_delay_ns: u64,
}

/// What a fault is done to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The newest process of a service, by its index.
    Service(u8),
    /// The standby process.
    Standby,
    /// The machine, the supervisor or its operator.
    Machine,
}

/// Kind of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FaultKind {
    /// The process dies.
    Death,
    /// The process reports a panic and dies.
    Panic,
    /// The process is stopped by a signal, or waits for what does not come.
    Stopped,
    /// The process computes without end.
    Spins,
    /// The process gets no processor.
    Starves,
    /// The process closes its control channel and lives on.
    ClosesChannel,
    /// The process reads no messages, so that its control channel is full.
    ReadsNothing,
    /// The process says something when it is not its turn.
    SpeaksOutOfTurn,
    /// The process says that it has finished, and has not.
    SaysFinished,
    /// The process sends what cannot be read.
    SendsGarbage,
    /// The process computes a number that is not finite.
    NonFinite,
    /// The process reports that it cannot continue.
    Fails,
    /// The process reports that its service cannot be built.
    Refuses,
    /// The step counter of the service goes back, until its next step.
    CounterGoesBack,
    /// Processes that are killed do not end: they wait for a disk.
    KillsTakeLong,
    /// The system starts no processes.
    NoForks,
    /// The system starts processes slowly.
    SlowForks,
    /// The supervisor gets no processor.
    SupervisorStalls,
    /// Nothing on the machine gets a processor.
    MachineStalls,
    /// The log cannot be written.
    DiskFull,
    /// The operator asks for the end.
    RequestsEnd,
    /// The operator arms the vehicle.
    Arms,
    /// The kill switch is lost.
    SwitchLost,
    /// The kill switch is back.
    SwitchFound,
    /// The orchestrator dies, and another takes over.
    OrchestratorDies,
}

impl FaultKind {
    /// Kinds done to processes.
    pub const OF_PROCESSES: [Self; 14] = [
        Self::Death,
        Self::Panic,
        Self::Stopped,
        Self::Spins,
        Self::Starves,
        Self::ClosesChannel,
        Self::ReadsNothing,
        Self::SpeaksOutOfTurn,
        Self::SaysFinished,
        Self::SendsGarbage,
        Self::NonFinite,
        Self::Fails,
        Self::Refuses,
        Self::CounterGoesBack,
    ];

    /// Kinds done to the machine, the supervisor or its operator.
    pub const OF_MACHINE: [Self; 11] = [
        Self::KillsTakeLong,
        Self::NoForks,
        Self::SlowForks,
        Self::SupervisorStalls,
        Self::MachineStalls,
        Self::DiskFull,
        Self::RequestsEnd,
        Self::Arms,
        Self::SwitchLost,
        Self::SwitchFound,
        Self::OrchestratorDies,
    ];

    /// All kinds.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::OF_PROCESSES.into_iter().chain(Self::OF_MACHINE)
    }
}

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Time since the start of the first process, ns.
    pub at_ns: u64,
    pub kind: FaultKind,
    pub target: Target,
    /// Duration, ns, where it has one.
    pub for_ns: u64,
}

/// A history.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct History {
    /// Seed of the latencies.
    pub seed: u64,
    pub setting: Setting,
    /// Faults, in the order of time.
    pub faults: Vec<Fault>,
}

/// Time within which faults begin, ns: the flight begins about 0.15 s after the first process.
const FAULTS_WITHIN: u64 = 1_200 * MS;

impl History {
    /// Draws the history of a seed: a fifth of them have one fault, a fifth have two.
    #[must_use]
    pub fn of_seed(seed: u64) -> Self {
        let mut draws = Draws::new(seed);
        let count = match draws.below(5) {
            0 => 1,
            1 => 2,
            _ => 3 + draws.below(14),
        };
        let setting = Setting::draw(&mut draws, count);
        let mut faults = Vec::new();
        // Half of the faults follow soon after another: while the supervisor deals with that.
        let mut previous = 0;
        for _ in 0..count {
            let at_ns = if previous > 0 && draws.once_in(2) {
                previous + draws.of_any_size(50_000, 200 * MS)
            } else {
                draws.below(FAULTS_WITHIN)
            };
            previous = at_ns;
            faults.push(Fault::draw(&mut draws, setting, at_ns));
        }
        faults.sort_by_key(|fault| fault.at_ns);
        Self {
            seed,
            setting,
            faults,
        }
    }

    /// Returns the history as the literal of a test.
    #[must_use]
    pub fn as_rust(&self) -> String {
        let Setting {
            host,
            length_ms,
            has_phases,
            is_slow,
            external,
            restarts,
            loop_delay_ns,
        } = self.setting;
        let mut text = format!(
            "History {{\n    seed: {},\n    setting: Setting {{ host: Host::{host:?}, length_ms: {length_ms}, has_phases: \
             {has_phases}, is_slow: {is_slow}, external: {external:?}, restarts: {restarts}, loop_delay_ns: \
             {loop_delay_ns} }},\n    faults: vec![\n",
            self.seed
        );
        for Fault {
            at_ns,
            kind,
            target,
            for_ns,
        } in &self.faults
        {
            let for_ns = match *for_ns {
                FOR_EVER => "FOR_EVER".to_owned(),
                for_ns => for_ns.to_string(),
            };
            text += &format!(
                "        Fault {{ at_ns: {at_ns}, kind: FaultKind::{kind:?}, target: Target::{target:?}, for_ns: {for_ns} \
                 }},\n"
            );
        }
        text + "    ],\n}"
    }
}

impl fmt::Display for History {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(formatter, "seed {}, {:?}", self.seed, self.setting)?;
        for fault in &self.faults {
            let at = fault.at_ns as f64 / 1e6;
            write!(
                formatter,
                "  {at:10.3} ms  {:?} of {:?}",
                fault.kind, fault.target
            )?;
            match fault.for_ns {
                0 => writeln!(formatter)?,
                FOR_EVER => writeln!(formatter, ", for ever")?,
                for_ns => writeln!(formatter, ", for {:.3} ms", for_ns as f64 / 1e6)?,
            }
        }
        Ok(())
    }
}

impl Setting {
    fn draw(draws: &mut Draws, faults: u64) -> Self {
        let host = match draws.once_in(4) {
            true => Host::LockStep,
            false => Host::RealTime,
        };
        let is_tight = faults == 1;
        Self {
            host,
            length_ms: match draws.once_in(4) && !is_tight {
                true => 400 + draws.below(1_200),
                false => 600_000,
            },
            has_phases: draws.once_in(2),
            is_slow: draws.once_in(3),
            external: draws.once_in(4).then(|| draws.below(5) as u8),
            restarts: match draws.below(6) {
                0 if !is_tight => 0,
                1 if !is_tight => 1 + draws.below(3) as u32,
                _ => 8,
            },
            loop_delay_ns: match draws.once_in(3) && !is_tight {
                true => 8 * MS,
                false => 50_000,
            },
        }
    }
}

impl Fault {
    fn draw(draws: &mut Draws, setting: Setting, at_ns: u64) -> Self {
        use FaultKind as Kind;
        let is_of_process = draws.below(4) < 3;
        let kind = match is_of_process {
            // Half of these faults are the frequent ones.
            true if draws.once_in(2) => Kind::OF_PROCESSES[draws.below(4) as usize],
            true => Kind::OF_PROCESSES[draws.below(Kind::OF_PROCESSES.len() as u64) as usize],
            false => Kind::OF_MACHINE[draws.below(Kind::OF_MACHINE.len() as u64) as usize],
        };
        // An orchestrator that takes over does not find programs: they end with the orchestrator. Lock step ends with it.
        let kind = match kind {
            Kind::OrchestratorDies if setting.host == Host::LockStep => Kind::Death,
            Kind::RequestsEnd | Kind::DiskFull if draws.below(3) > 0 => Kind::MachineStalls,
            kind => kind,
        };
        let target = match Kind::OF_PROCESSES.contains(&kind) {
            false => Target::Machine,
            true if draws.once_in(6) => Target::Standby,
            true => Target::Service(draws.below(5) as u8),
        };
        // In simulated time a stopped service is waited for without a limit.
        let is_waited_for = setting.host == Host::LockStep && target != Target::Standby;
        let for_ns = match kind {
            Kind::Stopped | Kind::Spins if draws.once_in(2) && !is_waited_for => FOR_EVER,
            Kind::ClosesChannel if draws.once_in(2) => FOR_EVER,
            Kind::KillsTakeLong if draws.once_in(8) => FOR_EVER,
            Kind::Stopped | Kind::Spins | Kind::Starves => draws.of_any_size(MS, 2_000 * MS),
            Kind::ClosesChannel | Kind::ReadsNothing => draws.of_any_size(MS, 1_000 * MS),
            Kind::KillsTakeLong => draws.of_any_size(MS, 3_000 * MS),
            Kind::NoForks | Kind::SlowForks => draws.of_any_size(10 * MS, 1_500 * MS),
            Kind::SupervisorStalls | Kind::MachineStalls => draws.of_any_size(MS, 1_500 * MS),
            Kind::OrchestratorDies => draws.of_any_size(500 * MS, 1_500 * MS),
            _ => 0,
        };
        Self {
            at_ns,
            kind,
            target,
            for_ns,
        }
    }

    /// Returns the time at which its effect ends, ns; its begin if it never does.
    pub(crate) fn ends_at(&self) -> u64 {
        match self.for_ns {
            FOR_EVER => self.at_ns,
            for_ns => self.at_ns + for_ns,
        }
    }
}
