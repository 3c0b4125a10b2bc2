//! Discovery of this machine's live runs by their processes.
//!
//! Every service's process has the run's folder in its command line, which every user may read, and the orchestrator
//! has it in an open file ([`OrchestratorLabel`]). So a run is found while its orchestrator or one of its services
//! lives, whatever user and environment it was started from; there is no registry that could be outdated, hidden by
//! another environment, or forged by another user. A label can claim anything, but the kernel reports the owner of the
//! process: an entry is trusted for the name of a run and its owner only.

use std::fmt;
use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::Duration;

use runtime::activity::Pause;
use runtime::control::Host;
use runtime::shared_memory;
use runtime::shared_page::Request;
use rustix::fs::{Mode, OFlags, Stat, fstat, stat};

use crate::run_process::{self, LabelledProcess, RunProcess};
pub use crate::run_process::{OrchestratorLabel, label};

/// Environment variable that restricts commands that name no run to those in a folder, for tests and scripts next to other flights.
pub const SCOPE: &str = "GERONO_RUNS";

/// Environment variable in which `sudo` passes the calling user.
const SUDO_USER: &str = "SUDO_UID";

/// Timeout for the end of a killed process, which may wait for the system, such as for a slow disk.
const END_LIMIT: Duration = Duration::from_secs(1);

#[derive(Debug)]
pub struct MachineRun {
    /// Folder of the run, as its processes see it.
    pub folder: PathBuf,
    /// User of the processes.
    pub owner: User,
    pub host: Host,
    /// Login user of the session that started it, if the system records it.
    login: Option<User>,
    /// Device and inode of the folder; `None` if unknown.
    place: Option<(u64, u64)>,
    /// At least one.
    processes: Vec<RunProcess>,
}

/// User ID.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct User(u32);

impl User {
    /// Returns the effective user of this process.
    #[must_use]
    pub fn this() -> Self {
        Self(rustix::process::geteuid().as_raw())
    }

    /// Returns the user who typed the command: the login user, if the system or `sudo` records it.
    #[must_use]
    pub fn at_the_keyboard() -> Self {
        let before_sudo = || {
            let number = std::env::var(SUDO_USER).ok()?.parse().ok()?;
            Self::this().is_root().then_some(Self(number))
        };
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let this_process = rustix::fs::open("/proc/self", flags, Mode::empty());
        let login = this_process.ok().and_then(|proc| run_process::login_of(&proc));
        login.or_else(before_sudo).unwrap_or_else(Self::this)
    }

    #[must_use]
    pub fn is_root(self) -> bool {
        self.0 == 0
    }

    #[must_use]
    pub fn of(number: u32) -> Self {
        Self(number)
    }

    #[must_use]
    pub fn number(self) -> u32 {
        self.0
    }
}

/// Formatted for `sudo -u`: the name, or `#` and the number if there is none.
impl fmt::Display for User {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let users = fs::read_to_string("/etc/passwd").unwrap_or_default();
        let named = users.lines().find_map(|line| {
            let mut fields = line.split(':');
            let name = fields.next()?;
            (fields.nth(1)?.parse() == Ok(self.0)).then_some(name)
        });
        match named {
            Some(name) => formatter.write_str(name),
            None => write!(formatter, "#{}", self.0),
        }
    }
}

/// Returns all live runs that this user can see, restricted to the folder in [`SCOPE`] if it is set; sorted by owner
/// and folder.
///
/// # Errors
/// If /proc cannot be read.
pub fn all() -> io::Result<Vec<MachineRun>> {
    let mut runs = everywhere()?;
    if let Some(scope) = scope() {
        runs.retain(|run| run.folder.starts_with(&scope));
    }
    Ok(runs)
}

