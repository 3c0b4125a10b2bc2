//! Parts that the tests of real processes share: isolation, a watchdog, and the search for leftovers.
#![allow(dead_code, reason = "every test target uses a part of it")]

pub(crate) mod container;
pub(crate) mod laboratory;
pub(crate) mod logs;
pub(crate) mod pilot;
pub(crate) mod ports;
pub(crate) mod processes;
mod rig;
pub(crate) mod share;
pub(crate) mod terminal;
pub(crate) mod world;

use std::ops::{Deref, DerefMut};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

use command_line::exit::Exit;
use run_client::Snapshot;
use run_client::runs::SCOPE;
use runtime::crash::CrashPlace;
use shared_types::ServiceId;
use tempfile::TempDir;

pub(crate) use rig::ALL_OF_THE_RIG;
use share::{Load, Share};

/// No command of a test may take longer; a hang becomes a failure.
const WATCHDOG: Duration = Duration::from_secs(120);

/// Services whose orchestrator was killed are waited for so long before what they leave is left.
const SWEEPING: Duration = Duration::from_secs(20);

/// Arguments of `gerono` for a hover in real time, of this scenario, for longer than any test lasts.
pub(crate) fn hover_arguments<'a>(hover: &'a str, out: &'a str) -> [&'a str; 8] {
    let duration = "duration=300.0";
    [
        "run", hover, "--host", "realtime", "--out", out, "--set", duration,
    ]
}

/// The committed scenario of a name.
pub(crate) fn scenario(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../scenarios")
        .join(format!("{name}.toml"))
}

/// A place of its own for a test's runs: results, temporary files, and so the runs' shared memory.
pub(crate) struct Place {
    folder: TempDir,
    /// Given back when all else is swept up.
    _share: Share,
}

impl Place {
    /// A place for flights that need a core.
    pub(crate) fn new() -> Self {
        Self::with_share(Load::Core)
    }

    /// A place for flights in real time, which need half a core.
    pub(crate) fn in_real_time() -> Self {
        Self::with_share(Load::InRealTime)
    }

    fn with_share(load: Load) -> Self {
        let share = Share::take(load);
        let folder = tempfile::tempdir().unwrap();
        // Closed to other users, as such a folder must be.
        std::fs::DirBuilder::new()
            .mode(0o700)
            .create(folder.path().join("tmp"))
            .unwrap();
        Self {
            folder,
            _share: share,
        }
    }

