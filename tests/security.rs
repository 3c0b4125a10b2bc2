//! Attacks of another user of the machine on a run: docs/developers.md lists what comes of each.
//!
//! Needs root, to act as two users whom nobody else is. Without it these tests are skipped with a message.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::fs::{self, File};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt, chown, symlink};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use common::processes::{await_process, await_successor, services_of, shared_memory_of, signal};
use common::share::{Load, Share};
use common::{Begun, begin, complaint, finish, hover_arguments, output, said, scenario, succeed, until};
use run_client::runs::SCOPE;
use run_client::{Answer, Question, SOCKET, Snapshot};
use runtime::control::{Channel, SHARED_PAGE_FD};
use runtime::shared_page::Request;
use rustix::fs::{Gid, Mode, Uid};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType, connect, socket_with};
use rustix::process::{Pid, Signal, kill_process};
use shared_types::ServiceId;
use tempfile::TempDir;

/// Services whose orchestrator was killed are waited for so long.
const SWEEPING: Duration = Duration::from_secs(20);

/// Users of no account. Each test has its own, because the folder of a user's runs is one for the machine.
const FIRST_USER: u32 = 61_000;

/// The one who flies, and the one who should not disturb that.
struct Users {
    owner: u32,
    other: u32,
    /// Place where the owner's results are, and a copy of the program that both may run.
    place: TempDir,
    _share: Share,
}

impl Users {
    /// Those of a test of this number; none if this is not root.
    fn of(test: u32) -> Option<Self> {
        if !rustix::process::geteuid().is_root() {
            eprintln!("SKIPPED: only root can act as two users");
            return None;
        }
        let share = Share::take(Load::InRealTime);
        let place = tempfile::tempdir().unwrap();
        let users = Self {
            owner: FIRST_USER + 2 * test,
            other: FIRST_USER + 2 * test + 1,
            place,
            _share: share,
        };
        users.remove_folder();
        open_to(users.place.path(), 0o755);
        // The folders above the program may be closed to others.
        let program = env!("CARGO_BIN_EXE_gerono");
        fs::hard_link(program, users.program())
            .or_else(|_| fs::copy(program, users.program()).map(drop))
            .unwrap();
        for folder in ["owner", "other"] {
            fs::create_dir(users.path(folder)).unwrap();
        }
        chown(users.path("owner"), Some(users.owner), Some(users.owner)).unwrap();
        chown(users.path("other"), Some(users.other), Some(users.other)).unwrap();
        // A world-readable copy, for the same reason.
        fs::copy(scenario("hover"), users.path("hover.toml")).unwrap();
        Some(users)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.place.path().join(name)
    }

    fn program(&self) -> PathBuf {
        self.path("gerono")
    }

    /// The folder of the owner's runs where no environment names another: anybody can tell its name.
    fn folder(&self) -> PathBuf {
        PathBuf::from(format!("/dev/shm/gerono-{}", self.owner))
    }

    fn remove_folder(&self) {
        let _ = fs::remove_dir_all(self.folder());
        let _ = fs::remove_file(self.folder());
    }

    /// `gerono` as a user with no environment, but that it finds the runs of this test only.
    fn gerono(&self, user: u32, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.program());
        command
            .args(arguments)
            .current_dir(self.path(if user == self.owner { "owner" } else { "other" }))
            .env_clear()
            .env(SCOPE, self.folder())
            .stdin(Stdio::null());
        if user != 0 {
            command.uid(user).gid(user);
        }
        command
    }

    /// A flight in real time of the owner's under way, begun under the umask that forbids nothing.
    fn take_off(&self) -> Begun {
        let hover = self.path("hover.toml");
        let mut command = self.gerono(self.owner, &hover_arguments(hover.to_str().unwrap(), "flight"));
        command.arg("--quiet");
        let before = rustix::process::umask(Mode::empty());
        let run = begin(&mut command);
        rustix::process::umask(before);
        until("a flight that can be looked at", || self.look(self.owner));
        run
    }

    /// Returns the state of the owner's run, as a user sees it.
    fn look(&self, user: u32) -> Option<Snapshot> {
        let looked = self.gerono(user, &["top", "--once", "--json"]).output().unwrap();
        serde_json::from_slice(&looked.stdout).ok()
    }

    /// The flight goes on as if nothing had been, and then ends.
    fn end(&self, run: Begun) {
        let seen = self.look(self.owner).unwrap();
        assert!(!seen.killed && !seen.landing, "{seen:?}");
        until("the flight that goes on", || {
            self.look(self.owner).filter(|now| now.time > seen.time)
        });
        signal(run.id(), Signal::INT);
        assert_eq!(finish(run).status.code(), Some(130));
    }
}

