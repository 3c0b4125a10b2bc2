//! Ctrl-C, SIGTERM and the end of the terminal (SIGHUP) end a run in good order: the log is closed, nothing is left behind.

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use flight::interrupt::Interrupt;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXFSZ};

/// Lets a file that grows beyond its limit (SIGXFSZ) no longer end the process: the write fails, as on a full disk, and is
/// handled there.
///
/// # Errors
/// If the system does not permit it.
pub fn survive_full_files() -> std::io::Result<()> {
    signal_hook::flag::register_usize(SIGXFSZ, Arc::default(), 1).map(drop)
}

/// Listens to SIGINT, SIGTERM and, unless `nohup` or its like ignores it, SIGHUP from now on.
///
/// # Errors
/// If the system does not permit it.
pub fn install() -> std::io::Result<Interrupt> {
    let hang_up = (!is_ignored(SIGHUP)).then_some(SIGHUP);
    let numbers: Vec<i32> = [SIGINT, SIGTERM].into_iter().chain(hang_up).collect();
    listen_to(&numbers)
}

/// Listens to all signals that end a program at a terminal: also SIGHUP and SIGQUIT.
///
/// # Errors
/// If the system does not permit it.
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

/// Returns whether this process has been started with a signal ignored.
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
