//! Vehicle model, used by the plant with true parameters, and by filter, roll-out and dead reckoning with estimates.
//!
//! * [`rigid_body`]: equations (1)–(4) as a pure vector field, and a centre of mass that is not the origin;
//! * [`integrator`]: a fourth-order integrator that keeps R in SO(3);
//! * [`cayley`]: its chart of SO(3);
//! * [`lag`]: first-order lags, exact over a step;
//! * [`rotors`]: rotor positions and coefficients, and the mixer and allocation derived from them.
//!
//! {I} has z down, {B} x forward, y right, z down. SI units and radians.

pub mod cayley;
pub mod integrator;
pub mod lag;
pub mod rigid_body;
pub mod rotors;
