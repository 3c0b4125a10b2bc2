//! Faster context switches.

use std::ffi::{OsStr, OsString};
use std::process::Command;

/// Environment variable of the C library's tunables.
const TUNABLES: &str = "GLIBC_TUNABLES";
const RESTARTABLE_SEQUENCES: &str = "glibc.pthread.rseq";

/// Makes the process that `command` starts run without restartable sequences, unless its parent's environment sets
/// them. No process of a run uses them, and the kernel writes to the registered page at every switch to the process.
pub fn disable_restartable_sequences(command: &mut Command) {
    let stated = std::env::var_os(TUNABLES).unwrap_or_default();
    if let Some(tunables) = without_restartable_sequences(&stated) {
        command.env(TUNABLES, tunables);
    }
}

fn without_restartable_sequences(stated: &OsStr) -> Option<OsString> {
    let bytes = stated.as_encoded_bytes();
    let names_them = |name: &[u8]| name == RESTARTABLE_SEQUENCES.as_bytes();
    if bytes.windows(RESTARTABLE_SEQUENCES.len()).any(names_them) {
        return None;
    }
    let mut tunables = stated.to_owned();
    if !tunables.is_empty() {
        tunables.push(":");
    }
    tunables.push(RESTARTABLE_SEQUENCES);
    tunables.push("=0");
    Some(tunables)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_c_library_was_told_otherwise_stays() {
        let told = |stated: &str| without_restartable_sequences(OsStr::new(stated));
        assert_eq!(told("").unwrap(), "glibc.pthread.rseq=0");
        assert_eq!(
            told("glibc.malloc.check=3").unwrap(),
            "glibc.malloc.check=3:glibc.pthread.rseq=0"
        );
        assert_eq!(told("glibc.malloc.check=3:glibc.pthread.rseq=1"), None);
    }
}
