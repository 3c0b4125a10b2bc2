//! Vehicle model: the plant uses it with true parameters; filter, roll-out and dead reckoning with estimated ones.
//!
//! * [`rigid_body`]: equations (1)–(4) as a pure vector field, and a centre of mass that is not the origin;
//! * [`integrator`]: a fourth-order step along it that keeps R in SO(3);
//! * [`cayley`]: the chart of SO(3) that it works in;
//! * [`lag`]: first-order lags, exact over a step;
//! * [`rotors`]: the rotors as data, and the mixer and the allocation that follow.
//!
//! {I} has z down, {B} x forward, y right, z down. SI units and radians.

pub mod cayley;
pub mod integrator;
pub mod lag;
pub mod rigid_body;
pub mod rotors;
