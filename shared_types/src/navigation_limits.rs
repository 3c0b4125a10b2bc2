//! Limits of inertial navigation that a scenario must keep.

/// Longest period of the inertial measurement unit, ns: the filter takes a longer one for a gap.
pub const LONGEST_IMU_PERIOD_NS: u64 = 10_000_000;

/// Number of samples of the inertial measurement unit that the filter stores.
pub const STORED_SAMPLES: usize = 256;

/// Number of measurements that wait for the filter's horizon.
pub const STORED_MEASUREMENTS: usize = 64;

/// Time over which the filter is aligned, s.
pub const ALIGNMENT: f64 = 1.0;
