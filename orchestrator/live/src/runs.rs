//! The live runs of this machine, found by their processes.
//!
//! Every process of a service has the run's folder in its command line, which every user may read. So a run is found for as
//! long as one of its processes lives, in whatever environment and by whichever user it was begun; there is no list that
//! could be out of date, hidden by another environment, or written by another user. A command line can say anything, but the kernel
//! says whose process it is: an entry names a run and its owner, and is trusted for no more.

use std::ffi::OsString;
use std::fmt;
use std::fs::{self, File};
use std::io::{self, Read};
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};

use runtime::control::{Host, SHARED_PAGE_FD};
use runtime::shared_page::{self, Request, SharedPage};
use rustix::fs::{AtFlags, FileType, Mode, OFlags, Stat, fstat, openat, readlinkat, statat};

use command_line::terminal::printable;

/// Restricts what commands find to the runs whose folders are in the one that it names: for tests and scripts that fly beside
/// others.
pub const SCOPE: &str = "GERONO_RUNS";

/// Arguments of a service's process that name its run and what its steps follow.
const RUN: &str = "--run";
const HOST: &str = "--host";

/// Longest command line that is read, and longest name of a run, bytes: a service's are far below.
const LONGEST_LINE: u64 = 8192;
const LONGEST_NAME: usize = 64;

/// A live run.
#[derive(Debug)]
pub struct MachineRun {
    /// Its folder, as its processes see it.
    pub folder: PathBuf,
    /// The user whose processes these are.
    pub owner: User,
    /// The host of its steps.
    pub host: Host,
    /// At least one.
    processes: Vec<RunProcess>,
}

/// A user, by number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct User(u32);

/// A process of a service.
#[derive(Debug)]
struct RunProcess {
    pid: u32,
    /// Its folder in /proc, which stays its own even if another process gets its number.
    proc: OwnedFd,
}