/// As [`all`], whatever [`SCOPE`] says.
///
/// # Errors
/// If /proc cannot be read.
pub fn everywhere() -> io::Result<Vec<MachineRun>> {
    let processes = fs::read_dir("/proc")?.flatten().filter_map(|entry| {
        let pid = entry.file_name().to_str()?.parse().ok()?;
        // Other processes, and those that have exited meanwhile, belong to no run.
        LabelledProcess::of(pid)
    });
    let processes: Vec<_> = processes.collect();
    let keys: Vec<_> = processes.iter().map(Key::of).collect();
    let groups = group(&keys);
    let mut runs = Vec::<MachineRun>::new();
    // Processes with a known folder come first: they create the groups.
    let mut places = vec![None; processes.len()];
    let mut order: Vec<_> = processes.into_iter().zip(groups).collect();
    order.sort_by_key(|(found, _)| found.place.is_none());
    for (found, group) in order {
        match places[group] {
            Some(place) => {
                let run: &mut MachineRun = &mut runs[place];
                run.processes.push(found.process);
            }
            None => {
                places[group] = Some(runs.len());
                runs.push(MachineRun {
                    folder: found.folder,
                    owner: found.owner,
                    host: found.host,
                    login: found.login,
                    place: found.place,
                    processes: vec![found.process],
                });
            }
        }
    }
    runs.sort_by(|one, other| (one.owner, &one.folder).cmp(&(other.owner, &other.folder)));
    Ok(runs)
}

/// Identity of a run.
#[derive(Debug, PartialEq, Eq)]
struct Key<'a> {
    owner: User,
    folder: &'a Path,
    /// Device and inode of the folder; `None` if unknown.
    place: Option<(u64, u64)>,
}

impl<'a> Key<'a> {
    fn of(found: &'a LabelledProcess) -> Self {
        Self {
            owner: found.owner,
            folder: &found.folder,
            place: found.place,
        }
    }
}

/// Returns for each process the index of the first process of its run. A process with an unknown folder inode belongs
/// to a run with the same owner and path whose inode is known, if there is one.
fn group(keys: &[Key<'_>]) -> Vec<usize> {
    let is_of_one_folder =
        |one: &Key<'_>, other: &Key<'_>| (one.owner, one.folder) == (other.owner, other.folder);
    let first_like = |key: &Key<'_>| {
        let known = keys.iter().position(|other| {
            let is_compatible = match key.place {
                Some(_) => other.place == key.place,
                None => other.place.is_some(),
            };
            is_of_one_folder(key, other) && is_compatible
        });
        let unknown = || keys.iter().position(|other| is_of_one_folder(key, other));
        known.or_else(unknown).expect("each process is like itself")
    };
    keys.iter().map(first_like).collect()
}

/// Returns the folder in [`SCOPE`].
#[must_use]
pub fn scope() -> Option<PathBuf> {
    let scope = std::env::var_os(SCOPE).filter(|scope| !scope.is_empty());
    scope.map(PathBuf::from)
}

/// Returns whether the system hides other users' processes (`hidepid`), so that their runs are not found.
#[must_use]
pub fn are_hidden() -> bool {
    fs::read("/proc/1/cmdline").is_err()
}

/// Returns whether a process visible to this user has a file open.
#[must_use]
pub(crate) fn is_open_somewhere(file: &Stat) -> bool {
    run_process::is_open_in_a_visible_process(file)
}

/// Returns whether a process of the run with this owner and folder lives.
pub(crate) fn has_processes(owner: User, folder: &Path) -> bool {
    let is_it = |run: &MachineRun| run.owner == owner && run.folder == folder;
    everywhere().is_ok_and(|runs| runs.iter().any(is_it))
}

/// Kills the services of this user's run with this folder, and its standby process, except the PIDs in `kept`, and
/// waits for their ends: their ports are then free for other processes. Returns the PIDs that have ended.
///
/// # Errors
/// If /proc cannot be read.
pub fn end_services_except(folder: &Path, kept: &[u32]) -> io::Result<Vec<u32>> {
    let mut runs = everywhere()?;
    runs.retain(|run| run.owner == User::this() && run.folder == folder && run.shares_memory_with_this());
    let mut services: Vec<_> = runs.into_iter().flat_map(|run| run.processes).collect();
    services.retain(|process| !process.is_orchestrator && !kept.contains(&process.pid));
    Ok(ended(&services))
}

/// Kills the processes of this user's dead runs and waits for their ends. Returns the PIDs that have ended.
///
/// A run is dead if it has no orchestrator and all its processes are stopped by signals: nothing steps, and no
/// orchestrator can take over. Processes that are not stopped end by themselves once the vehicle has landed.
///
/// # Errors
/// If /proc cannot be read.
pub fn end_dead() -> io::Result<Vec<u32>> {
    let is_stopped = |process: &RunProcess| Pause::read(process.pid) == Some(Pause::Stopped);
    let mut runs = all()?;
    // In simulated time the kernel ends the services with their orchestrator, and a replay has no orchestrator label.
    runs.retain(|run| run.owner == User::this() && run.host == Host::RealTime);
    runs.retain(|run| run.processes.iter().all(is_stopped));
    runs.retain(|run| run.processes.iter().all(|process| !process.is_orchestrator));
    Ok(runs.iter().flat_map(|run| ended(&run.processes)).collect())
}

