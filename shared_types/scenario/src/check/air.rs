//! Checks of wind and fan.

use super::Findings;
use crate::{Fan, Key, Vector, Wind};

impl Wind {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        if self.dryden.is_some() {
            let reason = "the gusts of `dryden` need a mean wind";
            let fix = "state a wind such as [1.0, 0.0, 0.0], or `gusts` with a correlation time in place of `dryden`";
            found.direction(&at.then("mean"), &self.mean, reason, fix);
        }
    }
}

impl Fan {
    pub(super) fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        self.check_switching(duration, at, found);
        check_direction(&self.direction, &at.then("direction"), found);
        self.check_moves(duration, &at.then("moves"), found);
    }

    fn check_switching(&self, duration: f64, at: &Key, found: &mut Findings) {
        found.in_flight(&at.then("on_at"), "switching the fan on", self.on_at, duration);
        let Some(off_at) = self.off_at else {
            return;
        };
        found.in_flight(&at.then("off_at"), "switching the fan off", off_at, duration);
        if off_at <= self.on_at {
            found.add(
                at.then("off_at"),
                format!(
                    "the fan is switched off at {off_at:?} s, but not on before {:?} s",
                    self.on_at
                ),
                "raise `off_at` above `on_at`, or leave the fan out",
            );
        }
    }

    fn check_moves(&self, duration: f64, at: &Key, found: &mut Findings) {
        for (index, waypoint) in self.moves.iter().enumerate() {
            check_direction(&waypoint.direction, &at.then(index).then("direction"), found);
        }
        let times: Vec<_> = self.moves.iter().map(|waypoint| waypoint.at).collect();
        found.check_events(["move", "moves"], at, &times, duration);
        if self.moves.first().is_some_and(|waypoint| waypoint.at == 0.0) {
            found.add(
                at.then(0).then("at"),
                "the fan moves at 0.0 s, when it is at `position`",
                "state the first move as the fan's `position` and `direction`",
            );
        }
    }
}

fn check_direction(direction: &Vector, key: &Key, found: &mut Findings) {
    let fix = "give a direction of any length, such as [1.0, 0.0, 0.0]";
    found.direction(key, direction, "the jet has no direction", fix);
}
