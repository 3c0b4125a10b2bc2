//! A kill switch stops the motors of a flight in real time, and its loss is handled as the scenario says.
//!
//! The device is a named pipe that sends the events of an input device, or a pseudo-terminal.

use std::io::{BufRead, BufReader, Read};
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::process::Command;

use run_log::LogReader;
use rustix::fs::{CWD, Mode, OFlags, mkfifoat};
use rustix::process::Signal;
use shared_types::samples::RunEvent;
use supervisor::kill_switch::signal::InputEvent;

use crate::common::laboratory::serial_line;
use crate::common::pilot::{ask, await_phase, flight_on_the_ground, may_arm, take_off_from_the_ground};
use crate::common::processes::signal;
use crate::common::{Begun, Place, begin, complaint, finish, output, said, succeed, until};

/// KEY_SPACE and KEY_ENTER.
const SPACE: u16 = 57;
const ENTER: u16 = 28;

/// An input device: a named pipe, which is there while something holds its other end.
struct Switch {
    path: PathBuf,
    end: Option<OwnedFd>,
}

impl Switch {
    fn new(place: &Place) -> Self {
        let path = place.path("switch");
        mkfifoat(CWD, &path, Mode::RUSR | Mode::WUSR).unwrap();
        let mut switch = Self { path, end: None };
        switch.plug_in();
        switch
    }

    fn plug_in(&mut self) {
        let flags = OFlags::RDWR | OFlags::CLOEXEC;
        self.end = Some(rustix::fs::open(&self.path, flags, Mode::empty()).unwrap());
    }

    fn pull_out(&mut self) {
        self.end = None;
    }

    fn press(&self, key: u16) {
        let end = self.end.as_ref().unwrap();
        rustix::io::write(end, &InputEvent::press(key).to_bytes()).unwrap();
    }

    /// The scenario's section, of which the space bar kills.
    fn section(&self, on_loss: &str) -> String {
        let path = self.path.display();
        format!("operator={{kill_device = \"{path}\", kill_key = {SPACE}, on_loss = \"{on_loss}\"}}")
    }
}

/// A flight with this kill switch on the ground.
fn on_the_ground(place: &Place, switch: &Switch, on_loss: &str) -> Begun {
    begin(flight_on_the_ground(place).args(["--set", &switch.section(on_loss)]))
}

/// A vehicle with a kill switch on its path.
fn in_the_air(on_loss: &str) -> (Place, Switch, Begun) {
    let place = Place::in_real_time();
    let switch = Switch::new(&place);
    let run = on_the_ground(&place, &switch, on_loss);
    take_off_from_the_ground(&place);
    (place, switch, run)
}

fn await_killed(place: &Place) {
    ask("the kill", || place.look().filter(|snapshot| snapshot.killed));
}

/// Waits until the run tells of something.
fn await_words(place: &Place, words: &str) {
    ask(words, || {
        let snapshot = place.look()?;
        let mut events = snapshot.events.into_iter();
        events.find(|event| event.text.contains(words))
    });
}

/// Waits for the end of a run that ends with this code; what its log says of the operator.
#[track_caller]
fn events_at_the_end(place: &Place, run: Begun, code: i32) -> Vec<(u32, String)> {
    let orchestrator = run.id();
    let ended = finish(run);
    assert_eq!(ended.status.code(), Some(code), "{}", said(&ended));
    place.assert_nothing_is_left_of(orchestrator);
    let log = LogReader::open(&place.log("out")).unwrap();
    let events = log.samples::<RunEvent>().map(Result::unwrap);
    events
        .filter(|event| event.kind >= RunEvent::KIND_OPERATOR_LANDS)
        .map(|event| (event.kind, event.words().into_owned()))
        .collect()
}

/// Ends a run by Ctrl-C.
#[track_caller]
fn events_after_the_end(place: &Place, run: Begun) -> Vec<(u32, String)> {
    signal(run.id(), Signal::INT);
    events_at_the_end(place, run, 130)
}