/// Kills processes. Returns the PIDs that have ended.
fn ended(processes: &[RunProcess]) -> Vec<u32> {
    let ended = processes.iter().filter(|process| process.end(END_LIMIT));
    ended.map(|process| process.pid).collect()
}

impl MachineRun {
    /// Returns the name of the run, which is that of its folder.
    #[must_use]
    pub fn name(&self) -> &str {
        let name = self.folder.file_name().and_then(|name| name.to_str());
        name.expect("a folder without a name is no run's")
    }

    /// Returns whether `name` is the run's name or the PID of one of its processes, which distinguishes runs of equal
    /// names.
    #[must_use]
    pub fn is_called(&self, name: &str) -> bool {
        let has_number = |process: &RunProcess| process.pid.to_string() == name;
        self.name() == name || self.processes.iter().any(has_number)
    }

    /// Returns the PIDs of the run.
    pub fn pids(&self) -> impl Iterator<Item = u32> {
        self.processes.iter().map(|process| process.pid)
    }

    /// Returns whether the user of this process may operate the run.
    #[must_use]
    pub fn is_permitted(&self) -> bool {
        let user = User::this();
        user == self.owner || user.is_root()
    }

    /// Returns the user who started the run: the login user, if the system records it.
    #[must_use]
    pub fn starter(&self) -> User {
        self.login.unwrap_or(self.owner)
    }

    /// Returns whether the run's folder and shared memory are the ones that this process sees under the same paths; in
    /// a container they may differ.
    #[must_use]
    pub fn shares_memory_with_this(&self) -> bool {
        let is_the_same = |path: &Path| {
            let here = stat(path).ok();
            let there = |process: &RunProcess| stat(process.path_in_its_root(path)).ok();
            let place = |file: Stat| (file.st_dev, file.st_ino);
            let there = self.processes.iter().find_map(there).map(place);
            there.is_some() && there == here.map(place)
        };
        is_the_same(&self.folder) && is_the_same(Path::new(shared_memory::FOLDER))
    }

