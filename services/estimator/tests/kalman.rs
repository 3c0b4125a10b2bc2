//! The filter against a simulated rig.

#[path = "kalman/consistency.rs"]
mod consistency;
#[path = "kalman/faults.rs"]
mod faults;
#[path = "kalman/ground.rs"]
mod ground;
#[path = "kalman/laboratory.rs"]
mod laboratory;
#[path = "kalman/prediction.rs"]
mod prediction;
#[path = "kalman/rig.rs"]
mod rig;
#[path = "kalman/service.rs"]
mod service;
