//! rc_output
