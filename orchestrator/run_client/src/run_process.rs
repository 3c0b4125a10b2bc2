//! A process of a run: its label, and the memory that it shares with the other processes of the run.
//!
//! The label of a service is its command line, which every user may read. The orchestrator's command line is the user's own,
//! so it keeps its label in an open anonymous file, which its owner and root may read. Both have the same form.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use runtime::activity;
use runtime::control::{Host, SHARED_PAGE_FD};
use runtime::shared_page::{self, Request, SharedPage};
use rustix::fs::{
    AtFlags, Dir, FileType, MemfdFlags, Mode, OFlags, Stat, fstat, memfd_create, openat, readlinkat, statat,
};
use rustix::io::Errno;
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use scenario_file::printable::printable;

use crate::runs::User;

/// Arguments of a service's process that name its run and what its steps follow.
const RUN: &str = "--run";
const HOST: &str = "--host";

/// Name of the anonymous file that holds the label of an orchestrator.
const LABEL_FILE: &str = "gerono-run";

/// Commands whose processes are orchestrators, as words of a command line.
const ORCHESTRATORS: [&[u8]; 2] = [b"run", b"attach"];

/// Maximum length of a command line that is read, and of the name of a run, bytes: a service's are far below.
const LONGEST_LINE: u64 = 8192;
const LONGEST_NAME: usize = 64;

/// A process of a run.
#[derive(Debug)]
pub(crate) struct RunProcess {
    pub(crate) pid: u32,
    /// Its folder in /proc, which stays its own even if another process gets its number.
    proc: OwnedFd,
    pub(crate) is_orchestrator: bool,
}

/// A process of a run with what its label and the kernel say.
#[derive(Debug)]
pub(crate) struct LabelledProcess {
    pub(crate) folder: PathBuf,
    pub(crate) host: Host,
    pub(crate) owner: User,
    /// The user who logged in for the session that it belongs to, if the system keeps that.
    pub(crate) login: Option<User>,
    /// Device and inode of the folder as it sees it, which tell apart runs of one name in several containers; `None` if this
    /// user may not look, or the folder is not there.
    pub(crate) place: Option<(u64, u64)>,
    pub(crate) process: RunProcess,
}

/// The label that makes an orchestrator's process recognizable, as long as this lives.
#[derive(Debug)]
pub struct OrchestratorLabel(OwnedFd);

impl OrchestratorLabel {
    /// Labels this process as the orchestrator of a run.
    ///
    /// # Errors
    /// If the system has no memory or no file descriptor left.
    pub fn new(folder: &Path, host: Host) -> io::Result<Self> {
        let mut file = File::from(memfd_create(LABEL_FILE, MemfdFlags::CLOEXEC)?);
        let mut line = b"gerono\0service\0orchestrator\0".to_vec();
        for word in label(folder, host) {
            line.extend_from_slice(word.as_bytes());
            line.push(0);
        }
        file.write_all(&line)?;
        Ok(Self(file.into()))
    }
}

impl AsFd for OrchestratorLabel {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// The arguments by which a process of a service says to which run it belongs.
#[must_use]
pub fn label(folder: &Path, host: Host) -> [OsString; 4] {
    [RUN.into(), folder.into(), HOST.into(), name_of(host).into()]
}

/// Returns the user who logged in for the session of a process, by its folder in /proc; none if the system does not keep it.
pub(crate) fn login_of(proc: &impl AsFd) -> Option<User> {
    const UNSET: u32 = u32::MAX;
    let text = String::from_utf8(read(proc, "loginuid")?).ok()?;
    let number = text.trim().parse().ok()?;
    (number != UNSET).then(|| User::of(number))
}

impl LabelledProcess {
    /// Reads the label of a process; `None` if it has none, or has ended meanwhile.
    pub(crate) fn of(pid: u32) -> Option<Self> {
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let proc = rustix::fs::open(format!("/proc/{pid}"), flags, Mode::empty()).ok()?;
        let line = read(&proc, "cmdline")?;
        let of_a_service = parse(&line);
        let is_orchestrator = of_a_service.is_none();
        let (folder, host) = match of_a_service {
            Some(label) => label,
            None => label_of_orchestrator(&proc, &line)?,
        };
        let status = String::from_utf8(read(&proc, "status")?).ok()?;
        // Real, effective, saved, of the file system.
        let users = status.lines().find_map(|line| line.strip_prefix("Uid:"))?;
        let owner = User::of(users.split_whitespace().nth(1)?.parse().ok()?);
        let login = login_of(&proc);
        let process = RunProcess {
            pid,
            proc,
            is_orchestrator,
        };
        let found = rustix::fs::stat(process.path_in_its_root(&folder)).ok();
        Some(Self {
            place: found.map(|found| (found.st_dev, found.st_ino)),
            folder,
            host,
            owner,
            login,
            process,
        })
    }
}

impl RunProcess {
    /// Returns a path of this process as that one sees it. It leads there as long as that process lives.
    pub(crate) fn path_in_its_root(&self, path: &Path) -> PathBuf {
        let root = PathBuf::from(format!("/proc/self/fd/{}/root", self.proc.as_raw_fd()));
        root.join(path.strip_prefix("/").unwrap_or(path))
    }