impl Drop for Users {
    /// Sweeps up behind a run that a failed test has killed, as soon as its services have ended.
    fn drop(&mut self) {
        let deadline = Instant::now() + SWEEPING;
        let has_runs = || {
            let entries = fs::read_dir(self.folder()).into_iter().flatten().flatten();
            entries.filter(|entry| entry.path().is_dir()).count() > 0
        };
        while has_runs() && Instant::now() < deadline {
            let _ = self.gerono(self.owner, &["clean"]).output();
        }
        self.remove_folder();
    }
}

fn open_to(path: &Path, mode: u32) {
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
}

/// Does something as a user.
fn acting_as<T: Send>(user: u32, work: impl FnOnce() -> T + Send) -> T {
    let work = || {
        let (user, group) = (Uid::from_raw(user), Gid::from_raw(user));
        rustix::thread::set_thread_groups(&[]).unwrap();
        rustix::thread::set_thread_res_gid(group, group, group).unwrap();
        rustix::thread::set_thread_res_uid(user, user, user).unwrap();
        work()
    };
    std::thread::scope(|scope| scope.spawn(work).join().unwrap())
}

#[track_caller]
fn assert_denied<T>(what: &str, attempt: io::Result<T>) {
    let kind = attempt.map(drop).map_err(|error| error.kind());
    assert_eq!(kind, Err(io::ErrorKind::PermissionDenied), "{what}");
}

fn socket_to(path: &Path) -> io::Result<Channel> {
    let socket: OwnedFd = socket_with(
        AddressFamily::UNIX,
        SocketType::SEQPACKET,
        SocketFlags::CLOEXEC,
        None,
    )?;
    connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(Channel::inherited(socket))
}

#[test]
fn a_folder_that_another_user_has_made_is_refused_and_nothing_behind_it_is_touched() {
    let Some(users) = Users::of(0) else { return };
    let precious = users.path("owner/precious");
    fs::write(&precious, "content").unwrap();
    chown(&precious, Some(users.owner), None).unwrap();
    let make = |mode: u32| {
        users.remove_folder();
        acting_as(users.other, || {
            fs::DirBuilder::new().mode(mode).create(users.folder()).unwrap();
            open_to(&users.folder(), mode);
            symlink(&precious, users.folder().join("door")).unwrap();
        });
    };
    let hover = users.path("hover.toml");
    for mode in [0o777, 0o1777, 0o755] {
        make(mode);
        let out = format!("flight-{mode:o}");
        let flight = ["run", hover.to_str().unwrap(), "--out", &out];
        for arguments in [&["clean"][..], &flight] {
            let refused = output(&mut users.gerono(users.owner, arguments));
            assert_eq!(
                refused.status.code(),
                Some(1),
                "{mode:o} {arguments:?} {}",
                said(&refused)
            );
            let said = complaint(&refused);
            assert!(
                said.contains(&users.other.to_string()) && said.contains("sudo rm -r"),
                "{said}"
            );
        }
        assert_eq!(fs::read_to_string(&precious).unwrap(), "content");
    }
    // A link, even to a folder of the owner's own.
    users.remove_folder();
    acting_as(users.other, || {
        symlink(users.path("owner"), users.folder()).unwrap();
    });
    let refused = output(&mut users.gerono(users.owner, &["clean"]));
    assert!(
        complaint(&refused).contains("is not a folder"),
        "{}",
        said(&refused)
    );
    // What it says to do helps.
    users.remove_folder();
    succeed(&mut users.gerono(users.owner, &["clean"]));
    assert_eq!(fs::metadata(users.folder()).unwrap().mode() & 0o7777, 0o700);
}

