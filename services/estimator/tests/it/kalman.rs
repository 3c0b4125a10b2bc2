//! Filter against a simulated rig.

mod consistency;
mod faults;
mod ground;
mod laboratory;
mod prediction;
mod rig;
mod service;
