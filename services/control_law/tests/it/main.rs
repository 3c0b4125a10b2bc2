//! Tests of the control laws from outside, in one program: linking takes longer than running.

mod baselines;
mod law;
mod rates;
