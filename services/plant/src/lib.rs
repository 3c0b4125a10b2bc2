//! The simulated vehicle: rigid body, actuators, changes in flight, and the cameras that watch it.
//!
//! * [`rigid_body`]: equations (1)–(4) as a pure vector field;
//! * [`integrator`]: a fourth-order step along it that keeps R in SO(3);
//! * [`cayley`]: the chart of SO(3) that it works in;
//! * [`actuators`]: from a radio frame to the thrust and torque that act on the body;
//! * [`changes`]: which mass, inertia and disturbance are in force at a tick;
//! * [`cameras`]: from the motion to what the motion-capture system reports;
//! * [`PlantService`]: the step function, with the conventions of time.
//!
//! It never fails: every frame that a host delivers is flown, whatever comes of it.

pub mod actuators;
pub mod cameras;
pub mod cayley;
pub mod changes;
pub mod integrator;
pub mod rigid_body;
mod service;

pub use service::{PlantService, PlantState};
