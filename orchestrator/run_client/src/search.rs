//! Search for the run that a command refers to.
//!
//! "None" and "several" are reported only after repeated scans: while services die and are restarted, a single scan of
//! the processes may miss some.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use runtime::control::Host;
use scenario_file::printable::printable;
use shared_types::FlightPhase;

use crate::LiveRun;
use crate::error::{LiveError, Names, Searched, looked_at};
use crate::retried;
use crate::run_root;
use crate::runs::{self, MachineRun, User};

/// Duration of the search for a missing run.
pub(crate) const PERSISTENCE: Duration = Duration::from_millis(500);

/// Pause between two scans.
pub(crate) const RETRY: Duration = Duration::from_millis(20);

/// Number of scans that have to find several runs before that is reported.
const LOOKS_AT_SEVERAL: u32 = 2;

/// Result of a scan.
#[derive(Debug)]
enum Found {
    One(MachineRun),
    Several(Vec<MachineRun>),
    /// Only runs that this user may not operate.
    Forbidden(Names),
    Nothing,
}

/// Finds the live run in real time of a name, or the only one, that this user may operate. `command` is used in error
/// messages.
///
/// # Errors
/// [`LiveError`].
pub fn find(name: Option<&str>, command: &'static str) -> Result<MachineRun, LiveError> {
    let found = looked_for(name, MachineRun::is_permitted, is_in_real_time)?;
    in_real_time(found, name, command)
}

/// As [`find`]; of several runs of one owner that match, the one that is not disarmed, if all others say that they are: in an emergency
/// there is no time to look up a name.
///
/// # Errors
/// [`LiveError`].
pub fn find_to_kill(name: Option<&str>) -> Result<MachineRun, LiveError> {
    let found = match looked_for(name, MachineRun::is_permitted, is_in_real_time)? {
        Found::Several(runs) if runs.iter().all(|run| run.owner == runs[0].owner) => only_armed(runs),
        found => found,
    };
    in_real_time(found, name, "kill")
}

/// Returns the only one of several runs that does not say that its vehicle is disarmed, or all of them.
fn only_armed(mut runs: Vec<MachineRun>) -> Found {
    let is_disarmed = |run: &MachineRun| {
        let phase = looked_at(run).and_then(|snapshot| snapshot.phase);
        phase.as_deref() == Some(FlightPhase::Disarmed.name())
    };
    let armed: Vec<_> = (0..runs.len())
        .filter(|place| !is_disarmed(&runs[*place]))
        .collect();
    match armed[..] {
        [place] => Found::One(runs.swap_remove(place)),
        _ => Found::Several(runs),
    }
}

/// Returns the one run in real time that was found.
fn in_real_time(found: Found, name: Option<&str>, command: &'static str) -> Result<MachineRun, LiveError> {
    single(found, command)?.map_or_else(
        || {
            let searched = searched(name)?;
            Err(match name {
                None => LiveError::None(searched),
                Some(name) => LiveError::Unknown(printable(name).into_owned(), searched),
            })
        },
        Ok,
    )
}

/// Finds the live run of a name, or the only one, in real or simulated time, that this user may watch.
///
/// # Errors
/// [`LiveError`].
pub fn find_to_watch(name: Option<&str>, command: &'static str) -> Result<MachineRun, LiveError> {
    let is_flown = |run: &MachineRun| matches!(run.host, Host::RealTime | Host::LockStep);
    let found = select(name, command, MachineRun::is_permitted, is_flown)?;
    found.map_or_else(
        || {
            let searched = searched(name)?;
            Err(match name {
                None => LiveError::NoneToWatch(searched),
                Some(name) => LiveError::UnknownToWatch(printable(name).into_owned(), searched),
            })
        },
        Ok,
    )
}

fn is_in_real_time(run: &MachineRun) -> bool {
    run.host == Host::RealTime
}

/// Returns the folder of the run that has lost its orchestrator: the one of this name, or the only one.
///
/// # Errors
/// [`LiveError`].
pub fn abandoned(name: Option<&str>) -> Result<PathBuf, LiveError> {
    // A take-over shares files with the services: it needs the same user and the same shared memory.
    let is_own = |run: &MachineRun| run.owner == User::this();
    let connected = |run: &MachineRun| LiveRun::connect(run, Duration::ZERO);
    let is_abandoned = |run: &MachineRun| {
        is_in_real_time(run) && (!is_own(run) || matches!(connected(run), Err(LiveError::Abandoned(_))))
    };
    let Some(run) = select(name, "attach", is_own, is_abandoned)? else {
        let searched = searched(name)?;
        return Err(match name {
            None => LiveError::NoneAbandoned(searched),
            Some(name) => LiveError::NotAbandoned(printable(name).into_owned(), searched),
        });
    };
    if !run.shares_memory_with_this() {
        let pid = run.pids().next().unwrap_or_default();
        return Err(LiveError::InAnotherContainer(run.name().to_owned(), pid));
    }
    Ok(run.folder)
}

