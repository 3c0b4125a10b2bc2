//! Functions that commands share: failure and exit, output, progress.

pub mod exit;
pub mod failure;
pub mod interrupt;
pub mod output;
pub mod progress;
pub mod terminal;
