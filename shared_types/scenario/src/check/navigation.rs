//! Checks of flight outdoors: sensors, their rates, and the estimator over them.

use super::Findings;
use super::envelope::check_box;
use super::six_digits;
use crate::navigation::LONGEST_HORIZON;
use crate::{FixChange, Key, Navigation, Scenario, Sensors, Timing, Volume};
use shared_types::flight_phase::ARM_WITHIN;
use shared_types::navigation_limits::{
    ALIGNMENT, LONGEST_IMU_PERIOD_NS, STORED_MEASUREMENTS, STORED_SAMPLES,
};
use shared_types::schedule::Schedule;
use shared_types::service::seconds;
use shared_types::wiring::{ServiceId, Topic};

/// Time for the first fixes after the alignment, s.
const SETTLES: f64 = 1.0;

/// Shortest horizontal baseline of two antennas, m: there the heading is as uncertain as that by a field.
const SHORTEST_BASELINE: f64 = 0.1;

impl Scenario {
    pub(super) fn check_outdoors(&self, found: &mut Findings) {
        if let Some(sensors) = &self.sensors {
            sensors.check(self.duration, &Key::root().then("sensors"), found);
        }
        if self.datum.is_some() && self.sensors.is_none() && self.navigation.is_none() {
            found.add(
                Key::root().then("datum"),
                "only a satellite receiver needs a place on the earth, and there is none",
                "add `[sensors]`, which may be empty, or leave `[datum]` out",
            );
        }
        let Timing {
            period,
            phase,
            latency,
            ..
        } = &self.schedule;
        for (table, times) in [("period", period), ("phase", phase), ("latency", latency)] {
            for name in times.keys() {
                if let Some(topic) = name.split(" -> ").next().and_then(Topic::from_name) {
                    self.check_published(topic, Key::root().then("schedule").then(table).then(name), found);
                }
            }
        }
        self.check_navigation(found);
    }

    /// Requires that something is published on the topic that a key names.
    pub(super) fn check_published(&self, topic: Topic, key: Key, found: &mut Findings) {
        // That inertial navigation lacks its sensors is reported once.
        let is_reported =
            self.navigation.is_some() && self.sensors.is_none() && topic.is_of_flight_outdoors();
        if topic == Topic::MocapPose && self.fuses_poses() == Some(false) {
            found.add(
                key,
                "no camera captures a vehicle with inertial navigation",
                "leave it out, name a sensor, such as `gnss/fix`, or add `[navigation.poses]`",
            );
        } else if !self.has_topic(topic) && !is_reported {
            let section = match topic {
                Topic::PoseInnovations => "`[navigation.poses]`",
                Topic::GnssBaseline | Topic::BaselineInnovations => "`navigation.baseline`",
                topic if topic.is_of_flight_outdoors() => "`[sensors]`",
                _ => "`controller.telemetry`",
            };
            found.add(
                key,
                format!("the flight has no `{topic}`"),
                format!("add {section}, or leave it out"),
            );
        }
    }

