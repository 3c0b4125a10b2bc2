//! What commands share: how they fail and end, what they print and write, how far they have come.

pub mod exit;
pub mod failure;
pub mod interrupt;
pub mod output;
pub mod progress;
pub mod terminal;
pub mod values;
