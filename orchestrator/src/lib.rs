//! The command `gerono`: what it is asked ([`cli`]), and one module a command ([`commands`]). All that it does is in the crates
//! beside it; `docs/architecture.md` lists them and says which may use which.

pub mod cli;
pub mod commands;
pub mod manual;
