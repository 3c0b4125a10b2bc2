//! Signals that end a run cleanly: Ctrl-C, SIGTERM and the end of the terminal (SIGHUP). The log is closed and nothing
//! is left behind.

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use flight::interrupt::Interrupt;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXFSZ};

/// Ignores SIGXFSZ: a write beyond the file size limit then fails like one to a full disk instead of ending the
/// process.
///
/// # Errors
/// If the handler cannot be installed.
pub fn ignore_file_size_signal() -> std::io::Result<()> {
    signal_hook::flag::register_usize(SIGXFSZ, Arc::default(), 1).map(drop)
}

/// Handles SIGINT, SIGTERM and, unless the process was started with it ignored (`nohup`), SIGHUP.
///
/// # Errors
/// If a handler cannot be installed.
pub fn install() -> std::io::Result<Interrupt> {
    let hang_up = (!is_ignored(SIGHUP)).then_some(SIGHUP);
    let numbers: Vec<i32> = [SIGINT, SIGTERM].into_iter().chain(hang_up).collect();
    listen_to(&numbers)
}

/// Handles all signals by which a terminal ends a program, also SIGQUIT and an ignored SIGHUP.
///
/// # Errors
/// If a handler cannot be installed.
pub fn install_in_terminal() -> std::io::Result<Interrupt> {
    listen_to(&[SIGINT, SIGTERM, SIGHUP, SIGQUIT])
}

fn listen_to(numbers: &[i32]) -> std::io::Result<Interrupt> {
    let signal = Arc::new(AtomicUsize::new(0));
    for &number in numbers {
        let value = usize::try_from(number).expect("signal numbers are positive");
        signal_hook::flag::register_usize(number, Arc::clone(&signal), value)?;
    }
    Ok(Interrupt::of(signal))
}

/// Returns whether this process was started with a signal ignored.
fn is_ignored(number: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mut masks = status.lines().filter_map(|line| line.strip_prefix("SigIgn:"));
    let mask = masks
        .next()
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (number - 1) & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_ignores_for_this_process_is_known() {
        // Rust's runtime ignores SIGPIPE before `main`.
        assert!(is_ignored(signal_hook::consts::SIGPIPE));
        assert!(!is_ignored(SIGTERM));
    }
}
