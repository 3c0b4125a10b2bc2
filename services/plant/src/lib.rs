//! Simulated vehicle: rigid body, actuators, air, changes in flight, and the cameras that measure it.
//!
//! * [`vehicle_model`]: the rigid body, its integration, and first-order lags;
//! * [`actuators`]: from the radio's frames to the forces and rates of the body, with lags, limits and lost frames;
//! * [`air`]: drag, turbulence and a fan's jet;
//! * [`dynamics`]: all of these together over a tick;
//! * [`ground`]: support of the vehicle before and after a flight with phases;
//! * [`changes`]: mass, inertia, centre of mass and disturbance at each tick;
//! * [`cameras`]: from the motion to the reports of the motion-capture system;
//! * [`PlantService`]: the step function, with the conventions of time.
//!
//! Each module states its model: symbols, units, source. Unstated parts of a scenario are ideal, and cost no time.
//! Every random number is a function of seed, stream and tick (a lost frame's: of its number).
//!
//! The plant never fails: it flies every frame that a host delivers.

pub mod actuators;
pub mod air;
pub mod cameras;
pub mod changes;
pub mod dynamics;
pub mod ground;
mod service;

pub use service::{PlantService, PlantState};