#[test]
fn the_key_stops_the_motors_in_the_air_and_no_other_key_does() {
    let (place, switch, run) = in_the_air("land");
    switch.press(ENTER);
    await_phase(&place, "fly");
    assert!(!place.look().unwrap().killed);
    switch.press(SPACE);
    await_killed(&place);
    let killed_by = ask("what killed", || {
        place.look()?.killed_by.filter(|by| by.contains("SPACE"))
    });
    assert!(
        killed_by.starts_with("kill switch: key 57 (SPACE) pressed"),
        "{killed_by}"
    );
    await_phase(&place, "disarmed");
    let events = events_after_the_end(&place, run);
    let words = format!("kill switch: key 57 (SPACE) pressed, {}", switch.path.display());
    let killed = (RunEvent::KIND_OPERATOR_KILLS, words);
    assert_eq!(events.first(), Some(&killed), "{events:?}");
    let replayed = said(&succeed(&mut place.gerono(&["replay", "out"])));
    assert!(replayed.contains("identical: "), "{replayed}");
}

#[test]
fn a_loss_that_is_ignored_is_told_and_the_switch_kills_when_it_is_back() {
    let (place, mut switch, run) = in_the_air("ignore");
    switch.pull_out();
    await_words(&place, "continues without its kill switch");
    let snapshot = place.look().unwrap();
    assert_eq!((snapshot.phase.as_deref(), snapshot.killed), (Some("fly"), false));
    switch.plug_in();
    await_words(&place, "is connected again");
    switch.press(SPACE);
    await_killed(&place);
    let kinds: Vec<_> = events_after_the_end(&place, run)
        .into_iter()
        .map(|(kind, _)| kind)
        .collect();
    let lost = RunEvent::KIND_KILL_SWITCH;
    assert_eq!(kinds[..3], [lost, lost, RunEvent::KIND_OPERATOR_KILLS]);
}

#[test]
fn a_loss_lands_the_vehicle_and_ends_the_run() {
    let (place, mut switch, run) = in_the_air("land");
    switch.pull_out();
    await_phase(&place, "land");
    await_phase(&place, "disarmed");
    let lost = format!("kill switch lost: {}", switch.path.display());
    assert_eq!(
        events_at_the_end(&place, run, 0),
        [
            (RunEvent::KIND_KILL_SWITCH, lost.clone()),
            (RunEvent::KIND_OPERATOR_LANDS, lost)
        ]
    );
}

#[test]
fn a_loss_kills_if_the_scenario_says_so() {
    let (place, mut switch, run) = in_the_air("kill");
    switch.pull_out();
    await_killed(&place);
    let lost = format!("kill switch lost: {}", switch.path.display());
    let events = events_after_the_end(&place, run);
    assert!(
        events.contains(&(RunEvent::KIND_OPERATOR_KILLS, lost)),
        "{events:?}"
    );
}

#[test]
fn without_its_kill_switch_no_flight_begins_and_nobody_arms() {
    let place = Place::in_real_time();
    let mut switch = Switch::new(&place);
    switch.pull_out();
    let refused = output(flight_on_the_ground(&place).args(["--set", &switch.section("land")]));
    assert_eq!(refused.status.code(), Some(1), "{}", said(&refused));
    let reason = complaint(&refused);
    assert!(
        reason.contains("operator.kill_device: ") && reason.contains("plug it in again"),
        "{reason}"
    );
    assert_eq!(place.leftovers(), Vec::<String>::new());
    assert!(!place.path("out").exists(), "the same command may be given again");

    switch.plug_in();
    let run = on_the_ground(&place, &switch, "kill");
    until("the run", || place.look());
    switch.pull_out();
    await_words(&place, "the kill switch is lost");
    let arm = || output(&mut place.gerono(&["arm"]));
    let refused = arm();
    assert_eq!(refused.status.code(), Some(7), "{}", said(&refused));
    assert!(
        said(&refused).contains("not armed: the kill switch is lost"),
        "{}",
        said(&refused)
    );
    let shown = place.look().unwrap().refusal_to_arm.unwrap();
    assert!(shown.starts_with("the kill switch is lost"), "{shown}");
    switch.plug_in();
    await_words(&place, "is connected again");
    ask("the arming", || may_arm(&place).then_some(()));
    assert_eq!(place.look().unwrap().refusal_to_arm, None);
    assert!(!place.look().unwrap().killed, "on the ground no loss kills");
    events_after_the_end(&place, run);
}