/// Selects the live run of a name, or the only one, among the wanted and permitted ones; `None` if no wanted run
/// exists, permitted or not.
fn select(
    name: Option<&str>,
    command: &'static str,
    is_permitted: impl Fn(&MachineRun) -> bool,
    is_wanted: impl Fn(&MachineRun) -> bool,
) -> Result<Option<MachineRun>, LiveError> {
    single(looked_for(name, is_permitted, is_wanted)?, command)
}

/// Returns the one run that was found; `None` if there is none.
fn single(found: Found, command: &'static str) -> Result<Option<MachineRun>, LiveError> {
    Ok(match found {
        Found::One(run) => Some(run),
        Found::Several(runs) => return Err(LiveError::Several(Names::asked(&runs))),
        Found::Forbidden(names) => return Err(LiveError::NotPermitted(names, command)),
        Found::Nothing => None,
    })
}

/// Returns the live runs of a name, or all, that are wanted and permitted.
fn looked_for(
    name: Option<&str>,
    is_permitted: impl Fn(&MachineRun) -> bool,
    is_wanted: impl Fn(&MachineRun) -> bool,
) -> Result<Found, LiveError> {
    let is_meant = |run: &MachineRun| name.is_none_or(|name| run.is_called(name)) && is_wanted(run);
    let look = || {
        // A name is meant as it is said.
        let runs = match name {
            Some(_) => runs::everywhere(),
            None => runs::all(),
        };
        let meant = runs.map_err(LiveError::Processes)?.into_iter().filter(is_meant);
        let (mut permitted, others): (Vec<_>, Vec<_>) = meant.partition(|run| is_permitted(run));
        Ok(match (permitted.pop(), permitted.is_empty()) {
            (Some(run), true) => Found::One(run),
            (Some(run), false) => {
                permitted.push(run);
                Found::Several(permitted)
            }
            (None, _) if others.is_empty() => Found::Nothing,
            (None, _) => Found::Forbidden(Names::of(&others)),
        })
    };
    settled(look)
}

/// Scans until one run is found, several are found repeatedly, or the search times out.
fn settled(mut look: impl FnMut() -> Result<Found, LiveError>) -> Result<Found, LiveError> {
    let mut looks_at_several = 0;
    let look = || {
        let found = look()?;
        looks_at_several += u32::from(matches!(found, Found::Several(_)));
        let is_settled = match found {
            Found::One(_) => true,
            Found::Several(_) => looks_at_several >= LOOKS_AT_SEVERAL,
            Found::Forbidden(_) | Found::Nothing => false,
        };
        Ok((found, is_settled))
    };
    let is_unsettled = |looked: &Result<_, _>| matches!(looked, Ok((_, false)));
    let looked = retried(Instant::now() + PERSISTENCE, RETRY, look, is_unsettled);
    looked.map(|(found, _)| found)
}

/// Describes a search without result; an error if an invisible run holds a lock.
fn searched(name: Option<&str>) -> Result<Searched, LiveError> {
    let scope = runs::scope().filter(|_| name.is_none());
    let is_within = |place: &Path| scope.as_ref().is_none_or(|scope| place.starts_with(scope));
    let is_meant = |place: &Path| {
        let is_called = |name: &str| place.file_name().is_some_and(|found| found == name);
        is_within(place) && name.is_none_or(is_called)
    };
    // If the run folders cannot be read, this user has no run.
    let places = run_root::find().unwrap_or_default().live;
    let runs = runs::everywhere().unwrap_or_default();
    let hidden = runs.iter().filter(|run| !is_within(&run.folder)).count();
    let is_seen = |place: &PathBuf| runs.iter().any(|run| run.folder == *place);
    let open = places
        .into_iter()
        .filter(|place| is_meant(place) && !is_seen(place));
    let (unsettled, unseen): (Vec<_>, Vec<_>) =
        open.partition(|place| run_root::is_held_by_a_visible_process(place));
    if unseen.is_empty() {
        Ok(Searched::here(scope, hidden, unsettled))
    } else {
        Err(LiveError::Unseen(unseen))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn several() -> Found {
        Found::Several(Vec::new())
    }

    #[test]
    fn several_runs_that_a_second_look_does_not_find_are_one() {
        // One process of two died during the first look; this process stands for the run.
        let mut looks = 0;
        let found = settled(|| {
            looks += 1;
            Ok(if looks == 1 { several() } else { Found::Nothing })
        });
        assert!(matches!(found, Ok(Found::Nothing)) && looks > 2, "{looks}");
        let mut looks = 0;
        let found = settled(|| {
            looks += 1;
            Ok(several())
        });
        assert!(matches!(found, Ok(Found::Several(_))) && looks == 2, "{looks}");
    }

    #[test]
    fn none_is_said_only_after_looking_for_half_a_second() {
        let began = Instant::now();
        let mut looks = 0;
        let found = settled(|| {
            looks += 1;
            Ok(Found::Nothing)
        });
        assert!(matches!(found, Ok(Found::Nothing)) && looks > 2 && began.elapsed() >= PERSISTENCE);
    }
}
