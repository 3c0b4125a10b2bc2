//! The meanings of `gerono`'s exit codes.

use std::process::ExitCode;

/// Result of a command as an exit code reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The command completed.
    Success,
    /// A failure outside of the flight: the machine, a missing file, or a file that is not a log.
    Trouble,
    BadInput,
    /// A service died, gave up or computed a number that is not finite, or the processes' bytes differ from those of
    /// one process.
    FlightFailed,
    NotWritten,
    /// A figure of the paper is no longer reproduced within its limits.
    Regressed,
    Unfit,
    /// A live run refused the command.
    Refused,
    /// The samples of a replay differ from the log or could not all be compared, or two logs differ.
    Diverged,
    /// The flight was flown to its end, and the vehicle was lost or the flight killed.
    Lost,
    /// A log is incomplete or damaged: results cover the readable part, or there are none.
    Incomplete,
    /// A signal ended the run cleanly.
    Signal(i32),
}

impl Exit {
    /// Returns whether the exit code of another process reports a flight that reached its planned end, lost or not.
    #[must_use]
    pub fn is_flown(code: Option<i32>) -> bool {
        matches!(code, Some(0 | 9))
    }

    /// Exit codes with their meanings, for the help and the manual.
    pub const MEANINGS: [(&str, &str); 12] = [
        (
            "0",
            "done; a flight in which nothing took off says so in its summary",
        ),
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
        (
            "6",
            "`gerono doctor`: the machine is not fit for the flight; `gerono lab check`: axes or signs are wrong",
        ),
        (
            "7",
            "`gerono arm`, `disarm`, `kill`, `stop`, `set`, `get`: the live run refused",
        ),
        (
            "8",
            "`gerono replay`: a step differs from the log or could not be compared; `gerono diff`: the logs differ",
        ),
        (
            "9",
            "the vehicle was lost: too far from its path, tipped over, on the ground, stopped in the air, or not seen for 2 s; or a kill ended the flight before it had landed; the run lasted to its end",
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

    /// Returns the exit codes as `gerono help` shows them.
    #[must_use]
    pub fn help() -> String {
        let codes = Self::MEANINGS.map(|(code, meaning)| format!("  {code}: {meaning}"));
        format!("Exit codes:\n{}", codes.join("\n"))
    }
}

impl Exit {
    /// Returns the exit of a command that has read logs: [`Self::Incomplete`] if its results cover only a part of them.
    #[must_use]
    pub fn of_logs(are_complete: bool) -> Self {
        if are_complete {
            Self::Success
        } else {
            Self::Incomplete
        }
    }

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
            // The convention of shells.
            Self::Signal(number) => u8::try_from(128 + number).unwrap_or(u8::MAX),
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}
