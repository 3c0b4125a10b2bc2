//! The paper's adaptive law.
//!
//! * [`evaluation`]: errors, thrust, torque and the estimators' rates, (7) to (21), as one pure function;
//! * [`projection`]: the smooth projection π (5) and the potential V(s, s̃) (6);
//! * [`saturation`]: σ and its derivatives;
//! * [`parameters`]: gains and bounds;
//! * [`errors`]: z1 and z2, (7) and (9);
//! * [`zeta_rate`]: ζ̇ as an affine function of the unknown acceleration;
//! * [`regressor`]: W of (20), kept structured;
//! * [`parameter_vector`]: w of (20);
//! * [`lyapunov`]: the Lyapunov function that the law makes decrease;
//! * [`harmonics`]: estimators of the part of the disturbance that repeats with the path;
//! * [`repeating`]: the estimate of that part at one moment, which the law uses;
//! * [`offset`]: the distance by which δ makes the vehicle hang below the path;
//! * [`rate_law`]: the law for a vehicle with a rate loop;
//! * [`flight_law`]: the law of a flight, with the steps of its estimators.
//!
//! All but the last two are pure functions.

pub mod errors;
pub mod evaluation;
pub mod flight_law;
pub mod harmonics;
pub mod lyapunov;
pub mod offset;
pub mod parameter_vector;
pub mod parameters;
pub mod projection;
pub mod rate_law;
pub mod regressor;
pub mod repeating;
pub mod saturation;
pub mod zeta_rate;
