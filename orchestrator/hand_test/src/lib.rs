//! Hand test of a laboratory: the vehicle is moved by hand, propellers off, and the poses of the cameras must follow.
//!
//! * [`steps`]: the movements, each with its expected axis and sign;
//! * [`mod@test`]: the state machine from poses to verdicts, without a clock or a socket;
//! * [`cause`]: the likely causes of wrong axes and signs, from all movements together;
//! * [`record`]: the result in a file, and why it does not permit to arm.
//!
//! Failure policy: a movement that is wrong once may be the hand's fault, so it is asked for again; the second one counts.
//! A test that did not end has no result.

pub mod cause;
pub mod record;
pub mod steps;
pub mod test;

#[cfg(test)]
mod trials;
