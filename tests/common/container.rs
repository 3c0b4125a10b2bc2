//! Commands in containers: PID and mount namespaces of their own.

use std::process::{Command, Stdio};

/// Prepares the file system of a container that shares the machine's memory.
pub(crate) const SHARED_MEMORY: &str = "true";
/// Prepares the file system of a container with memory of its own.
pub(crate) const OWN_MEMORY: &str =
    "mount -t tmpfs tmpfs /dev/shm && mount -t tmpfs -o mode=700 tmpfs \"$XDG_RUNTIME_DIR\"";

/// A command in PID and mount namespaces of its own, after `preparation`.
pub(crate) fn contained(plain: &Command, preparation: &str) -> Command {
    let mut command = in_namespaces(&["--kill-child"]);
    command
        .arg(format!("{preparation} && exec \"$@\""))
        .arg("sh")
        .arg(plain.get_program())
        .args(plain.get_args())
        .stdin(Stdio::null());
    if let Some(folder) = plain.get_current_dir() {
        command.current_dir(folder);
    }
    for (name, value) in plain.get_envs() {
        if let Some(value) = value {
            command.env(name, value);
        }
    }
    command
}

/// A shell in PID and mount namespaces of its own; its script is to be added.
fn in_namespaces(more: &[&str]) -> Command {
    let mut command = Command::new("unshare");
    command.args(["--mount", "--pid", "--fork", "--mount-proc"]);
    command.args(more).args(["sh", "-c"]);
    command
}

/// Returns whether this user may make such namespaces; says so if not.
pub(crate) fn may_contain() -> bool {
    let mut command = in_namespaces(&[]);
    command.arg("mount -t tmpfs tmpfs /dev/shm");
    let may = command.output().is_ok_and(|output| output.status.success());
    if !may {
        eprintln!("SKIPPED: this user may not make PID and mount namespaces");
    }
    may
}
