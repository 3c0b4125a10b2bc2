//! Links from outside, in one program: linking takes longer than running.

mod formats;
mod ports;
mod receiver;
