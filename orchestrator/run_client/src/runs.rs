//! The live runs of this machine, found by their processes.
//!
//! Every process of a service has the run's folder in its command line, which every user may read, and the orchestrator has it
//! in an open file ([`OrchestratorLabel`]). So a run is found for as long as its orchestrator or one of its services lives, in
//! whatever environment and by whichever user it was begun; there is no list that could be out of date, hidden by another
//! environment, or written by another user. A label can say anything, but the kernel says whose process it is: an entry names
//! a run and its owner, and is trusted for no more.

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

/// Restricts what commands find to the runs whose folders are in the one that it names: for tests and scripts that fly beside
/// others.
pub const SCOPE: &str = "GERONO_RUNS";

/// Environment variable in which `sudo` leaves the user who called it.
const SUDO_USER: &str = "SUDO_UID";

/// Time within which a killed process ends: it waits for the system at most, a slow disk for example.
const END_LIMIT: Duration = Duration::from_secs(1);

/// A live run.
#[derive(Debug)]
pub struct MachineRun {
    /// Its folder, as its processes see it.
    pub folder: PathBuf,
    /// The user whose processes these are.
    pub owner: User,
    /// The host of its steps.
    pub host: Host,
    /// The user who logged in for the session in which it was begun, if the system keeps that.
    login: Option<User>,
    /// Device and inode of its folder; `None` if they are not known.
    place: Option<(u64, u64)>,
    /// At least one.
    processes: Vec<RunProcess>,
}

/// A user, by number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct User(u32);

impl User {
    /// The user who runs this.
    #[must_use]
    pub fn this() -> Self {
        Self(rustix::process::geteuid().as_raw())
    }

    /// Returns the user who typed the command: the one who logged in, where the system or `sudo` keeps that.
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

    /// Returns whether it may do what belongs to all users.
    #[must_use]
    pub fn is_root(self) -> bool {
        self.0 == 0
    }

    /// The user of this number.
    #[must_use]
    pub fn of(number: u32) -> Self {
        Self(number)
    }

    /// Its number.
    #[must_use]
    pub fn number(self) -> u32 {
        self.0
    }
}

/// As `sudo -u` takes it: by name where there is one.
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