    fn check_navigation(&self, found: &mut Findings) {
        let Some(navigation) = &self.navigation else {
            return;
        };
        let at = Key::root().then("navigation");
        let Some(sensors) = &self.sensors else {
            return found.add(
                at,
                "inertial navigation needs sensors, and there are none",
                "add `[sensors]`, which may be empty, or leave `[navigation]` out",
            );
        };
        let without = "cameras without `[navigation.poses]`";
        let is_unused = |is_stated| is_stated && navigation.poses.is_none();
        let sections = [
            ("estimator", self.estimator.is_some(), "other"),
            ("cameras", is_unused(self.cameras.is_some()), without),
            (
                "motion_capture",
                is_unused(self.motion_capture.is_some()),
                without,
            ),
        ];
        for (section, _, what) in sections.into_iter().filter(|(_, is_stated, _)| *is_stated) {
            found.add(
                Key::root().then(section),
                format!("inertial navigation is the estimator of this flight, and it uses no {what}"),
                format!("leave `[{section}]` or `[navigation]` out"),
            );
        }
        let simulated = self.real_receivers().is_none();
        if simulated && navigation.baseline.is_some() != sensors.gnss.baseline.is_some() {
            found.add(
                at.clone().then("baseline"),
                "the simulated receiver and the estimator differ in whether there is a second antenna",
                "state both `sensors.gnss.baseline` and `navigation.baseline`, or neither",
            );
        }
        if navigation
            .baseline
            .is_some_and(|[x, y, z]| (x * x + y * y).sqrt() < SHORTEST_BASELINE.max(0.5 * z.abs()))
        {
            found.add(
                at.clone().then("baseline"),
                format!(
                    "no heading follows from a baseline of less than {SHORTEST_BASELINE:?} m, or half of its height, along x and y"
                ),
                "the unit is m: place the antennas apart, and beside each other",
            );
        }
        let Some(flight) = &self.flight else {
            return found.add(
                at,
                "inertial navigation is aligned at rest, and this flight begins in the air",
                "add `[flight]` with `arm_at`, or leave `[navigation]` out",
            );
        };
        let is_before = |change: &&FixChange| change.at <= flight.arm_at.unwrap_or(0.0);
        let last = sensors.gnss.change.iter().rfind(is_before);
        let kind = last.map_or(sensors.gnss.kind, |change| change.kind);
        let by_poses = navigation.attainable_sigma(None);
        let attainable = navigation.attainable_sigma(kind.kind()).min(by_poses);
        if attainable.is_infinite() {
            found.add(
                Key::root().then("sensors").then("gnss").then("kind"),
                "the vehicle will never be armed: nothing measures its position",
                "state fixes, or add `[cameras]` and `[navigation.poses]`",
            );
        } else if flight.position_sigma_max <= attainable {
            found.add(
                Key::root().then("flight").then("position_sigma_max"),
                format!(
                    "the vehicle will never be armed: with these fixes the standard deviation of the position stays at {} m",
                    six_digits(attainable)
                ),
                format!("raise it above {}, or improve the fixes", six_digits(2.0 * attainable)),
            );
        }
        let healthy = navigation.ready_at() - SETTLES;
        if let Some(arm_at) = flight.arm_at.filter(|arm_at| arm_at + ARM_WITHIN < healthy) {
            found.add(
                Key::root().then("flight").then("arm_at"),
                format!(
                    "the vehicle will not be armed: at {} s the position is not yet known, for the alignment and \
                     `navigation.healthy_for` take {} s",
                    six_digits(arm_at),
                    six_digits(healthy)
                ),
                format!("raise it to {} or more", six_digits(navigation.ready_at())),
            );
        }
        if let Ok(schedule) = self.schedule() {
            self.check_sensor_rates(navigation.horizon, &schedule, found);
        }
    }

