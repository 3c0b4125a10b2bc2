//! What the commands share: exit codes, failures, output, progress.

pub mod exit;
pub mod failure;
pub mod interrupt;
pub mod output;
pub mod progress;
pub mod terminal;
