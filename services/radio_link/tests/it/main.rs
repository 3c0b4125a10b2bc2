//! Links from outside, in one program: linking takes longer than running.

mod formats;
mod meaning;
mod ports;
mod receiver;
mod vehicles;
