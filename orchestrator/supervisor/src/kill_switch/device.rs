//! Devices of a kill switch: an input device (or a pipe with its events), or a serial line.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use radio_link::port::{ByteFormat, OpenError, serial};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FileType, Mode, OFlags, major, open};
use rustix::io::Errno;

use super::signal::{EVENT_SIZE, InputEvent, Signal};

/// Major number of input devices: INPUT_MAJOR of the kernel's major.h.
const INPUT: u32 = 13;

/// Size of one read, bytes.
const PIECE: usize = 64 * EVENT_SIZE;

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    #[error("there is no device {}; is it plugged in? `ls /dev/input/by-id /dev/serial/by-id` shows what is there", .0.display())]
    Missing(PathBuf),
    #[error(
        "you may not read the device {}; join its group (`sudo usermod -aG $(stat -Lc %G {}) $USER`, often `input`, then log in \
         again), or give it to you by a udev rule, as docs/kill_switch.md shows", .0.display(), .0.display()
    )]
    Permission(PathBuf),
    /// The path is neither an input device nor a serial device.
    #[error(
        "{} is neither an input device nor a serial device; `ls /dev/input/by-id /dev/serial/by-id` shows what is there", .0.display()
    )]
    NoDevice(PathBuf),
    /// A serial device cannot be opened or configured.
    #[error(transparent)]
    Serial(#[from] OpenError),
    /// The device was open and disappeared.
    #[error("the device {} is gone ({reason}); plug it in again", .path.display())]
    Gone {
        path: PathBuf,
        /// The system's error message.
        reason: String,
    },
    #[error("cannot use {}: {source}", .path.display())]
    Device { path: PathBuf, source: Errno },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Input,
    Serial,
}

/// Open device, shared with other programs: a keyboard still types.
#[derive(Debug)]
pub struct Device {
    path: PathBuf,
    file: OwnedFd,
    kind: Kind,
    /// Bytes that were read and do not form a whole event yet.
    bytes: Vec<u8>,
    /// Keys may be down whose press is not among the events: before the first read, or after dropped events.
    is_key_state_unknown: bool,
}

impl Device {
    /// Opens a device. `baud` applies to serial lines.
    ///
    /// # Errors
    /// [`DeviceError`], with the fix.
    pub fn open(path: &Path, baud: u32) -> Result<Self, DeviceError> {
        let refusal = |reason| refusal(path, reason);
        let status = rustix::fs::stat(path).map_err(refusal)?;
        let (file, kind) = match FileType::from_raw_mode(status.st_mode) {
            FileType::CharacterDevice if major(status.st_rdev) != INPUT => {
                (serial::open(path, baud, ByteFormat::Plain)?, Kind::Serial)
            }
            FileType::CharacterDevice | FileType::Fifo => {
                let flags = OFlags::RDONLY | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
                let file = open(path, flags, Mode::empty()).map_err(refusal)?;
                (file, Kind::Input)
            }
            _ => return Err(DeviceError::NoDevice(path.to_owned())),
        };
        let mut device = Self {
            path: path.to_owned(),
            file,
            kind,
            bytes: Vec::new(),
            is_key_state_unknown: kind == Kind::Input,
        };
        // Detects a pipe without a writer.
        device.fill()?;
        Ok(device)
    }

    /// Passes on all signals that have arrived, without waiting. Keys that are down at the first read count as pressed.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is gone, after the signals that it sent before.
    pub fn read(&mut self, mut each: impl FnMut(Signal)) -> Result<(), DeviceError> {
        let filled = self.fill();
        if self.kind == Kind::Serial {
            self.bytes.drain(..).map(Signal::Byte).for_each(each);
            return filled;
        }
        let (events, rest) = self.bytes.as_chunks::<EVENT_SIZE>();
        for event in events.iter().map(InputEvent::parse) {
            self.is_key_state_unknown |= event.has_dropped_events();
            each(Signal::Event(event));
        }
        self.bytes = rest.to_vec();
        if std::mem::take(&mut self.is_key_state_unknown) {
            for code in keys::down(self.file.as_fd()) {
                each(Signal::Event(InputEvent::press(code)));
            }
        }
        filled
    }

