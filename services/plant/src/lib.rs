//! Simulated vehicle: rigid body, actuators, air, changes in flight, and the cameras that measure it.
//!
//! * [`vehicle_model`]: the rigid body, its integration, and first-order lags;
//! * [`actuators`]: from the radio's frames to the forces and rates of the body, with lags, limits and lost frames;
//! * [`air`]: drag, turbulence and a fan's jet;
//! * [`dynamics`]: all of these together over a tick;
//! * [`ground`]: the ground before take-off and after landing;
//! * [`changes`]: mass, inertia, centre of mass and disturbance at each tick;
//! * [`cameras`]: the measurements of the motion-capture system;
//! * [`PlantService`]: the step function, with the time conventions.
//!
//! Each module states its model: symbols, units, source. Parts that a scenario does not state are ideal and cost no
//! computing time. Every random number is a function of seed, stream and tick (the loss of a frame: of its number).
//!
//! The plant never fails, whatever frames it receives.

pub mod actuators;
pub mod air;
pub mod cameras;
pub mod changes;
pub mod dynamics;
pub mod ground;
pub mod sensors;
mod service;

pub use service::{PlantService, PlantState};