impl User {
    /// The user who runs this.
    #[must_use]
    pub fn this() -> Self {
        Self(rustix::process::geteuid().as_raw())
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

/// The arguments by which a process of a service says to which run it belongs.
#[must_use]
pub fn label(folder: &Path, host: Host) -> [OsString; 4] {
    [RUN.into(), folder.into(), HOST.into(), name_of(host).into()]
}

/// All live runs that this user can see, or those in the folder that the environment restricts the search to; by owner and
/// folder.
///
/// # Errors
/// If /proc cannot be read.
pub fn all() -> io::Result<Vec<MachineRun>> {
    let scope = scope();
    let mut runs = Vec::<MachineRun>::new();
    for entry in fs::read_dir("/proc")?.flatten() {
        let pid = entry.file_name().to_str().and_then(|name| name.parse().ok());
        // A process that is no service's, or has ended meanwhile, belongs to no run.
        let Some(run) = pid.and_then(run_of) else {
            continue;
        };
        if scope.as_ref().is_some_and(|scope| !run.folder.starts_with(scope)) {
            continue;
        }
        match runs.iter_mut().find(|known| known.is_same(&run)) {
            Some(known) => known.processes.extend(run.processes),
            None => runs.push(run),
        }
    }
    runs.sort_by(|one, other| (one.owner, &one.folder).cmp(&(other.owner, &other.folder)));
    Ok(runs)
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

/// The run that a process belongs to, with this process alone.
fn run_of(pid: u32) -> Option<MachineRun> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
    let proc = rustix::fs::open(format!("/proc/{pid}"), flags, Mode::empty()).ok()?;
    let (folder, host) = parse(&read(&proc, "cmdline")?)?;
    let status = String::from_utf8(read(&proc, "status")?).ok()?;
    // Real, effective, saved, of the file system.
    let users = status.lines().find_map(|line| line.strip_prefix("Uid:"))?;
    let owner = User(users.split_whitespace().nth(1)?.parse().ok()?);
    Some(MachineRun {
        folder,
        owner,
        host,
        processes: vec![RunProcess { pid, proc }],
    })
}

/// The folder of the run and what it follows, from the command line of a service's process.
fn parse(line: &[u8]) -> Option<(PathBuf, Host)> {
    let words = line.strip_suffix(b"\0")?.split(|&byte| byte == 0);
    let words: Vec<_> = words.map(std::str::from_utf8).collect::<Result<_, _>>().ok()?;
    let [_program, "service", _service, RUN, folder, HOST, host] = words.as_slice() else {
        return None;
    };
    let host = [Host::LockStep, Host::RealTime, Host::Replay]
        .into_iter()
        .find(|known| name_of(*known) == *host)?;
    let folder = Path::new(folder);
    let name = folder.file_name()?.to_str()?;
    // Whatever another user writes there, it is shown on this user's terminal.
    let is_plain = |character: char| character.is_ascii_alphanumeric() || "-_.".contains(character);
    let is_well_formed = folder.is_absolute()
        && folder.to_str().is_some_and(|text| printable(text) == text)
        && name.len() <= LONGEST_NAME
        && name.chars().all(is_plain);
    is_well_formed.then(|| (folder.to_owned(), host))
}

fn name_of(host: Host) -> &'static str {
    match host {
        Host::LockStep => "lockstep",
        Host::RealTime => "realtime",
        Host::Replay => "replay",
    }
}

fn read(proc: &OwnedFd, name: &str) -> Option<Vec<u8>> {
    let file = openat(proc, name, OFlags::RDONLY | OFlags::CLOEXEC, Mode::empty()).ok()?;
    let mut bytes = Vec::new();
    File::from(file).take(LONGEST_LINE).read_to_end(&mut bytes).ok()?;
    Some(bytes)
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

    /// Returns whether its processes see the file system as this one does; in a container they do not.
    #[must_use]
    pub fn is_in_this_file_system(&self) -> bool {
        let ours = rustix::fs::readlink("/proc/self/ns/mnt", Vec::new()).ok();
        // Of what may not be looked into, nothing else is known.
        self.file_system().is_none_or(|theirs| Some(theirs) == ours)
    }

    /// Its folder, as this process sees it.
    #[must_use]
    pub fn folder_from_here(&self) -> PathBuf {
        if self.is_in_this_file_system() {
            return self.folder.clone();
        }
        let root = PathBuf::from(format!("/proc/{}/root", self.processes[0].pid));
        root.join(self.folder.strip_prefix("/").unwrap_or(&self.folder))
    }

    fn file_system(&self) -> Option<std::ffi::CString> {
        readlinkat(&self.processes[0].proc, "ns/mnt", Vec::new()).ok()
    }

    /// Returns whether a process of it lives, also one that was started later.
    #[must_use]
    pub fn lives(&self) -> bool {
        let is_it = |run: &Self| (run.owner, &run.folder) == (self.owner, &self.folder);
        all().is_ok_and(|runs| runs.iter().any(is_it))
    }

    fn is_same(&self, other: &Self) -> bool {
        (self.owner, &self.folder) == (other.owner, &other.folder)
            && self.file_system() == other.file_system()
    }

    /// Writes the operator's request into the memory that the run's processes share, without its orchestrator.
    ///
    /// # Errors
    /// If the memory of none of them can be had.
    pub fn ask_directly(&self, request: Request) -> io::Result<()> {
        let asked = self.processes.iter().map(|process| {
            let page = process.shared_page(self.owner)?;
            shared_page::ask_in(page.as_fd(), request)
        });
        // All of them share one page: each that can be reached is asked, in case that one has ended meanwhile.
        let (done, failed): (Vec<_>, Vec<_>) = asked.partition(Result::is_ok);
        match (done.is_empty(), failed.into_iter().next()) {
            (true, Some(failure)) => failure,
            _ => Ok(()),
        }
    }
}

impl RunProcess {
    /// The file of the page that it shares with the others of its run.
    ///
    /// Nothing else is opened, whatever the process has in the page's place: root writes there, too, and must not be led to
    /// write in a file that the run's owner may not write.
    fn shared_page(&self, owner: User) -> io::Result<OwnedFd> {
        let name = format!("fd/{SHARED_PAGE_FD}");
        let called = format!("/memfd:{} (deleted)", SharedPage::NAME);
        let is_page = |file: &Stat| {
            let is_nameless_file = FileType::from_raw_mode(file.st_mode).is_file() && file.st_nlink == 0;
            is_nameless_file && file.st_uid == owner.0
        };
        let found = readlinkat(&self.proc, &name, Vec::new())?;
        let before = statat(&self.proc, &name, AtFlags::empty())?;
        if found.as_bytes() == called.as_bytes() && is_page(&before) {
            let page = openat(&self.proc, &name, OFlags::RDWR | OFlags::CLOEXEC, Mode::empty())?;
            let opened = fstat(&page)?;
            if (opened.st_dev, opened.st_ino) == (before.st_dev, before.st_ino) {
                return Ok(page);
            }
        }
        let reason = format!("the process {} does not share the memory of a run", self.pid);
        Err(io::Error::other(reason))
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use std::os::fd::BorrowedFd;
    use std::process::{Child, Command, Stdio};

    use runtime::descriptors::hand_on;
    use shared_types::service::Operator;

    use super::*;

    fn line(words: &[&str]) -> Vec<u8> {
        words
            .iter()
            .flat_map(|word| [word.as_bytes(), b"\0"].concat())
            .collect()
    }

    fn labelled(folder: &str, host: &str) -> Vec<u8> {
        line(&[
            "/proc/self/exe",
            "service",
            "plant",
            "--run",
            folder,
            "--host",
            host,
        ])
    }

    #[test]
    fn a_command_line_names_the_run() {
        let folder = Path::new("/dev/shm/gerono-0/77-0");
        for host in [Host::LockStep, Host::RealTime, Host::Replay] {
            let mut words = vec!["gerono", "service", "plant"];
            let label = label(folder, host).map(|word| word.into_string().unwrap());
            words.extend(label.iter().map(String::as_str));
            assert_eq!(parse(&line(&words)), Some((folder.to_owned(), host)));
        }
    }

    #[test]
    fn a_command_line_that_no_service_has_names_no_run() {
        let long = format!("/{}", "x".repeat(LONGEST_NAME + 1));
        for folder in [
            "",
            "/",
            "relative/1-0",
            "/a/\x1b[2J/1-0",
            "/a/1-0\x1b",
            "/a/1 0",
            "/a/..",
            &long,
        ] {
            assert_eq!(parse(&labelled(folder, "realtime")), None, "{folder:?}");
        }
        assert_eq!(parse(&labelled("/a/1-0", "inprocess")), None);
        assert_eq!(parse(&line(&["gerono", "run", "scenario.toml"])), None);
        assert_eq!(parse(b""), None);
        let mut bytes = labelled("/a/1-0", "realtime");
        bytes[0] = 0xff;
        assert_eq!(parse(&bytes), None);
    }

    /// A process with the command line of a service, which ends with its input, and what it has in the page's place.
    fn service(run: &Path, page: BorrowedFd<'_>) -> Child {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("service"), "echo; read line").unwrap();
        let mut command = Command::new("sh");
        command
            .args(["service", "plant"])
            .args(label(run, Host::RealTime))
            .current_dir(&folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        hand_on(&mut command, SHARED_PAGE_FD, [page]).unwrap();
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
        assert!(run.is_permitted() && run.folder_from_here() == folder);

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
}
