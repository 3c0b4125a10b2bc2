//! Properties of the law, proven along the closed loop with exact derivatives.

mod closed_loop;
mod dual;
mod lyapunov;
mod path;
mod regressor;
mod timing_law;
mod vectors;