#[test]
fn a_byte_of_a_serial_button_kills_and_its_hang_up_ends_a_flight_that_cannot_land() {
    for presses in [true, false] {
        let place = Place::in_real_time();
        let (button, device) = serial_line();
        let section = format!("operator={{kill_device = \"{device}\"}}");
        let run = begin(&mut place.live_hover("out", &["--set", &section]));
        // Not before the first tick, in which case nothing is logged.
        ask("the flight", || {
            place.look().filter(|snapshot| snapshot.time > 0.5)
        });
        let kind = if presses {
            rustix::io::write(&button, b"k").unwrap();
            await_killed(&place);
            signal(run.id(), Signal::INT);
            (RunEvent::KIND_OPERATOR_KILLS, 130)
        } else {
            drop(button);
            (RunEvent::KIND_KILL_SWITCH, 0)
        };
        let events = events_at_the_end(&place, run, kind.1);
        let (first, words) = events.first().unwrap();
        assert_eq!(*first, kind.0, "{events:?}");
        assert!(words.contains(&device), "{words}");
        assert!(!presses || words.contains("byte 107 ('k')"), "{words}");
    }
}

/// Presses the button of `gerono operator probe` and returns its line of the press.
fn probed(command: &mut Command, press: impl FnOnce()) -> String {
    let mut run = begin(command);
    let mut lines = BufReader::new(run.stdout.take().unwrap());
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    assert!(line.contains("press the button"), "{line}");
    press();
    line.clear();
    lines.read_line(&mut line).unwrap();
    signal(run.id(), Signal::INT);
    let mut rest = String::new();
    lines.read_to_string(&mut rest).unwrap();
    assert_eq!(finish(run).status.code(), Some(130));
    line
}

#[test]
fn a_probe_prints_what_a_device_sends_and_refuses_what_is_none() {
    let place = Place::in_real_time();
    let switch = Switch::new(&place);
    let path = switch.path.to_str().unwrap();
    let shown = probed(&mut place.gerono(&["operator", "probe", path]), || {
        switch.press(SPACE);
    });
    assert_eq!(shown, "key 57 (SPACE) pressed; kill_key = 57\n");
    let (button, device) = serial_line();
    let shown = probed(&mut place.gerono(&["operator", "probe", &device]), || {
        rustix::io::write(&button, b"k").unwrap();
    });
    assert_eq!(shown, "byte 107 ('k'); kill_key = 107\n");
    for (device, next) in [
        ("none", "is it plugged in?"),
        (".", "ls /dev/input/by-id"),
        ("/dev/null", "is not a serial device"),
    ] {
        let refused = output(&mut place.gerono(&["operator", "probe", device]));
        assert_eq!(refused.status.code(), Some(1));
        assert!(complaint(&refused).contains(next), "{}", said(&refused));
    }
}

#[test]
fn an_input_device_of_the_kernel_kills_and_its_loss_is_noticed() {
    let Some(keyboard) = uinput::Keyboard::create(&[SPACE, ENTER]) else {
        eprintln!("SKIPPED: this machine has no /dev/uinput that may be used");
        return;
    };
    let place = Place::in_real_time();
    let path = until("the device", || keyboard.path().filter(|path| path.exists()));
    let path = path.to_str().unwrap();
    keyboard.send(ENTER, 1);
    // The key is down when the device is opened.
    let shown = probed(&mut place.gerono(&["operator", "probe", path]), || {});
    assert_eq!(shown, "key 28 (ENTER) pressed; kill_key = 28\n");
    keyboard.send(ENTER, 0);
    let section = format!("operator={{kill_device = \"{path}\", kill_key = {SPACE}, on_loss = \"ignore\"}}");
    let run = begin(&mut place.live_hover("out", &["--set", &section]));
    until("the run", || place.look());
    keyboard.send(SPACE, 1);
    await_killed(&place);
    drop(keyboard);
    await_words(&place, "the kill switch is lost");
    events_after_the_end(&place, run);
}

