//! The command line explained to shells and readers: completions, man pages, the page of commands.

pub mod completion;
pub mod pages;
pub mod wiring;
