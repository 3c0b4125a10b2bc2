//! A service in the place of one that has died, for tests that nobody can tell.

use shared_types::service::ErasedService;

/// `fresh` with what `service` knows.
pub(crate) fn restarted<S: ErasedService>(service: &S, mut fresh: S) -> S {
    let mut saved = vec![0; service.state_size()];
    service.save(&mut saved);
    fresh.restore(&saved);
    fresh
}