    /// Opens the folder of the run, as its processes see it.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open_folder(&self) -> io::Result<OwnedFd> {
        let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let open = |path: &Path| rustix::fs::open(path, flags, Mode::empty());
        // Each process may have exited or be inaccessible.
        let mut opened = self
            .processes
            .iter()
            .map(|process| open(&process.path_in_its_root(&self.folder)));
        let folder = opened.find_map(Result::ok);
        let folder = folder.map_or_else(|| open(&self.folder), Ok)?;
        let found = fstat(&folder)?;
        // The path of a container may lead to another run's folder here.
        match self.place {
            Some(place) if place != (found.st_dev, found.st_ino) => {
                Err(io::Error::other("its folder is gone"))
            }
            _ => Ok(folder),
        }
    }

    /// Returns whether any process of the run lives, also one that was started after the search.
    #[must_use]
    pub fn lives(&self) -> bool {
        has_processes(self.owner, &self.folder)
    }

    /// Writes an operator's request into the control block that the run's processes share, bypassing the orchestrator.
    ///
    /// # Errors
    /// If no process of the run gives access to the control block.
    pub fn ask_directly(&self, request: Request) -> io::Result<()> {
        let asked = self
            .processes
            .iter()
            .map(|process| process.ask_directly(self.owner, request));
        // They share one control block. The request is written through each process, in case one has exited meanwhile.
        let (done, failed): (Vec<_>, Vec<_>) = asked.partition(Result::is_ok);
        match (done.is_empty(), failed.into_iter().next()) {
            (true, Some(failure)) => failure,
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use std::io::Read;
    use std::os::fd::{AsFd, BorrowedFd};
    use std::process::{Child, Command, Stdio};

    use runtime::control::SHARED_PAGE_FD;
    use runtime::descriptors::hand_on;
    use runtime::shared_page::SharedPage;
    use shared_types::service::Operator;

    use super::*;

    #[test]
    fn what_is_not_known_of_a_process_makes_no_run_of_its_own() {
        let [here, there] = [(1, 7), (2, 7)];
        let key = |user, folder: &'static str, place| Key {
            owner: User(user),
            folder: Path::new(folder),
            place,
        };
        let keys = [
            key(1, "/a/1-0", None),
            key(1, "/a/1-0", Some(here)),
            key(1, "/a/1-0", Some(here)),
            key(1, "/a/1-0", Some(there)),
            key(2, "/a/1-0", None),
            key(2, "/a/1-0", None),
            key(1, "/a/2-0", None),
        ];
        assert_eq!(group(&keys), [1, 1, 1, 3, 4, 4, 6]);
    }

    /// A process with the command line of a service, which ends with its input, and what it has in the page's place.
    fn service(run: &Path, page: BorrowedFd<'_>) -> Child {
        let label = label(run, Host::RealTime);
        let mut words = vec!["service".into(), "plant".into()];
        words.extend(label);
        process(&words, SHARED_PAGE_FD, [page])
    }

    /// A process with these arguments that ends with its input and has these files open.
    fn process<const N: usize>(
        words: &[std::ffi::OsString],
        first: i32,
        files: [BorrowedFd<'_>; N],
    ) -> Child {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(&words[0]), "echo; read line").unwrap();
        let mut command = Command::new("sh");
        command
            .args(words)
            .current_dir(&folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        hand_on(&mut command, first, files).unwrap();
        let mut child = command.spawn().unwrap();
        child.stdout.as_mut().unwrap().read_exact(&mut [0]).unwrap();
        child
    }

    fn end(mut child: Child) {
        drop(child.stdin.take());
        child.wait().unwrap();
    }

    #[test]
    fn a_run_is_found_as_long_as_a_process_of_it_lives_and_obeys_directly() {
        let folder = PathBuf::from(format!("/nowhere/test-{}", std::process::id()));
        let found = || all().unwrap().into_iter().find(|run| run.folder == folder);
        assert!(found().is_none());
        let page = SharedPage::create().unwrap();
        let child = service(&folder, page.file());
        let run = found().unwrap();
        assert_eq!((run.owner, run.host), (User::this(), Host::RealTime));
        assert!(run.is_called(run.name()) && run.is_called(&child.id().to_string()) && !run.is_called("1-0"));
        assert!(run.is_permitted());

        run.ask_directly(Request::Kill).unwrap();
        assert!(page.control_block().operator(Operator::default()).killed);
        end(child);
        assert!(found().is_none());
        assert!(
            run.ask_directly(Request::Kill).is_err(),
            "it has ended, even if its number is another process's now"
        );
    }

    #[test]
    fn a_run_without_a_service_is_found_by_its_orchestrator_and_obeys_directly() {
        let folder = PathBuf::from(format!("/nowhere/alone-{}", std::process::id()));
        let found = || all().unwrap().into_iter().find(|run| run.folder == folder);
        let page = SharedPage::create().unwrap();
        let label = OrchestratorLabel::new(&folder, Host::RealTime).unwrap();
        let files = [label.as_fd(), page.file()];
        let words = ["run", "scenario.toml"].map(Into::into);
        let child = process(&words, 7, files);
        let run = found().unwrap();
        assert_eq!((run.owner, run.host), (User::this(), Host::RealTime));
        assert!(run.is_called(&child.id().to_string()));
        run.ask_directly(Request::Kill).unwrap();
        assert!(page.control_block().operator(Operator::default()).killed);
        end(child);
        assert!(found().is_none());
    }

    #[test]
    fn what_is_no_page_of_a_run_is_not_written() {
        let folder = PathBuf::from(format!("/nowhere/no-page-{}", std::process::id()));
        let file = tempfile::tempfile().unwrap();
        file.set_len(4096).unwrap();
        let child = service(&folder, file.as_fd());
        let run = all()
            .unwrap()
            .into_iter()
            .find(|run| run.folder == folder)
            .unwrap();
        let refusal = run.ask_directly(Request::Kill).unwrap_err().to_string();
        end(child);
        assert!(refusal.contains("does not share"), "{refusal}");
        let mut bytes = Vec::new();
        (&file).read_to_end(&mut bytes).unwrap();
        assert!(bytes.iter().all(|&byte| byte == 0));
    }

    #[test]
    fn a_file_that_is_open_here_is_open_somewhere() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let found = stat(file.path()).unwrap();
        assert!(is_open_somewhere(&found));
        let (_, path) = file.keep().unwrap();
        assert!(!is_open_somewhere(&stat(&path).unwrap()));
        fs::remove_file(path).unwrap();
    }
}
