//! The program `gerono`: its command line ([`cli`]), and one module per command ([`commands`]). The other crates implement them;
//! `docs/architecture.md` lists these with their permitted dependencies.

pub mod cli;
pub mod commands;
pub mod manual;
