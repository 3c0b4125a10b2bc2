//! Captures of which one part is right: the position of a body whose markers were confused, or the attitude of one whose
//! position is frozen.

use shared_types::service::seconds;

use super::super::attitude_trust::AttitudeTrust;
use super::super::filter_state::Pose;
use super::{KalmanFilter, Track};

/// Largest distance from the estimate at which the position of a body whose markers were confused is used, m.
const FARTHEST_CONFUSED: f64 = 0.08;
/// What the time without sight adds to it, m/s.
const FARTHER_UNSEEN: f64 = 0.3;
/// Longest time without sight after which such a position is used, s.
const LONGEST_UNSEEN: f64 = 1.0;

impl KalmanFilter {
    /// Takes of a capture whose attitude is false its position, unless that is false as well.
    pub(super) fn take_position(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose, mut track: Track) {
        let with_attitude = |world_from_body| Pose {
            world_from_body,
            ..*pose
        };
        if self.has_ground && track.ground.has_flown {
            // A vehicle at rest has the attitude that it had.
            let pose = with_attitude(track.ground.rest.pose.world_from_body);
            if self.touches_down(&pose, &mut track) {
                self.land(now_ns, exposure_ns, &pose, &track);
                return;
            }
            track.state.stands = false;
        }
        track.ground.observe_rise(&pose.position_world);
        let before = track.state.nominal.world_from_body;
        let pose = with_attitude(before);
        let unseen = seconds(now_ns.saturating_sub(track.used_at_ns));
        let noise = self.noise().of_confused_body(unseen);
        let residual = track.state.residual(&pose);
        let farthest = FARTHEST_CONFUSED + FARTHER_UNSEEN * unseen;
        if let Some(innovation) = track.state.innovation(residual, noise)
            && unseen <= LONGEST_UNSEEN
            && track.state.knows_tilt()
            && residual.norm() <= farthest
            && innovation.squared_distance() <= self.gate
        {
            let mut corrected = track.state;
            corrected.correct(&innovation, noise);
            if corrected.is_sound() {
                // What positions tell of the attitude does not bring a false one within reach.
                track.trust.captured_from_estimated *= before * corrected.nominal.world_from_body.transpose();
                track.state = corrected;
                track.used_at_ns = now_ns;
                track.refused_since_ns = None;
                track.compare_rest(exposure_ns, &pose);
            }
        }
        self.memory.track = Some(track);
    }

    /// Takes of a capture whose position is false its attitude, which the vehicle can have reached.
    pub(super) fn take_attitude(
        &mut self,
        now_ns: u64,
        exposure_ns: u64,
        pose: &Pose,
        mut track: Track,
        turn_if_missed: f64,
    ) {
        let pose = Pose {
            position_world: track.state.nominal.tracked_point(),
            ..*pose
        };
        let (noise, residual) = (self.noise().of_attitude(), track.state.residual(&pose));
        let unused_ns = now_ns.saturating_sub(track.levelled_at_ns);
        let likely = self.likely(&track.state, turn_if_missed, unused_ns, residual, noise);
        if let Some((mut believed, innovation)) = likely {
            believed.correct(&innovation, noise);
            if believed.is_sound() {
                let corrected = &believed.nominal.world_from_body;
                track.trust = AttitudeTrust::new(exposure_ns, corrected, &pose.world_from_body);
                track.state = believed;
                track.levelled_at_ns = now_ns;
                track.refused_since_ns = None;
            }
        }
        self.memory.track = Some(track);
    }
}
