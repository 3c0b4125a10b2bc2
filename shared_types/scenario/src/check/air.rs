//! Air that can blow: turbulence and fan.

use std::f64::consts::FRAC_PI_2;

use super::Findings;
use super::events::Events;
use crate::{Dryden, Fan, GroundEffect, Key, Turbulence, Vector, Wind};

impl Turbulence {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        found.not_negative(&at.then("deviation"), "the deviation", self.deviation);
        found.positive(
            &at.then("correlation_time"),
            "the correlation time",
            self.correlation_time,
        );
    }
}

impl Wind {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        let mean = at.then("mean");
        found.vector(&at.then("sine"), &self.sine);
        let frequency = at.then("sine_frequency");
        found.not_negative(&frequency, "the frequency", self.sine_frequency);
        if let Some(gusts) = &self.gusts {
            gusts.check(&at.then("gusts"), found);
        }
        if let Some(dryden) = &self.dryden {
            dryden.check(&at.then("dryden"), found);
            let reason = "without a mean wind no gusts of `dryden` pass the vehicle";
            let fix = "state a wind such as [1.0, 0.0, 0.0], or `gusts` with a correlation time in place of `dryden`";
            found.direction(&mean, &self.mean, reason, fix);
        } else {
            found.vector(&mean, &self.mean);
        }
    }
}

impl Dryden {
    fn check(&self, at: &Key, found: &mut Findings) {
        for (index, (deviation, length)) in self.deviation.iter().zip(&self.length).enumerate() {
            found.not_negative(&at.then("deviation").then(index), "the deviation", *deviation);
            found.positive(&at.then("length").then(index), "the length", *length);
        }
    }
}

impl GroundEffect {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        found.positive(&at.then("rotor_radius"), "the radius", self.rotor_radius);
        found.not_negative(&at.then("factor"), "ρ", self.factor);
        found.number(&at.then("ground"), self.ground);
    }
}

impl Fan {
    pub(super) fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        self.check_switching(duration, at, found);
        found.not_negative(&at.then("run_up"), "the time constant", self.run_up);
        found.vector(&at.then("position"), &self.position);
        check_direction(&self.direction, &at.then("direction"), found);
        found.not_negative(&at.then("force"), "the force", self.force);
        found.positive(
            &at.then("reference_distance"),
            "the distance",
            self.reference_distance,
        );
        self.check_half_angle(&at.then("half_angle"), found);
        found.not_negative(&at.then("turbulence"), "the fluctuation", self.turbulence);
        found.positive(
            &at.then("correlation_time"),
            "the correlation time",
            self.correlation_time,
        );
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
                    "the fan is switched off at {off_at:?} s, but on only at {:?} s",
                    self.on_at
                ),
                "raise `off_at` above `on_at`, or leave the fan out",
            );
        }
    }

    fn check_half_angle(&self, key: &Key, found: &mut Findings) {
        if found.positive(key, "half the opening angle", self.half_angle) && self.half_angle >= FRAC_PI_2 {
            found.add(
                key.clone(),
                format!(
                    "half the opening angle = {:?} rad is not below π/2, so the jet has no direction",
                    self.half_angle
                ),
                "give an angle between 0 and 1.57; a free jet has about 0.2",
            );
        }
    }

    fn check_moves(&self, duration: f64, at: &Key, found: &mut Findings) {
        for (index, place) in self.moves.iter().enumerate() {
            let at = at.then(index);
            found.vector(&at.then("position"), &place.position);
            check_direction(&place.direction, &at.then("direction"), found);
        }
        let moves = Events {
            one: "move",
            several: "moves",
            at: at.clone(),
            times: self.moves.iter().map(|place| place.at).collect(),
        };
        moves.check(duration, found);
        if self.moves.first().is_some_and(|place| place.at == 0.0) {
            found.add(
                at.then(0).then("at"),
                "the fan is moved at 0.0 s, when it stands at `position`",
                "state the first place as the fan's `position` and `direction`",
            );
        }
    }
}

fn check_direction(direction: &Vector, key: &Key, found: &mut Findings) {
    let fix = "give a direction of any length, such as [1.0, 0.0, 0.0]";
    found.direction(key, direction, "the fan blows in no direction", fix);
}
