//! A process of a run: its label, and the memory that it shares with the run's other processes.
//!
//! The label of a service is in its command line, which every user may read. The command line of an orchestrator is the
//! user's, so its label is in an anonymous file that it keeps open and that its owner and root may read. Both have the
//! same format.

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

/// Arguments of a service's process with the run's folder and the host.
const RUN: &str = "--run";
const HOST: &str = "--host";

/// Name of the anonymous file that holds the label of an orchestrator.
const LABEL_FILE: &str = "gerono-run";

/// Commands whose processes are orchestrators, in the format of a command line.
const ORCHESTRATORS: [&[u8]; 2] = [b"run", b"attach"];

/// Maximum lengths of a command line that is read, and of a run's name, bytes; a service's are far shorter.
const LONGEST_LINE: u64 = 8192;
const LONGEST_NAME: usize = 64;

#[derive(Debug)]
pub(crate) struct RunProcess {
    pub(crate) pid: u32,
    /// Its folder in /proc. The descriptor remains bound to the process even if the PID is reused.
    proc: OwnedFd,
    pub(crate) is_orchestrator: bool,
}

/// Process of a run, with its label and the kernel's data.
#[derive(Debug)]
pub(crate) struct LabelledProcess {
    pub(crate) folder: PathBuf,
    pub(crate) host: Host,
    pub(crate) owner: User,
    /// Login user of the process's session, if the system records it (`loginuid`).
    pub(crate) login: Option<User>,
    /// Device and inode of the run's folder as the process sees it, which distinguish runs of one name in several
    /// containers; `None` if this user may not look it up, or the folder is missing.
    pub(crate) place: Option<(u64, u64)>,
    pub(crate) process: RunProcess,
}

/// Label that identifies this process as an orchestrator; dropping it removes the label.
#[derive(Debug)]
pub struct OrchestratorLabel(OwnedFd);

impl OrchestratorLabel {
    /// Labels this process as the orchestrator of a run.
    ///
    /// # Errors
    /// If memory or file descriptors are exhausted.
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

/// Returns the arguments that label a service's process with its run.
#[must_use]
pub fn label(folder: &Path, host: Host) -> [OsString; 4] {
    [RUN.into(), folder.into(), HOST.into(), name_of(host).into()]
}

/// Returns the login user of a process's session, by its folder in /proc; `None` if the system does not record it.
pub(crate) fn login_of(proc: &impl AsFd) -> Option<User> {
    const UNSET: u32 = u32::MAX;
    let text = String::from_utf8(read(proc, "loginuid")?).ok()?;
    let number = text.trim().parse().ok()?;
    (number != UNSET).then(|| User::of(number))
}

impl LabelledProcess {
    /// Reads the label of a process; `None` if it has none, or has exited.
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
        // The fields are the real, effective, saved and file-system UID.
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
    /// Returns a path as this process resolves it, valid while this process exists.
    pub(crate) fn path_in_its_root(&self, path: &Path) -> PathBuf {
        let root = PathBuf::from(format!("/proc/self/fd/{}/root", self.proc.as_raw_fd()));
        root.join(path.strip_prefix("/").unwrap_or(path))
    }

    /// Kills the process, even if it is stopped, and waits up to `limit` for its end. Returns whether it has ended.
    pub(crate) fn end(&self, limit: Duration) -> bool {
        let pid = Pid::from_raw(self.pid.cast_signed()).expect("the number of a process is positive");
        let process = match pidfd_open(pid, PidfdFlags::empty()) {
            Ok(process) => process,
            Err(error) => return error == Errno::SRCH,
        };
        // Checked after `pidfd_open`: while the folder in /proc is readable, the PID belongs to the same process, and
        // so does the pidfd. The reverse order could kill another process.
        if read(&self.proc, "stat").is_none() {
            return true;
        }
        // It fails only if the process has exited.
        let _ = pidfd_send_signal(&process, Signal::KILL);
        activity::ends_within(&process, limit)
    }

    /// Writes an operator's request into the control block that the run's processes share.
    pub(crate) fn ask_directly(&self, owner: User, request: Request) -> io::Result<()> {
        shared_page::ask_in(self.shared_page(owner)?.as_fd(), request)
    }

    /// Opens the file of the run's control block.
    ///
    /// No other file is opened, whatever the process has at that descriptor: root writes to it, and must not be tricked
    /// into writing to a file that the run's owner may not write.
    fn shared_page(&self, owner: User) -> io::Result<OwnedFd> {
        let page = if self.is_orchestrator {
            // Files may be closed while they are checked; the next one is tried.
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

/// Returns the label in an orchestrator's anonymous file.
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

/// Returns the descriptors of a process, as paths in its folder; none if this user may not read them.
fn descriptors(proc: &OwnedFd) -> impl Iterator<Item = String> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
    let folder = openat(proc, "fd", flags, Mode::empty()).and_then(Dir::new).ok();
    let entries = folder.into_iter().flatten().flatten();
    entries.filter_map(|entry| {
        let number: u32 = entry.file_name().to_str().ok()?.parse().ok()?;
        Some(format!("fd/{number}"))
    })
}

/// Opens the anonymous file of a name and owner behind a descriptor; `None` if it is another file.
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

/// Returns whether a process visible to this user has a file open.
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

/// Parses a label: the folder of the run and the host.
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
    // The label is shown on this user's terminal, whatever another user writes into it.
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
