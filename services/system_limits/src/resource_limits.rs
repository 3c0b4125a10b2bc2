//! Exhausted resource limits behind error numbers of the system, and their fixes.

use std::error::Error;
use std::io;
use std::iter::successors;

use rustix::io::Errno;

/// Returns the exhausted resource behind an error or its sources, with the fix. `None` for other errors.
#[must_use]
pub fn advice(error: &(dyn Error + 'static)) -> Option<&'static str> {
    successors(Some(error), |&error| error.source()).find_map(|error| advice_for(number(error)?))
}

fn number(error: &(dyn Error + 'static)) -> Option<Errno> {
    if let Some(error) = error.downcast_ref::<io::Error>() {
        // A system error inside of another error is its source or its inner value.
        return Errno::from_io_error(error)
            .or_else(|| number(error.get_ref().map(|inner| inner as &(dyn Error + 'static))?));
    }
    error.downcast_ref::<Errno>().copied()
}

fn advice_for(number: Errno) -> Option<&'static str> {
    match number {
        Errno::AGAIN => Some(
            "this user may have no more processes and threads: raise `ulimit -u` (a container's limit of pids), or end others",
        ),
        Errno::NOMEM => Some(
            "no memory is left for it: raise `ulimit -v` (a container's limit of memory), or close other programs",
        ),
        Errno::MFILE => Some("this process may open no more files: raise `ulimit -n`"),
        Errno::NFILE => Some("the machine may open no more files: raise the sysctl `fs.file-max`"),
        _ => None,
    }
}

/// Formats an error, with the fix if a resource is exhausted.
#[must_use]
pub fn in_words(error: &(dyn Error + 'static)) -> String {
    match advice(error) {
        // Some messages already have the fix.
        Some(advice) if !error.to_string().contains("ulimit") => format!("{error}; {advice}"),
        _ => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("a service cannot be started: {0}")]
    struct Outer(#[source] io::Error);

    #[test]
    fn the_resource_that_is_used_up_is_named_however_deep_the_error_is() {
        let of = |number: Errno| io::Error::from_raw_os_error(number.raw_os_error());
        let started = in_words(&Outer(of(Errno::AGAIN)));
        assert!(
            started.starts_with("a service cannot be started: ") && started.contains("`ulimit -u`"),
            "{started}"
        );
        assert!(in_words(&Errno::NOMEM).contains("`ulimit -v`"));
        assert!(in_words(&io::Error::other(of(Errno::MFILE))).contains("`ulimit -n`"));
        let other = Outer(of(Errno::NOENT));
        assert_eq!(in_words(&other), other.to_string());
        let told = io::Error::other("too many open files; raise `ulimit -n`");
        assert_eq!(in_words(&told), told.to_string());
    }
}
