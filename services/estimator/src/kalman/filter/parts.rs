//! Partly valid captures: the position of a body with confused markers, or the attitude of a body with a frozen position.

use shared_types::service::seconds;

use super::super::attitude_trust::AttitudeTrust;
use super::super::filter_state::Pose;
use super::{KalmanFilter, Track};

/// Maximum distance from the estimate of a used position of a body with confused markers, m.
const FARTHEST_CONFUSED: f64 = 0.08;
/// Growth of that distance with the time since the last used capture, m/s.
const FARTHER_UNSEEN: f64 = 0.3;
/// Maximum time since the last used capture for such a position, s.
const LONGEST_UNSEEN: f64 = 1.0;

impl KalmanFilter {
    /// Corrects the state by the position of a capture with a false attitude, if the position is plausible.
    pub(super) fn use_position(&mut self, now_ns: u64, exposure_ns: u64, pose: &Pose, mut track: Track) {
        let with_attitude = |world_from_body| Pose {
            world_from_body,
            ..*pose
        };
        if self.has_ground && track.ground.has_flown {
            // At rest the attitude does not change.
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
            && track.state.is_tilt_known()
            && residual.norm() <= farthest
            && innovation.squared_distance() <= self.gate
        {
            let mut corrected = track.state;
            corrected.correct(&innovation, noise);
            if corrected.is_sound() {
                // A correction of the attitude by positions must not make a false attitude plausible.
                track.trust.captured_from_estimated *= before * corrected.nominal.world_from_body.transpose();
                track.state = corrected;
                track.used_at_ns = now_ns;
                track.refused_since_ns = None;
                track.compare_rest(exposure_ns, &pose);
            }
        }
        self.persistent.track = Some(track);
    }

    /// Corrects the state by the plausible attitude of a capture with a false position.
    pub(super) fn use_attitude(
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
        let gated = self.gated(&track.state, turn_if_missed, unused_ns, residual, noise);
        if let Some((mut assumed, innovation)) = gated {
            assumed.correct(&innovation, noise);
            if assumed.is_sound() {
                let corrected = &assumed.nominal.world_from_body;
                track.trust = AttitudeTrust::new(exposure_ns, corrected, &pose.world_from_body);
                track.state = assumed;
                track.levelled_at_ns = now_ns;
                track.refused_since_ns = None;
            }
        }
        self.persistent.track = Some(track);
    }
}
