//! A thread that waits for a press of the kill switch.
//!
//! The thread carries out the kill itself, so that the kill does not wait for the thread that records and supervises.
//! The latter polls [`Watch::events`] and does everything else that follows from a press or a loss.

use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Instant;

use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};
use scenario::OperatorDevices;

use super::device::{Device, DeviceError};

/// Pause between two attempts to open a lost device.
const RETRY: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 250_000_000,
};

/// State change of the kill switch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SwitchEvent {
    /// The switch was pressed: the signal as text, and a time just before the kill. Reported once.
    Pressed(String, Instant),
    /// The device was lost: the reason.
    Lost(String),
    /// The device was opened again.
    Reopened,
}

/// Handle of the thread; dropping it ends the thread.
#[derive(Debug)]
pub struct Watch {
    events: Receiver<SwitchEvent>,
    stop: Arc<OwnedFd>,
    thread: Option<JoinHandle<()>>,
}

/// State of the thread.
struct Watcher<F> {
    path: PathBuf,
    baud: u32,
    key: Option<u32>,
    stop: Arc<OwnedFd>,
    events: Sender<SwitchEvent>,
    is_pressed: bool,
    press: F,
}

/// Opens the kill switch of a scenario.
///
/// # Errors
/// [`DeviceError`], with the fix.
pub fn open(stated: &OperatorDevices) -> Result<Device, DeviceError> {
    Device::open(Path::new(&stated.kill_device), stated.kill_baud)
}

impl Watch {
    /// Starts the thread. The first press calls `press` on it; without a device, the thread opens it first.
    ///
    /// # Errors
    /// If no thread or file descriptor is available.
    pub fn start(
        stated: &OperatorDevices,
        device: Option<Device>,
        press: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let stop = Arc::new(eventfd(0, EventfdFlags::CLOEXEC)?);
        let (sender, events) = channel();
        let watcher = Watcher {
            path: PathBuf::from(&stated.kill_device),
            baud: stated.kill_baud,
            key: stated.kill_key,
            stop: Arc::clone(&stop),
            events: sender,
            is_pressed: false,
            press,
        };
        let thread = std::thread::Builder::new()
            .name("kill switch".to_owned())
            .spawn(move || watcher.watch(device))?;
        Ok(Self {
            events,
            stop,
            thread: Some(thread),
        })
    }

    /// Returns the changes since the last call.
    pub fn events(&self) -> impl Iterator<Item = SwitchEvent> + '_ {
        self.events.try_iter()
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        // Eight bytes always fit into an eventfd that was not written before.
        let _ = rustix::io::write(&*self.stop, &1_u64.to_ne_bytes());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl<F: Fn()> Watcher<F> {
    fn watch(mut self, mut device: Option<Device>) {
        while !self.is_stopped(&Timespec::default()) {
            let Some(open) = &mut device else {
                device = self.reopen();
                continue;
            };
            let stop = Arc::clone(&self.stop);
            let taken = self.take(open).and_then(|()| open.wait(Some(stop.as_fd()), None));
            if let Err(error) = taken {
                device = None;
                self.send(SwitchEvent::Lost(error.to_string()));
            }
        }
    }

    /// Reads the device; the first press kills.
    fn take(&mut self, device: &mut Device) -> Result<(), DeviceError> {
        let mut pressed = None;
        let read = device.read(|signal| {
            if signal.is_press(self.key) {
                pressed.get_or_insert(signal);
            }
        });
        if let Some(signal) = pressed.filter(|_| !self.is_pressed) {
            let before = Instant::now();
            (self.press)();
            self.is_pressed = true;
            self.send(SwitchEvent::Pressed(signal.to_string(), before));
        }
        read
    }

    /// Tries to reopen the device, after a pause.
    fn reopen(&mut self) -> Option<Device> {
        if self.is_stopped(&RETRY) {
            return None;
        }
        let device = Device::open(&self.path, self.baud).ok()?;
        self.send(SwitchEvent::Reopened);
        Some(device)
    }

    /// Waits up to `timeout` for the end of the watch. Returns whether it was requested.
    fn is_stopped(&self, timeout: &Timespec) -> bool {
        let mut stop = [PollFd::new(&*self.stop, PollFlags::IN)];
        poll(&mut stop, Some(timeout)).is_ok_and(|count| count > 0)
    }

    fn send(&self, event: SwitchEvent) {
        // The receiver is gone only while the thread is being ended.
        let _ = self.events.send(event);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::time::Duration;

    use rustix::fs::{CWD, Mode, OFlags};

    use super::*;
    use crate::kill_switch::signal::InputEvent;

    /// Longest wait for events: a hang becomes a failure.
    const WATCHDOG: Duration = Duration::from_secs(30);

    #[test]
    fn the_first_press_of_the_key_kills_and_a_lost_device_is_found_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("switch");
        rustix::fs::mkfifoat(CWD, &path, Mode::RUSR | Mode::WUSR).unwrap();
        let writer = || rustix::fs::open(&path, OFlags::RDWR | OFlags::CLOEXEC, Mode::empty()).unwrap();
        let send = |writer: &OwnedFd, code| {
            rustix::io::write(writer, &InputEvent::press(code).to_bytes()).unwrap();
        };
        let stated = OperatorDevices {
            kill_key: Some(57),
            ..OperatorDevices::new(path.to_str().unwrap())
        };
        let presses = Arc::new(AtomicU32::new(0));
        let count = Arc::clone(&presses);
        let held = writer();
        let device = open(&stated).unwrap();
        let watch = Watch::start(&stated, Some(device), move || {
            count.fetch_add(1, Ordering::Relaxed);
        });
        let watch = watch.unwrap();
        let next = || watch.events.recv_timeout(WATCHDOG).unwrap();

        send(&held, 28);
        drop(held);
        assert!(matches!(next(), SwitchEvent::Lost(reason) if reason.contains("is gone")));
        assert_eq!(presses.load(Ordering::Relaxed), 0);
        let held = writer();
        assert_eq!(next(), SwitchEvent::Reopened);
        for code in [57, 57, 57] {
            send(&held, code);
        }
        assert!(matches!(next(), SwitchEvent::Pressed(signal, _) if signal == "key 57 (SPACE) pressed"));
        drop(held);
        assert!(matches!(next(), SwitchEvent::Lost(_)));
        assert_eq!(presses.load(Ordering::Relaxed), 1);
        drop(watch);
    }
}
