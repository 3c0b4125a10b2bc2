//! Documentation of the command line: completions, man pages, the page of commands.

pub mod completion;
pub mod pages;
pub mod wiring;