#[test]
fn nothing_of_a_live_run_can_be_opened_by_another_user_whatever_the_umask_was() {
    let Some(users) = Users::of(1) else { return };
    let run = users.take_off();
    let place = users.folder().join(format!("{}-0", run.id()));
    let memory = shared_memory_of(run.id());
    assert!(memory.len() > 10, "{memory:?}");
    let modes: Vec<_> = memory
        .iter()
        .map(|path| (path, fs::metadata(path).unwrap().mode() & 0o077))
        .collect();
    assert!(modes.iter().all(|(_, others)| *others == 0), "{modes:?}");
    let services: Vec<_> = services_of(run.id()).into_iter().map(|(_, pid)| pid).collect();
    acting_as(users.other, || {
        for path in &memory {
            assert_denied("to read shared memory", File::open(path));
            assert_denied("to write shared memory", File::options().write(true).open(path));
            assert!(fs::remove_file(path).is_err(), "to remove shared memory");
        }
        assert_denied("to list the runs", fs::read_dir(users.folder()));
        assert_denied("to hold the lock", File::open(users.folder().join("door")));
        assert_denied(
            "to read the configuration",
            File::open(place.join("iceoryx2.toml")),
        );
        assert_denied("to ask the orchestrator", socket_to(&place.join(SOCKET)));
        assert!(
            fs::rename(users.folder(), users.path("other/stolen")).is_err(),
            "to take its place"
        );
        for &pid in &services {
            assert_denied(
                "to open the shared page",
                File::open(format!("/proc/{pid}/fd/{SHARED_PAGE_FD}")),
            );
            assert_denied("to read the memory", File::open(format!("/proc/{pid}/mem")));
            let killed = kill_process(Pid::from_raw(pid.cast_signed()).unwrap(), Signal::KILL);
            assert_denied("to kill a service", killed.map_err(io::Error::from));
        }
    });
    // What is made for a service that is started again is closed as well.
    let before = await_process(run.id(), ServiceId::Controller);
    signal(before, Signal::KILL);
    let successor = await_successor(run.id(), ServiceId::Controller, before);
    let is_closed = |path: &PathBuf| fs::metadata(path).map_or(true, |found| found.mode() & 0o077 == 0);
    assert!(shared_memory_of(run.id()).iter().all(is_closed));
    acting_as(users.other, || {
        assert_denied(
            "to open its page",
            File::open(format!("/proc/{successor}/fd/{SHARED_PAGE_FD}")),
        );
    });
    users.end(run);
}

#[test]
fn the_commands_of_another_user_name_the_owner_and_what_to_type_and_do_nothing() {
    let Some(users) = Users::of(2) else { return };
    let run = users.take_off();
    let name = format!("{}-0", run.id());
    for command in ["kill", "arm", "disarm", "stop", "attach", "get"] {
        for arguments in [&[command][..], &[command, "--run", &name]] {
            let refused = output(&mut users.gerono(users.other, arguments));
            assert_eq!(refused.status.code(), Some(1));
            let said = complaint(&refused);
            let typed = format!("`sudo -u '#{}' gerono {command} --run {name}`", users.owner);
            assert!(said.contains(&typed), "no {typed} in: {said}");
        }
    }
    assert_eq!(users.look(users.other), None);
    // As root the same works, but for what would leave files of root's in the owner's run.
    assert!(users.look(0).is_some());
    let refused = output(&mut users.gerono(0, &["attach"]));
    assert!(complaint(&refused).contains("sudo -u"), "{}", said(&refused));
    users.end(run);
}

#[test]
fn root_finds_and_kills_the_run_of_a_user() {
    let Some(users) = Users::of(3) else { return };
    let run = users.take_off();
    let name = format!("{}-0", run.id());
    // Both processes are of one login where the system keeps it, and then of one person.
    let login = fs::read_to_string("/proc/self/loginuid").unwrap_or_default();
    if login.trim().parse().unwrap_or(u32::MAX) == u32::MAX {
        // What turns motors asks whose run is meant; nothing confirms it here.
        let refused = output(&mut users.gerono(0, &["arm"]));
        let text = complaint(&refused);
        assert_eq!(refused.status.code(), Some(1), "{text}");
        for words in [
            format!("run {name}, "),
            format!("started by #{}", users.owner),
            format!("--run {name}"),
        ] {
            assert!(text.contains(&words), "no {words:?} in {text}");
        }
    }
    let refused = output(&mut users.gerono(0, &["arm", "--run", &name]));
    assert_eq!(
        refused.status.code(),
        Some(7),
        "the run itself refuses: {}",
        said(&refused)
    );
    let killed = said(&succeed(&mut users.gerono(0, &["kill"])));
    assert!(killed.contains(&format!("killed run {name}, ")), "{killed}");
    assert!(users.look(users.owner).unwrap().killed);
    signal(run.id(), Signal::STOP);
    let killed = said(&succeed(&mut users.gerono(0, &["kill"])));
    assert!(killed.contains("services directly"), "{killed}");
    signal(run.id(), Signal::CONT);
    signal(run.id(), Signal::INT);
    assert_eq!(finish(run).status.code(), Some(130));
}

