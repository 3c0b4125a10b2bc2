//! The simulated vehicle: rigid body, actuators, air, changes in flight, and the cameras that watch it.
//!
//! * [`vehicle_model`]: the rigid body, its integration, and first-order lags;
//! * [`actuators`]: from the radio's frames to what drives the body, with lags, limits and lost frames;
//! * [`air`]: drag, turbulence and a fan's jet;
//! * [`dynamics`]: all of these together over a tick;
//! * [`ground`]: what holds the vehicle before and after a flight with phases;
//! * [`changes`]: which mass, inertia, centre of mass and disturbance are in force at a tick;
//! * [`cameras`]: from the motion to what the motion-capture system reports;
//! * [`PlantService`]: the step function, with the conventions of time.
//!
//! Each module states its model: symbols, units, source. What a scenario does not state is ideal, and costs
//! nothing. Every random number is a function of seed, stream and tick (a lost frame's: of its number).
//!
//! It never fails: every frame that a host delivers is flown, whatever comes of it.

pub mod actuators;
pub mod air;
pub mod cameras;
pub mod changes;
pub mod dynamics;
pub mod ground;
mod service;

pub use service::{PlantService, PlantState};