    fn check_sensor_rates(&self, horizon: f64, schedule: &Schedule, found: &mut Findings) {
        let period_of = |topic| seconds(schedule.time_ns(schedule.topic_rate(topic).period));
        let key_of = |topic: Topic| Key::root().then("schedule").then("period").then(topic.name());
        // Spans of real samples jitter, and arming permits 0.8 of the rate.
        let real = self.real_receivers();
        let (share, why) = real.map_or((1.0, ""), |_| (0.5, " that jitter, as real ones do"));
        let imu = period_of(Topic::ImuSample);
        let longest = share * seconds(LONGEST_IMU_PERIOD_NS);
        let shortest = horizon / STORED_SAMPLES as f64;
        if imu > longest || imu <= shortest {
            return found.add(
                key_of(Topic::ImuSample),
                format!("the filter cannot use samples every {imu:?} s{why}"),
                format!(
                    "give `imu/sample` a period between {} and {longest:?}",
                    six_digits(shortest)
                ),
            );
        }
        let estimator = seconds(schedule.time_ns(schedule.service_rate(ServiceId::Estimator).period));
        // Between the captures of real cameras `mocap/pose` has no pose.
        let real_poses = real
            .filter(|_| self.fuses_poses() == Some(true))
            .map(|_| Topic::MocapPose);
        let missed = |topic: &Topic| estimator > period_of(*topic);
        if let Some(topic) = [Topic::ImuSample].into_iter().chain(real_poses).find(missed) {
            let period = period_of(topic);
            found.add(
                Key::root().then("schedule").then("period").then(ServiceId::Estimator.name()),
                format!("it would miss samples of `{topic}`, which come every {period:?} s: a step reads the newest only"),
                format!("give it a period of {period:?} or less, or `{topic}` one of {estimator:?}"),
            );
        }
        // A pose waits as a position and an attitude.
        let poses = [Topic::MocapPose; 2]
            .into_iter()
            .filter(|_| self.fuses_poses() == Some(true));
        let baseline = self.baseline().map(|_| Topic::GnssBaseline);
        let gnss = self.sensors.as_ref().map(|sensors| &sensors.gnss);
        let has_fixes = real.is_some() || gnss.is_some_and(|gnss| gnss.least_accurate().is_some());
        let mut others: Vec<_> = [Topic::GnssFix, Topic::BaroAltitude, Topic::MagField]
            .into_iter()
            .filter(|&topic| has_fixes || topic != Topic::GnssFix)
            .chain(baseline)
            .chain(poses)
            .collect();
        let waiting: f64 = others.iter().map(|topic| horizon / period_of(*topic) + 1.0).sum();
        if waiting > STORED_MEASUREMENTS as f64 {
            let shortest = |a: &Topic, b: &Topic| period_of(*a).total_cmp(&period_of(*b));
            let topic = others.iter().copied().min_by(shortest).unwrap_or(Topic::GnssFix);
            found.add(
                key_of(topic),
                format!("{waiting:.0} measurements would wait for the filter's horizon, more than {STORED_MEASUREMENTS}"),
                "give fixes and baselines a period of 0.1, altitudes one of 0.04, fields one of 0.02 and poses one of 0.01",
            );
        }
        others.dedup();
        for topic in others {
            let simulated = seconds(schedule.time_ns(schedule.latency_of(ServiceId::Estimator, topic)));
            let (stated, of_cameras) = match topic {
                Topic::MocapPose => ("motion_capture.latency", Some(seconds(self.capture_latency_ns()))),
                Topic::GnssFix | Topic::GnssBaseline => ("receivers.fix_latency", None),
                _ => ("receivers.latency", None),
            };
            let real = real.map(|receivers| of_cameras.unwrap_or(receivers.latency_of(topic)));
            let cameras = self.cameras.as_ref().filter(|_| topic == Topic::MocapPose);
            let jitter = cameras.map_or(0.0, |cameras| cameras.jitter);
            if real.is_some() && simulated > 0.0 {
                let edge = format!("{topic} -> estimator");
                found.add(
                    Key::root().then("schedule").then("latency").then(edge.as_str()),
                    format!(
                        "real samples are late by themselves, and would be held back for {simulated:?} s"
                    ),
                    format!("leave it out, and state `{stated}`"),
                );
                continue;
            }
            // A real sample arrives between two ticks of its topic, and waits for the next.
            let (late, waits) = real.map_or((simulated + jitter, imu), |late| (late, period_of(topic)));
            if late + waits > horizon {
                let needed = late + waits + imu;
                let fix = match real {
                    _ if needed <= LONGEST_HORIZON => format!("raise it to {} or more", six_digits(needed)),
                    None => format!("it is {LONGEST_HORIZON} at most: lower `schedule.latency` of the input"),
                    Some(_) => format!(
                        "it is {LONGEST_HORIZON} at most: let the sender send sooner (`{stated}`), or more often \
                         (`schedule.period.\"{topic}\"`)"
                    ),
                };
                found.add(
                    Key::root().then("navigation").then("horizon"),
                    format!(
                        "samples of `{topic}` are late by {late:?} s and wait for up to {waits:?} s, and the filter would refuse them"
                    ),
                    fix,
                );
            }
        }
    }
}

impl Navigation {
    /// Returns a time at which the vehicle can be armed, s.
    pub(super) fn ready_at(&self) -> f64 {
        ALIGNMENT + self.healthy_for + SETTLES
    }
}

impl Sensors {
    fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        let at = at.then("gnss");
        if let Some(Volume { min, max }) = &self.gnss.building {
            check_box([min, max], &at.then("building"), found);
        }
        let times: Vec<_> = self.gnss.change.iter().map(|change| change.at).collect();
        let changes = ["change of the fixes", "changes of the fixes"];
        found.check_events(changes, &at.then("change"), &times, duration);
        let mut kind = self.gnss.kind;
        for (index, change) in self.gnss.change.iter().enumerate() {
            if change.kind == kind {
                found.add(
                    at.then("change").then(index).then("kind"),
                    "the receiver solves this already",
                    "state another kind, or leave the change out",
                );
            }
            kind = change.kind;
        }
        let spans = self.gnss.spoofing.iter().map(|event| (event.at, event.lasts));
        let spoofing = ["spoofing", "intervals of spoofing"];
        found.check_intervals(spoofing, &at.then("spoofing"), spans, duration);
    }
}