/// All live runs that this user can see, or those in the folder that the environment restricts the search to; by owner and
/// folder.
///
/// # Errors
/// If /proc cannot be read.
pub fn all() -> io::Result<Vec<MachineRun>> {
    let scope = scope();
    let processes = fs::read_dir("/proc")?.flatten().filter_map(|entry| {
        let pid = entry.file_name().to_str()?.parse().ok()?;
        // A process that is no service's, or has ended meanwhile, belongs to no run.
        LabelledProcess::of(pid)
    });
    let is_meant = |found: &LabelledProcess| {
        let is_within = |scope: &PathBuf| found.folder.starts_with(scope);
        scope.as_ref().is_none_or(is_within)
    };
    let processes: Vec<_> = processes.filter(is_meant).collect();
    let keys: Vec<_> = processes.iter().map(Key::of).collect();
    let groups = group(&keys);
    let mut runs = Vec::<MachineRun>::new();
    // The processes whose place is known come first: they make the groups.
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

/// What tells runs apart.
#[derive(Debug, PartialEq, Eq)]
struct Key<'a> {
    owner: User,
    folder: &'a Path,
    /// Device and inode of the folder; `None` if they are not known.
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

/// Returns for each process the first process of its run. What is not known is no value: such a process belongs to a run of
/// its owner and folder whose place is known, if there is one.
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

/// The folder that the environment restricts the search to.
#[must_use]
pub fn scope() -> Option<PathBuf> {
    let scope = std::env::var_os(SCOPE).filter(|scope| !scope.is_empty());
    scope.map(PathBuf::from)
}

/// Returns whether the system hides the processes of other users from this one (`hidepid`), so that their runs are not found.
#[must_use]
pub fn are_hidden() -> bool {
    fs::read("/proc/1/cmdline").is_err()
}

/// Returns whether a process of this machine that this user can see has a file open.
#[must_use]
pub(crate) fn is_open_somewhere(file: &Stat) -> bool {
    run_process::is_open_in_a_visible_process(file)
}

/// Returns whether a process of the run of this owner and folder lives.
pub(crate) fn has_processes(owner: User, folder: &Path) -> bool {
    let is_it = |run: &MachineRun| run.owner == owner && run.folder == folder;
    all().is_ok_and(|runs| runs.iter().any(is_it))
}

/// Kills the services of this user's run of a folder, and its standby process, except the processes of these numbers, and
/// waits for their ends: their ports are free then for others. Returns the numbers of those that have ended.
///
/// # Errors
/// If /proc cannot be read.
pub fn end_services_except(folder: &Path, kept: &[u32]) -> io::Result<Vec<u32>> {
    let mut runs = all()?;
    runs.retain(|run| run.owner == User::this() && run.folder == folder && run.shares_memory_with_this());
    let mut services: Vec<_> = runs.into_iter().flat_map(|run| run.processes).collect();
    services.retain(|process| !process.is_orchestrator && !kept.contains(&process.pid));
    Ok(ended(&services))
}

/// Kills the processes of this user's dead runs and waits for their ends. Returns the numbers of those that have ended.
///
/// A run is dead if it has no orchestrator and signals have stopped all its processes: nothing steps, and no orchestrator
/// can take over. Processes that are not stopped end by themselves, when the vehicle has landed.
///
/// # Errors
/// If /proc cannot be read.
pub fn end_dead() -> io::Result<Vec<u32>> {
    let is_stopped = |process: &RunProcess| Pause::of(process.pid) == Some(Pause::Stopped);
    let mut runs = all()?;
    // In simulated time the system ends the services with their orchestrator, and no orchestrator of a replay is found.
    runs.retain(|run| run.owner == User::this() && run.host == Host::RealTime);
    runs.retain(|run| run.processes.iter().all(is_stopped));
    runs.retain(|run| run.processes.iter().all(|process| !process.is_orchestrator));
    Ok(runs.iter().flat_map(|run| ended(&run.processes)).collect())
}

/// Kills processes. Returns the numbers of those that have ended.
fn ended(processes: &[RunProcess]) -> Vec<u32> {
    let ended = processes.iter().filter(|process| process.end(END_LIMIT));
    ended.map(|process| process.pid).collect()
}

impl MachineRun {
    /// Its name: that of its folder.
    #[must_use]
    pub fn name(&self) -> &str {
        let name = self.folder.file_name().and_then(|name| name.to_str());
        name.expect("a folder without a name is no run's")
    }

    /// Returns whether this is what the user calls so: the run's name, or the number of one of its processes, which tells runs of
    /// one name apart.
    #[must_use]
    pub fn is_called(&self, name: &str) -> bool {
        let has_number = |process: &RunProcess| process.pid.to_string() == name;
        self.name() == name || self.processes.iter().any(has_number)
    }

    /// The numbers of its processes.
    pub fn pids(&self) -> impl Iterator<Item = u32> {
        self.processes.iter().map(|process| process.pid)
    }

    /// Returns whether the user who runs this may operate it.
    #[must_use]
    pub fn is_permitted(&self) -> bool {
        let user = User::this();
        user == self.owner || user.is_root()
    }

    /// Returns the user who began it: the one who logged in, where the system keeps that.
    #[must_use]
    pub fn starter(&self) -> User {
        self.login.unwrap_or(self.owner)
    }

    /// Returns whether its folder and its shared memory are those that this process sees under their names; in a container they
    /// may be others.
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

    /// Opens its folder, as its processes see it.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open_folder(&self) -> io::Result<OwnedFd> {
        let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let open = |path: &Path| rustix::fs::open(path, flags, Mode::empty());
        // Any of them may have ended meanwhile, or may not be looked into.
        let mut opened = self
            .processes
            .iter()
            .map(|process| open(&process.path_in_its_root(&self.folder)));
        let folder = opened.find_map(Result::ok);
        let folder = folder.map_or_else(|| open(&self.folder), Ok)?;
        let found = fstat(&folder)?;
        // Under the name that it has in a container, there may be the folder of another run here.
        match self.place {
            Some(place) if place != (found.st_dev, found.st_ino) => {
                Err(io::Error::other("its folder is gone"))
            }
            _ => Ok(folder),
        }
    }

    /// Returns whether a process of it lives, also one that was started later.
    #[must_use]
    pub fn lives(&self) -> bool {
        has_processes(self.owner, &self.folder)
    }

    /// Writes the operator's request into the memory that the run's processes share, without its orchestrator.
    ///
    /// # Errors
    /// If the memory of none of them can be had.
    pub fn ask_directly(&self, request: Request) -> io::Result<()> {
        let asked = self
            .processes
            .iter()
            .map(|process| process.ask_directly(self.owner, request));
        // All of them share one page: each that can be reached is asked, in case that one has ended meanwhile.
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