    /// Waits until the device or `stop` is readable, a signal arrives, or the timeout expires.
    ///
    /// # Errors
    /// [`DeviceError`] if the device cannot be polled.
    pub fn wait(&self, stop: Option<BorrowedFd<'_>>, timeout: Option<Timespec>) -> Result<(), DeviceError> {
        let own = PollFd::new(&self.file, PollFlags::IN);
        let stop = stop.map(|stop| PollFd::from_borrowed_fd(stop, PollFlags::IN));
        let mut both: Vec<_> = std::iter::once(own).chain(stop).collect();
        match poll(&mut both, timeout.as_ref()) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(reason) => Err(refusal(&self.path, reason)),
        }
    }

    /// Reads all bytes that have arrived.
    fn fill(&mut self) -> Result<(), DeviceError> {
        let mut piece = [0; PIECE];
        loop {
            match rustix::io::read(&self.file, &mut piece) {
                Ok(0) => return Err(self.gone("it has ended")),
                Ok(count) => self.bytes.extend_from_slice(&piece[..count]),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) if self.has_hung_up() => return Err(self.gone("it has hung up")),
                Err(Errno::AGAIN) => return Ok(()),
                Err(reason) => return Err(self.gone(&reason.to_string())),
            }
        }
    }

    /// Returns whether the other end has hung up, which a read without data does not report.
    fn has_hung_up(&self) -> bool {
        let mut own = [PollFd::new(&self.file, PollFlags::empty())];
        let now = Timespec::default();
        poll(&mut own, Some(&now)).is_ok() && own[0].revents().intersects(PollFlags::HUP | PollFlags::ERR)
    }

    fn gone(&self, reason: &str) -> DeviceError {
        DeviceError::Gone {
            path: self.path.clone(),
            reason: reason.to_string(),
        }
    }
}

/// Maps a system error to the error of a device.
fn refusal(path: &Path, reason: Errno) -> DeviceError {
    let path = path.to_owned();
    match reason {
        Errno::NOENT | Errno::NODEV | Errno::NXIO | Errno::NOTDIR => DeviceError::Missing(path),
        Errno::ACCESS | Errno::PERM => DeviceError::Permission(path),
        source => DeviceError::Device { path, source },
    }
}

mod keys {
    //! The keys of an input device that are down.
    #![expect(unsafe_code, reason = "an ioctl that rustix lacks")]

    use std::os::fd::BorrowedFd;

    use rustix::ioctl::{Getter, Opcode, ioctl, opcode};

    /// One bit for each key.
    type Bits = [u8; 0x300 / 8];

    /// EVIOCGKEY of the kernel's input.h.
    const STATE: Opcode = opcode::read::<Bits>(b'E', 0x18);

    /// Returns the codes of the keys that are down; none if the device does not support the request.
    pub(super) fn down(device: BorrowedFd<'_>) -> Vec<u16> {
        // SAFETY: the request writes the number of bytes encoded in it, which is the size of `Bits`, to the buffer of
        // `Getter`.
        let bits = unsafe { ioctl(device, Getter::<STATE, Bits>::new()) };
        let Ok(bits) = bits else { return Vec::new() };
        let is_down = |code: &u16| bits[usize::from(code / 8)] >> (code % 8) & 1 == 1;
        (0..0x300).filter(is_down).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::CWD;

    /// A pipe with a name, and its end that sends.
    fn pipe(folder: &Path) -> (PathBuf, OwnedFd) {
        let path = folder.join("switch");
        rustix::fs::mkfifoat(CWD, &path, Mode::RUSR | Mode::WUSR).unwrap();
        let writer = open(&path, OFlags::RDWR | OFlags::CLOEXEC, Mode::empty()).unwrap();
        (path, writer)
    }

    fn all(device: &mut Device) -> (Vec<Signal>, Result<(), DeviceError>) {
        let mut signals = Vec::new();
        let read = device.read(|signal| signals.push(signal));
        (signals, read)
    }

    #[test]
    fn events_come_whole_however_they_are_cut_and_the_end_comes_after_them() {
        let folder = tempfile::tempdir().unwrap();
        let (path, writer) = pipe(folder.path());
        let mut device = Device::open(&path, 9600).unwrap();
        assert_eq!(all(&mut device), (vec![], Ok(())));
        let sent = [57, 28].map(InputEvent::press);
        let bytes = sent.map(InputEvent::to_bytes).concat();
        let cut = EVENT_SIZE + 5;
        rustix::io::write(&writer, &bytes[..cut]).unwrap();
        assert_eq!(all(&mut device), (vec![Signal::Event(sent[0])], Ok(())));
        rustix::io::write(&writer, &bytes[cut..]).unwrap();
        drop(writer);
        let (signals, read) = all(&mut device);
        assert_eq!(signals, [Signal::Event(sent[1])]);
        assert!(matches!(read, Err(DeviceError::Gone { .. })), "{read:?}");
        let closed = Device::open(&path, 9600);
        assert!(matches!(closed, Err(DeviceError::Gone { .. })), "{closed:?}");
    }

    #[test]
    fn what_is_no_device_is_refused_with_the_next_step() {
        let folder = tempfile::tempdir().unwrap();
        for (path, next) in [
            (folder.path().join("none"), "is it plugged in?"),
            (folder.path().to_owned(), "ls /dev/input/by-id"),
            (PathBuf::from("/dev/null"), "is not a serial device"),
        ] {
            let refused = Device::open(&path, 9600).unwrap_err().to_string();
            assert!(refused.contains(next), "{refused}");
        }
        let refused = refusal(Path::new("/dev/input/event3"), Errno::ACCESS).to_string();
        assert!(
            refused.contains("stat -Lc %G /dev/input/event3") && refused.contains("udev"),
            "{refused}"
        );
    }
}