    /// Kills it, also if a signal has stopped it, and waits up to `limit` for its end. Returns whether it has ended.
    pub(crate) fn end(&self, limit: Duration) -> bool {
        let pid = Pid::from_raw(self.pid.cast_signed()).expect("the number of a process is positive");
        let process = match pidfd_open(pid, PidfdFlags::empty()) {
            Ok(process) => process,
            Err(error) => return error == Errno::SRCH,
        };
        // Only now: as long as its folder in /proc can be read, no other process can have its number.
        if read(&self.proc, "stat").is_none() {
            return true;
        }
        // It fails only for a process that is gone.
        let _ = pidfd_send_signal(&process, Signal::KILL);
        activity::ends_within(&process, limit)
    }

    /// Writes the operator's request into the page that it shares with the other processes of its run.
    pub(crate) fn ask_directly(&self, owner: User, request: Request) -> io::Result<()> {
        shared_page::ask_in(self.shared_page(owner)?.as_fd(), request)
    }

    /// The file of the page that it shares with the others of its run.
    ///
    /// Nothing else is opened, whatever the process has in the page's place: root writes there, too, and must not be led to
    /// write in a file that the run's owner may not write.
    fn shared_page(&self, owner: User) -> io::Result<OwnedFd> {
        let page = if self.is_orchestrator {
            // Any of its files may be closed meanwhile.
            descriptors(&self.proc).find_map(|name| {
                let file = anonymous_file(&self.proc, &name, SharedPage::NAME, owner, OFlags::RDWR);
                file.ok().flatten().map(Ok)
            })
        } else {
            let name = format!("fd/{SHARED_PAGE_FD}");
            anonymous_file(&self.proc, &name, SharedPage::NAME, owner, OFlags::RDWR).transpose()
        };
        page.unwrap_or_else(|| {
            let reason = format!("the process {} does not share the memory of a run", self.pid);
            Err(io::Error::other(reason))
        })
    }
}

/// The label that an orchestrator keeps open.
fn label_of_orchestrator(proc: &OwnedFd, line: &[u8]) -> Option<(PathBuf, Host)> {
    let mut words = line.split(|&byte| byte == 0).skip(1);
    if !words.any(|word| ORCHESTRATORS.contains(&word)) {
        return None;
    }
    let owner = User::of(fstat(proc).ok()?.st_uid);
    descriptors(proc).find_map(|name| {
        let file = anonymous_file(proc, &name, LABEL_FILE, owner, OFlags::RDONLY).ok()??;
        parse(&read_all(file)?)
    })
}

/// The descriptors of a process, as paths in its folder; none if this user may not look.
fn descriptors(proc: &OwnedFd) -> impl Iterator<Item = String> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
    let folder = openat(proc, "fd", flags, Mode::empty()).and_then(Dir::new).ok();
    let entries = folder.into_iter().flatten().flatten();
    entries.filter_map(|entry| {
        let number: u32 = entry.file_name().to_str().ok()?.parse().ok()?;
        Some(format!("fd/{number}"))
    })
}

/// Opens the anonymous file of a name and an owner behind a descriptor of a process; `None` if there is another file.
fn anonymous_file(
    proc: &OwnedFd,
    descriptor: &str,
    called: &str,
    owner: User,
    access: OFlags,
) -> io::Result<Option<OwnedFd>> {
    let called = format!("/memfd:{called} (deleted)");
    if readlinkat(proc, descriptor, Vec::new())?.as_bytes() != called.as_bytes() {
        return Ok(None);
    }
    let is_such = |file: &Stat| {
        let is_nameless_file = FileType::from_raw_mode(file.st_mode).is_file() && file.st_nlink == 0;
        is_nameless_file && file.st_uid == owner.number()
    };
    let before = statat(proc, descriptor, AtFlags::empty())?;
    if !is_such(&before) {
        return Ok(None);
    }
    let flags = access | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let file = openat(proc, descriptor, flags, Mode::empty())?;
    let opened = fstat(&file)?;
    let is_the_same = (opened.st_dev, opened.st_ino) == (before.st_dev, before.st_ino);
    Ok(is_the_same.then_some(file))
}

/// Returns whether a process of this user has a file open, among those that it can see.
pub(crate) fn is_open_in_a_visible_process(file: &Stat) -> bool {
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let mut descriptors = processes.flat_map(|process| {
        let files = std::fs::read_dir(process.path().join("fd"));
        files.into_iter().flatten().flatten()
    });
    descriptors.any(|descriptor| {
        let opened = rustix::fs::stat(descriptor.path());
        opened.is_ok_and(|opened| (opened.st_dev, opened.st_ino) == (file.st_dev, file.st_ino))
    })
}

/// The folder of the run and what it follows, from the label of a process.
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

fn read(proc: &impl AsFd, name: &str) -> Option<Vec<u8>> {
    read_all(openat(proc, name, OFlags::RDONLY | OFlags::CLOEXEC, Mode::empty()).ok()?)
}

fn read_all(file: OwnedFd) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    File::from(file).take(LONGEST_LINE).read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
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
}
