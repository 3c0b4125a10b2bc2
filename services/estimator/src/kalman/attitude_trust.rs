//! Plausibility of captured attitudes.
//!
//! Capture systems confuse the markers of a body, mostly after an occlusion, and then report a rotated attitude for any
//! time. The vehicle turns as commanded, within the errors of its rate loop, so an attitude that departs from that turn
//! suddenly is false. One that departs continuously, as of a vehicle that tips over or was hit, is true.
//!
//! The test compares each capture with the last trusted one, rotated by the filter's rotation since:
//!
//! ```text
//!     angle(R_expected, R_captured) ≤ 0.1 rad + min(10 rad/s · t, 0.3 rad) + min(0.2 rad/s · b, 0.6 rad)
//! ```
//!
//! with the time t since the last trusted capture, and the longest time b without captures since then: the time to the
//! first capture after it, or a later gap of more than 0.25 s. Captures that are not trusted do not extend b: a persistent
//! false attitude is never accepted, nor is a sudden turn of 30° after a gap of up to half a second.

use nalgebra::Matrix3;
use shared_types::rotation::angle_between;
use shared_types::service::seconds;

/// Error of a captured attitude, rad.
const NOISE: f64 = 0.1;
/// Maximum rate of departure from the commanded turn, rad/s, and maximum departure, rad.
const DEPARTURE_RATE: f64 = 10.0;
const LARGEST_DEPARTURE: f64 = 0.3;
/// Drift of the predicted attitude without captures, rad/s, and maximum error of the drift, rad.
const DRIFT_RATE: f64 = 0.2;
const LARGEST_DRIFT: f64 = 0.6;
/// Time between two untrusted captures above which it counts as a gap, ns.
const GAP_NS: u64 = 250_000_000;

/// The last trusted attitude, and the times that limit the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeTrust {
    /// R_captured R_estimatedᵀ of the last trusted capture.
    pub captured_from_estimated: Matrix3<f64>,
    /// Time of the last trusted capture, ns since the start of the flight.
    pub trusted_ns: u64,
    /// Time of the last capture, trusted or not, ns since the start of the flight.
    pub tested_ns: u64,
    /// Longest gap since the last trusted capture, ns; 0 until the next capture.
    pub unseen_ns: u64,
    /// `true` if the last capture was not trusted.
    pub is_refused: bool,
}

impl AttitudeTrust {
    /// Makes the reference from a trusted capture and the estimate at its time.
    #[must_use]
    pub fn new(time_ns: u64, estimated: &Matrix3<f64>, captured: &Matrix3<f64>) -> Self {
        Self {
            captured_from_estimated: captured * estimated.transpose(),
            trusted_ns: time_ns,
            tested_ns: time_ns,
            unseen_ns: 0,
            is_refused: false,
        }
    }

    /// Returns whether the last capture was not trusted and no gap has followed it up to a time.
    #[must_use]
    pub fn is_refused_until(&self, time_ns: u64) -> bool {
        self.is_refused && time_ns.saturating_sub(self.tested_ns) <= GAP_NS
    }

    /// Tests a captured attitude against the one predicted for its time. Returns whether it is plausible.
    pub fn test(&mut self, time_ns: u64, predicted: &Matrix3<f64>, captured: &Matrix3<f64>) -> bool {
        let since = seconds(time_ns.saturating_sub(self.trusted_ns));
        let gap_ns = time_ns.saturating_sub(self.tested_ns);
        if self.unseen_ns == 0 || gap_ns > GAP_NS {
            self.unseen_ns = self.unseen_ns.max(gap_ns);
        }
        self.tested_ns = time_ns;
        let reach = NOISE
            + (DEPARTURE_RATE * since).min(LARGEST_DEPARTURE)
            + (DRIFT_RATE * seconds(self.unseen_ns)).min(LARGEST_DRIFT);
        let expected = self.captured_from_estimated * predicted;
        self.is_refused = angle_between(&expected, captured) > reach;
        !self.is_refused
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;
    use shared_types::rotation::exp;

    use super::*;

    const FRAME_NS: u64 = 10_000_000;

    /// Trust in a level attitude at time 0, and the prediction of a vehicle that turns at a rate.
    fn at_rest() -> AttitudeTrust {
        AttitudeTrust::new(0, &Matrix3::identity(), &Matrix3::identity())
    }

    proptest! {
        #[test]
        fn a_turn_at_once_is_never_trusted_however_long_it_lasts(
            axis in prop::array::uniform3(-1.0..1.0f64),
            degrees in 30.0..180.0f64,
            rate in prop::array::uniform3(-6.0..6.0f64),
            gap_ns in 0..490_000_000u64,
            noise in 0.0..0.01f64,
            period_ns in 5_000_000..200_000_000u64,
        ) {
            let axis = Vector3::from(axis);
            prop_assume!(axis.norm() > 0.1);
            let turn = exp(&(axis.normalize() * degrees.to_radians()));
            let mut trust = at_rest();
            for frame in 0..1000 {
                let time_ns = FRAME_NS + gap_ns + frame * period_ns;
                let predicted = exp(&(Vector3::from(rate) * seconds(time_ns)));
                let shaken = exp(&Vector3::new(noise * libm::sin(frame as f64), 0.0, noise));
                let captured = predicted * turn * shaken;
                prop_assert!(!trust.test(time_ns, &predicted, &captured), "frame {}", frame);
            }
            let time_ns = FRAME_NS + gap_ns + 1000 * period_ns;
            let predicted = exp(&(Vector3::from(rate) * seconds(time_ns)));
            prop_assert!(trust.test(time_ns, &predicted, &predicted), "the true attitude is trusted at once");
        }

        #[test]
        fn a_vehicle_that_tips_over_against_its_commands_is_trusted(
            axis in prop::array::uniform3(-1.0..1.0f64),
            rate in 0.0..18.0f64,
        ) {
            let axis = Vector3::from(axis);
            prop_assume!(axis.norm() > 0.1);
            let mut trust = at_rest();
            for frame in 1..200 {
                let time_ns = frame * FRAME_NS;
                let captured = exp(&(axis.normalize() * rate * seconds(time_ns)));
                prop_assert!(trust.test(time_ns, &Matrix3::identity(), &captured));
                trust = AttitudeTrust::new(time_ns, &Matrix3::identity(), &captured);
            }
        }
    }

    #[test]
    fn a_body_that_was_not_seen_for_seconds_may_have_drifted() {
        let captured = exp(&Vector3::new(0.9, 0.0, 0.0));
        assert!(!at_rest().test(1_000_000_000, &Matrix3::identity(), &captured));
        assert!(at_rest().test(3_000_000_000, &Matrix3::identity(), &captured));
        // Nor does it matter that one capture before that time was a false one.
        let mut trust = at_rest();
        assert!(!trust.test(
            10_000_000,
            &Matrix3::identity(),
            &exp(&Vector3::new(0.0, 2.0, 0.0))
        ));
        assert!(trust.is_refused_until(260_000_000) && !trust.is_refused_until(261_000_000));
        assert!(trust.test(3_000_000_000, &Matrix3::identity(), &captured));
        assert!(!trust.is_refused_until(3_000_000_000));
    }

    #[test]
    fn a_false_attitude_that_is_seen_now_and_then_is_never_trusted() {
        let (mut trust, turn) = (at_rest(), exp(&Vector3::new(0.0, 0.53, 0.0)));
        for gap in 1..100 {
            assert!(
                !trust.test(gap * 490_000_000, &Matrix3::identity(), &turn),
                "{gap}"
            );
        }
    }
}
