//! The orchestrator: loads scenarios, flies them in any host, supervises the services, records their traffic.
//!
//! * [`cli`], [`commands`], [`exit`]: the command `gerono`;
//! * [`scenario_file`]: scenarios from files, with errors that show the place and the fix;
//! * [`experiment`]: the step logic of every service, built from a scenario, in a crate of its own;
//! * [`flight`]: the hosts' orchestrating side, the crew of processes, the recorder;
//! * [`laboratory`]: cameras and radio link around the services of a flight in real time;
//! * [`world`]: the laboratory that is none: what those are connected to where there is no real one;
//! * [`truth`]: how far a vehicle truly was from its path;
//! * [`log`], [`info`], [`summary`], [`plot`], [`host_record`]: what remains of a flight;
//! * [`report`]: flights as one page;
//! * [`reproduce`]: the paper's figures, flown again and judged;
//! * [`matrix`]: everything that can fail, failing in every way, judged;
//! * [`doctor`]: whether the machine is fit for a flight;
//! * [`identify`]: what a radio link's channels meant, from a log;
//! * [`live`], [`top`]: a run in real time as seen from another terminal;
//! * [`run_folder`], [`run_root`]: its places on disk and in shared memory.

pub mod cli;
pub mod commands;
pub mod diff;
pub mod doctor;
pub mod exit;
pub mod flight;
pub mod host_record;
pub mod identify;
pub mod info;
pub mod interrupt;
pub mod laboratory;
pub mod live;
pub mod log;
pub mod matrix;
pub mod plot;
pub mod progress;
pub mod replay;
pub mod report;
pub mod reproduce;
pub mod run_folder;
pub mod run_root;
pub mod scenario_file;
pub mod summary;
pub mod top;
pub mod truth;
pub mod world;
