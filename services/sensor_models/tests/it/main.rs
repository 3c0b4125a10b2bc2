//! Tests of the sensor models.

mod allan;
#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod barometer;
mod gnss;
mod imu;
mod magnetometer;
mod no_allocation;
