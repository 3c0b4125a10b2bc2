//! The meanings of `gerono`'s exit codes.

use std::process::ExitCode;

/// The end of a command, as other programs see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// It did what it was asked to.
    Success,
    /// It could not, for a reason that has nothing to do with the flight.
    Trouble,
    /// The command line or the scenario is wrong; nothing was started.
    BadInput,
    /// The flight failed: a service died, gave up or computed nonsense, or processes flew other bytes than one process.
    FlightFailed,
    /// The results could not be written.
    NotWritten,
    /// A figure of the paper is no longer reproduced as it was.
    Regressed,
    /// The machine is not fit for the flight.
    Unfit,
    /// A live run refused what it was asked for.
    Refused,
    /// A replay's samples differ from the log, or not all could be compared; or two logs differ.
    Diverged,
    /// The flight was flown to its end, and the vehicle was lost.
    Lost,
    /// A log is incomplete or damaged: the result is of the part that could be read, or there is none.
    Incomplete,
    /// A signal ended the run in good order.
    Signal(i32),
}

impl Exit {
    /// Whether a flight of another process has come to its planned end, as its exit code tells, with the vehicle or without.
    #[must_use]
    pub fn is_flown(code: Option<i32>) -> bool {
        matches!(code, Some(0 | 9))
    }

    /// Each code with its meaning, for help and manual.
    pub const MEANINGS: [(&str, &str); 12] = [
        ("0", "done"),
        (
            "1",
            "trouble with the machine, or a file that is missing or no log",
        ),
        ("2", "wrong command line or scenario; nothing was started"),
        (
            "3",
            "the flight failed: a service died, gave up, or computed a number that is not finite; `gerono faults --processes`: processes flew other bytes",
        ),
        ("4", "the results could not be written"),
        ("5", "`gerono reproduce`: a number of a figure regressed"),
        ("6", "`gerono doctor`: the machine is not fit for the flight"),
        (
            "7",
            "`gerono arm`, `disarm`, `kill`, `stop`: the live run refused",
        ),
        (
            "8",
            "`gerono replay`: a step differs from the log or could not be compared; `gerono diff`: the logs differ",
        ),
        (
            "9",
            "the vehicle was lost: too far from its path, tipped over, or on the ground; the flight was flown to its end",
        ),
        (
            "10",
            "a log is incomplete or damaged: the result is of the part that could be read, or there is none (`gerono recover`)",
        ),
        (
            "129, 130, 143",
            "ended by the end of the terminal, Ctrl-C or SIGTERM; the log is complete up to there",
        ),
    ];

    /// Exit codes as `gerono help` shows them.
    #[must_use]
    pub fn help() -> String {
        let codes = Self::MEANINGS.map(|(code, meaning)| format!("  {code}: {meaning}"));
        format!("Exit codes:\n{}", codes.join("\n"))
    }
}

impl Exit {
    /// Returns the end of a command that read logs, and did with them what it was asked to as far as they go.
    #[must_use]
    pub fn of_logs(are_complete: bool) -> Self {
        if are_complete {
            Self::Success
        } else {
            Self::Incomplete
        }
    }

    /// Returns the code that the system is told.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Success => 0,
            Self::Trouble => 1,
            Self::BadInput => 2,
            Self::FlightFailed => 3,
            Self::NotWritten => 4,
            Self::Regressed => 5,
            Self::Unfit => 6,
            Self::Refused => 7,
            Self::Diverged => 8,
            Self::Lost => 9,
            Self::Incomplete => 10,
            // As shells report it.
            Self::Signal(number) => u8::try_from(128 + number).unwrap_or(u8::MAX),
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}
