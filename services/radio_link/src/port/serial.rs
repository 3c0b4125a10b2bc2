//! Serial devices: raw bytes, any speed, exclusive access.

use std::os::fd::OwnedFd;
use std::path::Path;

use rustix::fs::{FlockOperation, Mode, OFlags, flock, open as open_file};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, OptionalActions, QueueSelector, ioctl_tiocexcl, tcflush, tcgetattr, tcsetattr,
};

use super::{ByteFormat, OpenError};

/// Opens and configures a device in non-blocking mode. Locks it against all other programs.
///
/// # Errors
/// [`OpenError`], with the fix.
pub fn open(path: &Path, baud: u32, byte: ByteFormat) -> Result<OwnedFd, OpenError> {
    // Without O_NONBLOCK opening would wait for a carrier.
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let device = open_file(path, flags, Mode::empty()).map_err(|reason| open_error(path, reason))?;
    flock(&device, FlockOperation::NonBlockingLockExclusive).map_err(|reason| open_error(path, reason))?;
    set_up(&device, path, baud, byte)?;
    ioctl_tiocexcl(&device).map_err(|reason| open_error(path, reason))?;
    tcflush(&device, QueueSelector::IOFlush).map_err(|reason| open_error(path, reason))?;
    Ok(device)
}

fn set_up(device: &OwnedFd, path: &Path, baud: u32, byte: ByteFormat) -> Result<(), OpenError> {
    let mut settings = tcgetattr(device).map_err(|reason| open_error(path, reason))?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    let framing = ControlModes::PARENB | ControlModes::PARODD | ControlModes::CSTOPB | ControlModes::CRTSCTS;
    settings.control_modes -= framing;
    if byte == ByteFormat::EvenTwo {
        settings.control_modes |= ControlModes::PARENB | ControlModes::CSTOPB;
    }
    let unsupported = |got| OpenError::Speed {
        path: path.to_owned(),
        wanted: baud,
        got,
    };
    settings.set_speed(baud).map_err(|_| unsupported(0))?;
    match tcsetattr(device, OptionalActions::Now, &settings) {
        Err(Errno::INVAL) => return Err(unsupported(0)),
        other => other.map_err(|reason| open_error(path, reason))?,
    }
    // A driver sets the nearest rate that it supports. A receiver tolerates about 2 %.
    let got = tcgetattr(device)
        .map_err(|reason| open_error(path, reason))?
        .output_speed();
    if got.abs_diff(baud) > baud / 50 {
        return Err(unsupported(got));
    }
    Ok(())
}

/// Converts the system's error to that of the device.
fn open_error(path: &Path, reason: Errno) -> OpenError {
    let path = path.to_owned();
    match reason {
        Errno::NOENT | Errno::NODEV | Errno::NXIO => OpenError::Missing { path },
        Errno::ACCESS | Errno::PERM => OpenError::Permission { path },
        Errno::BUSY | Errno::AGAIN => OpenError::Busy { path },
        Errno::NOTTY | Errno::ISDIR => OpenError::NotSerial { path },
        source => OpenError::Device { path, source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_refusal_names_the_device_and_the_fix() {
        let path = Path::new("/dev/ttyUSB7");
        for (reason, fix) in [
            (Errno::NOENT, "is it plugged in?"),
            (Errno::ACCESS, "stat -Lc %G /dev/ttyUSB7"),
            (Errno::BUSY, "fuser /dev/ttyUSB7"),
            (Errno::NOTTY, "check the path"),
        ] {
            let shown = open_error(path, reason).to_string();
            assert!(shown.contains("/dev/ttyUSB7") && shown.contains(fix), "{shown}");
        }
    }
}