/// Input devices that the kernel makes for a program, as its uinput.h says.
mod uinput {
    #![expect(unsafe_code, reason = "requests to the system that rustix does not know")]

    use std::ffi::c_int;
    use std::os::fd::OwnedFd;
    use std::path::{Path, PathBuf};

    use rustix::fs::{Mode, OFlags};
    use rustix::ioctl::{Getter, IntegerSetter, NoArg, Opcode, Setter, ioctl, opcode};
    use supervisor::kill_switch::signal::InputEvent;

    use crate::common::until;

    const CREATE: Opcode = opcode::none(b'U', 1);
    const SET_UP: Opcode = opcode::write::<Setup>(b'U', 3);
    const ENABLE_TYPE: Opcode = opcode::write::<c_int>(b'U', 100);
    const ENABLE_KEY: Opcode = opcode::write::<c_int>(b'U', 101);
    const NAME: Opcode = opcode::read::<[u8; 64]>(b'U', 44);

    /// EV_KEY.
    const KEYS: usize = 1;

    /// `struct uinput_setup`.
    #[repr(C)]
    struct Setup {
        bus_vendor_product_version: [u16; 4],
        name: [u8; 80],
        force_feedback_effects: u32,
    }

    /// A keyboard, which is there as long as this.
    pub(super) struct Keyboard(OwnedFd);

    impl Keyboard {
        /// Makes a keyboard with these keys; `None` where the machine has no uinput or does not permit it.
        pub(super) fn create(keys: &[u16]) -> Option<Self> {
            let flags = OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC;
            let file = rustix::fs::open("/dev/uinput", flags, Mode::empty()).ok()?;
            let mut setup = Setup {
                bus_vendor_product_version: [0x06, 0x1234, 0x5678, 1],
                name: [0; 80],
                force_feedback_effects: 0,
            };
            setup.name[..6].copy_from_slice(b"gerono");
            // SAFETY: each request takes a number, or reads the structure that its number gives the size of.
            unsafe {
                ioctl(&file, IntegerSetter::<ENABLE_TYPE>::new_usize(KEYS)).unwrap();
                for &key in keys {
                    ioctl(&file, IntegerSetter::<ENABLE_KEY>::new_usize(usize::from(key))).unwrap();
                }
                ioctl(&file, Setter::<SET_UP, Setup>::new(setup)).unwrap();
                ioctl(&file, NoArg::<CREATE>::new()).unwrap();
            }
            Some(Self(file))
        }

        /// Path of the device, once the kernel has made it.
        pub(super) fn path(&self) -> Option<PathBuf> {
            // SAFETY: the request writes as many bytes as its number says, to the place that `Getter` gives it.
            let name = unsafe { ioctl(&self.0, Getter::<NAME, [u8; 64]>::new()) }.ok()?;
            let name = std::ffi::CStr::from_bytes_until_nul(&name).ok()?.to_str().ok()?;
            let folder = Path::new("/sys/devices/virtual/input").join(name);
            let entries = std::fs::read_dir(folder).ok()?.flatten();
            let mut names = entries.map(|entry| entry.file_name());
            let event = names.find(|name| name.to_string_lossy().starts_with("event"))?;
            Some(Path::new("/dev/input").join(event))
        }

        /// Presses (1) or releases (0) a key.
        pub(super) fn send(&self, key: u16, value: i32) {
            let press = InputEvent {
                value,
                ..InputEvent::press(key)
            };
            let report = InputEvent {
                kind: 0,
                code: 0,
                value: 0,
            };
            let bytes = [press, report].map(InputEvent::to_bytes).concat();
            until("room for the events", || rustix::io::write(&self.0, &bytes).ok());
        }
    }
}