#[test]
fn a_socket_that_its_owner_has_opened_to_all_obeys_its_owner_alone() {
    let Some(users) = Users::of(4) else { return };
    let run = users.take_off();
    let place = users.folder().join(format!("{}-0", run.id()));
    for path in [users.folder(), place.clone()] {
        open_to(&path, 0o755);
    }
    open_to(&place.join(SOCKET), 0o666);
    acting_as(users.other, || {
        let socket = socket_to(&place.join(SOCKET)).unwrap();
        socket.send(&Question::Operate(Request::Kill)).unwrap();
        let answer = socket.receive::<Answer>().unwrap();
        let Answer::Refused(reason) = answer else {
            panic!("{answer:?}");
        };
        assert!(reason.contains(&users.other.to_string()), "{reason}");
        assert!(socket.receive::<Answer>().is_err(), "the connection is closed");
    });
    users.end(run);
}

/// A process with the command line of a service, of a user's, which ends with its input.
fn pretender(users: &Users, user: u32, folder: &Path) -> Begun {
    let scripts = users.path("pretender");
    fs::create_dir_all(&scripts).unwrap();
    open_to(&scripts, 0o755);
    fs::write(scripts.join("service"), "read line").unwrap();
    let mut command = Command::new("sh");
    command
        .args([
            "service",
            "plant",
            "--run",
            folder.to_str().unwrap(),
            "--host",
            "realtime",
        ])
        .current_dir(scripts)
        .uid(user)
        .gid(user)
        .stdin(Stdio::piped());
    let pretender = begin(&mut command);
    // The system has its command line a moment after it has begun.
    let line = format!("/proc/{}/cmdline", pretender.id());
    until("the command line of a service", || {
        fs::read(&line)
            .ok()
            .filter(|line| line.starts_with(b"sh\0service\0"))
    });
    pretender
}

#[test]
fn a_process_that_pretends_to_be_a_run_takes_nobodys_commands() {
    let Some(users) = Users::of(5) else { return };
    let run = users.take_off();
    // In the folder of the owner's runs, where the other one cannot make anything.
    let claimed = users.folder().join("1-0");
    let pretended = pretender(&users, users.other, &claimed);
    let of_the_run = users.folder().join(format!("{}-0", run.id()));
    let impostor = pretender(&users, users.other, &of_the_run);
    assert!(
        users.look(users.owner).is_some(),
        "the owner's commands mean the owner's run"
    );
    // Root is asked which: by name and owner.
    let asked = output(&mut users.gerono(0, &["kill"]));
    let said_to_root = complaint(&asked);
    assert_eq!(asked.status.code(), Some(1));
    for owner in [users.owner, users.other] {
        assert!(said_to_root.contains(&format!("of #{owner}")), "{said_to_root}");
    }
    // Named, it is found out: the folder is not its owner's, and it shares no page.
    let refused = output(&mut users.gerono(0, &["kill", "--run", &pretended.id().to_string()]));
    assert_eq!(refused.status.code(), Some(1));
    assert!(complaint(&refused).contains("NOT killed"), "{}", said(&refused));
    let refused = output(&mut users.gerono(0, &["stop", "--run", &impostor.id().to_string()]));
    assert!(
        complaint(&refused).contains("belongs to another user"),
        "{}",
        said(&refused)
    );
    drop((pretended, impostor));
    users.end(run);
}

#[test]
fn links_in_a_folder_of_another_users_lead_no_result_astray() {
    let Some(users) = Users::of(6) else { return };
    let precious = users.path("owner/precious");
    fs::write(&precious, "content").unwrap();
    chown(&precious, Some(users.owner), None).unwrap();
    // The folder looks empty, until its owner fills it with links, again and again.
    let folder = users.path("other/results");
    acting_as(users.other, || {
        fs::create_dir(&folder).unwrap();
        open_to(&folder, 0o777);
    });
    let hover = users.path("hover.toml");
    let out = folder.to_str().unwrap();
    let arguments = [
        "run",
        hover.to_str().unwrap(),
        "--quiet",
        "--set",
        "duration=0.5",
        "--out",
        out,
    ];
    let mut run = begin(&mut users.gerono(users.owner, &arguments));
    let names = [
        "run.mcap",
        "run.mcap.partial",
        "host.mcap",
        "host.mcap.partial",
        "summary.json",
        "summary.json.partial",
    ];
    let planted = acting_as(users.other, || {
        let mut planted = 0;
        while run.try_wait().unwrap().is_none() {
            // Before the first result is there a link would only be refused.
            if fs::read_dir(&folder).unwrap().next().is_none() {
                continue;
            }
            for path in names.map(|name| folder.join(name)) {
                if !path.is_symlink() {
                    let _ = fs::remove_file(&path);
                    planted += u32::from(symlink(&precious, path).is_ok());
                }
            }
        }
        planted
    });
    assert!(planted >= names.len() as u32, "{planted} links");
    // Whatever became of the flight, whose results are in the hands of another: this is as it was.
    finish(run);
    assert_eq!(fs::read_to_string(precious).unwrap(), "content");
}
