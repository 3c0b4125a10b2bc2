//! `gerono.h`: the interface for C and C++, with the samples of all topics and their layout hashes.
//!
//! A test generates the part that follows from the wiring table.

/// The header.
pub const TEXT: &str = include_str!("../include/gerono.h");
