//! Properties shown with real processes and not judged by how punctual they were, so that tests may go on beside each
//! other.
//!
//! One program, because each is linked with the whole product. What needs the machine for itself has programs of its own,
//! which follow each other.

mod common;

mod checkpoints;
mod curve_files;
mod doctor;
mod documentation;
mod faults;
mod figures;
mod flight;
mod following;
mod identity;
mod language;
mod laws;
mod logs;
mod long_logs;
mod long_scenarios;
mod new_scenarios;
mod outages;
mod plugins;
mod replay;
mod replay_processes;
mod report;
mod reproduce;
mod result_files;
mod safety;
mod slips;
mod sweeps;
mod verdicts;
mod view;