    /// Lets it outlive the test, so that what went wrong can be looked at.
    pub(crate) fn keep(&mut self) -> &Path {
        self.folder.disable_cleanup(true);
        self.folder.path()
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `gerono` with these arguments.
    pub(crate) fn gerono(&self, arguments: &[&str]) -> Command {
        self.program(env!("CARGO_BIN_EXE_gerono"), arguments)
    }

    /// A program of Gerono that works in this folder.
    pub(crate) fn program(&self, program: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(program);
        command
            .args(arguments)
            .current_dir(self.folder.path())
            .env("XDG_RUNTIME_DIR", self.folder.path().join("tmp"))
            // Neither the runs of others nor those of other tests are found.
            .env(SCOPE, self.folder.path())
            .stdin(Stdio::null());
        command
    }

    /// `gerono run` of Fig. 1's beginning, to the folder `out`.
    pub(crate) fn short_flight(&self, out: &str, seconds: f64, more: &[&str]) -> Command {
        let fig1 = scenario("fig1");
        let duration = format!("duration={seconds:?}");
        let mut arguments = vec!["run", fig1.to_str().unwrap(), "--out", out, "--set", &duration];
        arguments.extend(["--set", "vehicle.change=[]"]);
        arguments.extend(more);
        self.gerono(&arguments)
    }

    /// `gerono run` of a flight in which everything happens that the rig knows, to the folder `out`.
    pub(crate) fn rig_flight(&self, out: &str, seconds: f64, more: &[&str]) -> Command {
        let fig3_6 = scenario("fig3_6");
        let duration = format!("duration={seconds:?}");
        let mut arguments = vec!["run", fig3_6.to_str().unwrap(), "--out", out, "--set", &duration];
        arguments.extend(ALL_OF_THE_RIG.iter().flat_map(|setting| ["--set", setting]));
        arguments.extend(more);
        self.gerono(&arguments)
    }

    /// `gerono run` of a committed scenario in real time with these settings, to the folder `out`.
    pub(crate) fn live_flight(&self, name: &str, out: &str, settings: &[impl AsRef<str>]) -> Command {
        let stated = scenario(name);
        let mut arguments = vec![
            "run",
            stated.to_str().unwrap(),
            "--host",
            "realtime",
            "--out",
            out,
        ];
        arguments.extend(settings.iter().flat_map(|setting| ["--set", setting.as_ref()]));
        self.gerono(&arguments)
    }

    /// `gerono run` of a hover in real time for longer than any test lasts, to the folder `out`.
    pub(crate) fn live_hover(&self, out: &str, more: &[&str]) -> Command {
        let hover = scenario("hover");
        let mut command = self.gerono(&hover_arguments(hover.to_str().unwrap(), out));
        command.args(more);
        command
    }

    /// `gerono run` in real time of such a flight, to the folder `out`, in which every service dies at every place of a step;
    /// and the number of deaths. The laboratory's vehicle holds its rates by itself while nobody commands.
    pub(crate) fn flight_with_deaths_everywhere(&self, out: &str) -> (Command, usize) {
        let places = CrashPlace::ALL
            .into_iter()
            .filter(|&place| place >= CrashPlace::BeforeStep);
        let deaths: Vec<_> = places
            .enumerate()
            .flat_map(|(life, place)| {
                ServiceId::ALL.map(|service| {
                    let tick = 200 + 400 * life + 60 * service.index();
                    format!("{service}@{tick}:{}", place.name())
                })
            })
            .collect();
        let mut command = self.rig_flight(out, 3.0, &["--host", "realtime"]);
        command.args(deaths.iter().flat_map(|death| ["--crash", death]));
        (command, deaths.len())
    }

    /// The log of a flight to the folder `out`.
    pub(crate) fn log(&self, out: &str) -> PathBuf {
        self.path(out).join("run.mcap")
    }

    /// The summary of a flight to the folder `out`.
    pub(crate) fn summary(&self, out: &str) -> serde_json::Value {
        let text = std::fs::read_to_string(self.path(out).join("summary.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    }

    /// Returns the state of the only live run, if there is one.
    pub(crate) fn look(&self) -> Option<Snapshot> {
        let looked = self.gerono(&["top", "--once", "--json"]).output().unwrap();
        serde_json::from_slice(&looked.stdout).ok()
    }

    /// Returns how many bytes of the log of a flight to the folder `out`, which goes on, are on the disk.
    pub(crate) fn log_bytes(&self, out: &str) -> u64 {
        let log = self.path(out).join("run.mcap.partial");
        std::fs::metadata(log).map_or(0, |file| file.len())
    }

    /// Waits until these are more than so many: its first chunk is written when it flies.
    pub(crate) fn await_log(&self, out: &str, bytes: u64) {
        until("a part of the log", || {
            (self.log_bytes(out) > bytes).then_some(())
        });
    }

    /// Everything that runs of this place have left behind: bookkeeping and shared memory.
    pub(crate) fn leftovers(&self) -> Vec<String> {
        let mut left = Vec::new();
        for base in entries(&self.folder.path().join("tmp")) {
            left.extend(entries(&base).into_iter().filter(|path| path.is_dir()));
        }
        left.into_iter().map(|path| path.display().to_string()).collect()
    }

    /// Nothing is left of a run of this place, and no process either.
    #[track_caller]
    pub(crate) fn assert_nothing_is_left_of(&self, orchestrator: u32) {
        assert_eq!(self.leftovers(), Vec::<String>::new());
        assert_eq!(processes::shared_memory_of(orchestrator), Vec::<PathBuf>::new());
        assert_eq!(processes::processes_of(orchestrator), Vec::new());
    }
}

impl Drop for Place {
    /// Sweeps up behind an orchestrator that was killed: once the folder is gone, nobody knows whose the shared memory was.
    fn drop(&mut self) {
        let deadline = Instant::now() + SWEEPING;
        while !self.leftovers().is_empty() && Instant::now() < deadline {
            let _ = self.gerono(&["clean"]).output();
        }
    }
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .collect()
}

/// Waits for a child, but not for ever.
pub(crate) fn wait(child: &mut Child) -> ExitStatus {
    let deadline = Instant::now() + WATCHDOG;
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        if Instant::now() > deadline {
            let _ = child.kill();
            let _ = child.wait();
            panic!("the watchdog ended a command that hung");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A command under way. A test that gives it up, because it fails, does not leave it behind, nor what it has started, even
/// if some of that was stopped.
pub(crate) struct Begun(Child);

impl From<Child> for Begun {
    fn from(child: Child) -> Self {
        Self(child)
    }
}

impl Deref for Begun {
    type Target = Child;

    fn deref(&self) -> &Child {
        &self.0
    }
}

impl DerefMut for Begun {
    fn deref_mut(&mut self) -> &mut Child {
        &mut self.0
    }
}

impl Drop for Begun {
    fn drop(&mut self) {
        // Both fail for a command that has ended only.
        let _ = self.0.kill();
        let _ = self.0.wait();
        // A test that fails shows what the command complained of.
        if let Some(mut pipe) = self.0.stderr.take().filter(|_| std::thread::panicking()) {
            let mut complaint = Vec::new();
            let _ = std::io::Read::read_to_end(&mut pipe, &mut complaint);
            eprintln!("the command said:\n{}", String::from_utf8_lossy(&complaint));
        }
    }
}

/// Begins a command whose output is kept.
pub(crate) fn begin(command: &mut Command) -> Begun {
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    Begun(child.unwrap())
}

/// Runs a command to its end under the watchdog, with its output.
pub(crate) fn output(command: &mut Command) -> Output {
    finish(begin(command))
}

/// The rest of a command under the watchdog, with its output.
pub(crate) fn finish(mut child: Begun) -> Output {
    use std::io::Read;
    let drain = |pipe: Option<Box<dyn Read + Send>>| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            if let Some(mut pipe) = pipe {
                pipe.read_to_end(&mut bytes).unwrap();
            }
            bytes
        })
    };
    let stdout = drain(child.stdout.take().map(|pipe| Box::new(pipe) as _));
    let stderr = drain(child.stderr.take().map(|pipe| Box::new(pipe) as _));
    let status = wait(&mut child);
    Output {
        status,
        stdout: stdout.join().unwrap(),
        stderr: stderr.join().unwrap(),
    }
}

/// Runs a command that must succeed.
pub(crate) fn succeed(command: &mut Command) -> Output {
    let output = output(command);
    assert!(
        output.status.success(),
        "{command:?}\n{}",
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// Runs a flight that must come to its planned end, whatever becomes of the vehicle: a machine in use may lose it.
pub(crate) fn fly_to_the_end(command: &mut Command) -> Output {
    let output = output(command);
    assert_flown_to_the_end(&output);
    output
}

/// The flight has come to its planned end, with the vehicle or without.
#[track_caller]
pub(crate) fn assert_flown_to_the_end(output: &Output) {
    assert!(Exit::is_flown(output.status.code()), "{}", said(output));
}

/// All that a command has said.
pub(crate) fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr]
        .map(|bytes| String::from_utf8_lossy(bytes))
        .concat()
}

/// Returns a command's complaint, without the line breaks and the frame that long errors get.
pub(crate) fn complaint(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).replace('│', " ");
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Polls until something is so, under the watchdog.
pub(crate) fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + WATCHDOG;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < deadline, "never came: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}
