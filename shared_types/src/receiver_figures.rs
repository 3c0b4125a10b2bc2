//! Statistics of the receivers of a flight: samples, and packets by their outcome.

use std::borrow::Cow;

use crate::Topic;

crate::sample! {
    /// Statistics of the receivers of a flight. All counts are since the start of the receiving process. Sensors: inertial
    /// measurement unit, satellite receiver, barometer, magnetometer.
    pub struct ReceiverFigures {
        /// Samples of each sensor in the last whole second, Hz.
        pub rates: [f64; 4],
        /// Arrival time of the last sample of each sensor, ns since the start of the flight; 0 before the first.
        pub arrived_ns: [u64; 4],
        /// Samples of each sensor.
        pub samples: [u64; 4],
        /// Packets that were read.
        pub packets: u64,
        /// Packets with a wrong checksum, length or value.
        pub refused: u64,
        /// Fixes without a position in three dimensions, and baselines without one.
        pub without_position: u64,
        /// Packets with an impossible time.
        pub mistimed: u64,
        /// Packets that are not newer than one before.
        pub repeated: u64,
        /// Packets before the sender's clock was known.
        pub unsettled: u64,
        /// Packets of further senders or sensors.
        pub foreign: u64,
        /// Samples and packets that were dropped because newer ones had come.
        pub left_out: u64,
        /// Number of jumps of a sender's clock that were followed.
        pub clock_steps: u64,
        /// Number of losses of a source.
        pub losses: u64,
        /// Number of sources that are open.
        pub open: u32,
        /// Length of the reason, bytes.
        pub reason_length: u32,
        /// Reasons of the refusals as text, each with its count, filled up with zeros.
        pub reason: [u8; 200],
    }
}

impl ReceiverFigures {
    /// Topics of the sensors, in the order of the figures.
    pub const TOPICS: [Topic; 4] = [
        Topic::ImuSample,
        Topic::GnssFix,
        Topic::BaroAltitude,
        Topic::MagField,
    ];
    /// Names of their samples.
    pub const SENSORS: [&str; 4] = ["inertial", "fixes", "altitudes", "fields"];
    /// Index of the inertial measurement unit.
    pub const IMU: usize = 0;
    /// Index of the satellite receiver.
    pub const FIX: usize = 1;
    /// Index of the barometer.
    pub const ALTITUDE: usize = 2;
    /// Index of the magnetometer.
    pub const FIELD: usize = 3;

    /// Returns the reasons of the refusals; empty without refusals.
    #[must_use]
    pub fn reason(&self) -> Cow<'_, str> {
        let length = (self.reason_length as usize).min(self.reason.len());
        String::from_utf8_lossy(&self.reason[..length])
    }

    /// Returns what happened to packets that gave no sample, with its counts, in the order of display.
    pub fn happened(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let named = [
            ("refused", self.refused),
            ("without a position", self.without_position),
            ("mistimed", self.mistimed),
            ("repeated", self.repeated),
            ("unsettled", self.unsettled),
            ("foreign", self.foreign),
            ("left out", self.left_out),
            ("clock steps", self.clock_steps),
            ("losses", self.losses),
        ];
        named.into_iter().filter(|(_, count)| *count > 0)
    }
}
