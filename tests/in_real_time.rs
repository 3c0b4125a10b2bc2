//! Flights of processes, most of them in real time, of which a core has room for two.
//!
//! One program, because each is linked with the whole product.

#[path = "common/adversary/mod.rs"]
mod adversary;
mod common;
#[path = "../orchestrator/fuzz/src/lib.rs"]
mod fuzz;

mod camera_storm;
mod containers;
mod damage;
mod hangs;
mod isolation;
mod kill_switch;
mod laboratory;
mod landing;
mod log_corpus;
mod mocap;
mod operator;
mod rc;
mod receivers;
mod recovery;
mod security;
mod top;
mod world;
mod wrong_signs;
