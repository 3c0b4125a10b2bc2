use super::*;
use mavlink_frame::Sender;
use navigation_receivers::autopilot::Heartbeat;
use navigation_receivers::ubx::{Carrier, Heading, Solution};
use proptest::prelude::*;
use shared_types::samples::{BaroAltitude, ImuSample, MagField};
use shared_types::service::{OutputSlot, Outputs};
use zerocopy::IntoBytes;

/// Offset of the sender's clock: the local one began before it, ns.
const OFFSET_NS: u64 = 5_000_000_000;
const MS: u64 = 1_000_000;
const LATENCIES_NS: [u64; 2] = [2 * MS, 100 * MS];
const AUTOPILOT: Sender = Sender {
    system: 1,
    component: 1,
};

/// Feed of a vehicle that stands 0.2 m below the origin.
fn feed() -> ReceiverFeed {
    ReceiverFeed::new(LATENCIES_NS, -0.2, true).with_baselines(true)
}

/// Sample that was measured at a time of the sender's clock, ms, with a rate about x and an altitude.
fn inertial(at_ms: u64, rate: f64, altitude: f64) -> HighresImu {
    HighresImu {
        time_us: at_ms * 1000,
        specific_force_body: Some([0.0, 0.0, -9.81]),
        angular_velocity_body: Some([rate, 0.0, 0.0]),
        field_body: Some([0.2, 0.0, 0.4]),
        pressure: None,
        pressure_altitude: Some(altitude),
        temperature: None,
        sensor: 0,
    }
}

fn pvt(week_time_ms: u32, latitude: f64) -> NavPvt {
    NavPvt {
        time_of_week_ms: week_time_ms,
        utc_ns: None,
        time_accuracy: 1e-9,
        solution: Solution::ThreeDimensional,
        is_valid: true,
        has_corrections: true,
        carrier: Carrier::Fixed,
        satellites: 20,
        latitude,
        longitude: 11.5,
        height: 565.0,
        height_above_sea: 518.0,
        velocity_ned: [1.0, 2.0, 3.0],
        horizontal_accuracy: 0.014,
        vertical_accuracy: 0.02,
        speed_accuracy: 0.05,
        position_dilution: 1.0,
        heading: None,
    }
}

fn raw(at_ms: u64, fix_type: u8) -> GpsRawInt {
    GpsRawInt {
        time_us: at_ms * 1000,
        fix_type,
        satellites: Some(20),
        latitude: 48.0,
        longitude: 11.5,
        height_above_sea: 518.0,
        height: Some(565.0),
        ground_speed: Some(1.0),
        course: None,
        accuracies: Some([0.5, 0.8, 0.2]),
        heading: None,
    }
}

/// Adds inertial samples every 4 ms until a time of the sender's clock, ms, each of which takes 3 ms.
fn add_inertial(feed: &mut ReceiverFeed, times_ms: std::ops::Range<u64>) {
    for at_ms in times_ms.step_by(4) {
        let packet = Packet::HighresImu(AUTOPILOT, inertial(at_ms, at_ms as f64, 30.0));
        feed.add(&packet, 0, OFFSET_NS + (at_ms + 3) * MS);
    }
}

/// Samples at a tick.
struct Published {
    imu: ImuSample,
    fix: GnssFix,
    altitude: BaroAltitude,
    field: MagField,
    baseline: GnssBaseline,
}

/// Publishes at a time of the sender's clock, ms, in a flight that began with that clock.
fn publish(feed: &mut ReceiverFeed, at_ms: u64) -> Published {
    let (mut imu, mut fix) = (ImuSample::new_zeroed(), GnssFix::new_zeroed());
    let (mut altitude, mut field) = (BaroAltitude::new_zeroed(), MagField::new_zeroed());
    let mut baseline = GnssBaseline::new_zeroed();
    let bytes = [
        None,
        None,
        Some(imu.as_mut_bytes()),
        Some(fix.as_mut_bytes()),
        Some(altitude.as_mut_bytes()),
        Some(field.as_mut_bytes()),
        Some(baseline.as_mut_bytes()),
    ];
    let mut slots = bytes.map(|bytes| OutputSlot { bytes });
    let mut outputs = PlantOutputs::from_slots(&mut slots);
    feed.publish(OFFSET_NS + at_ms * MS, OFFSET_NS, &mut outputs);
    Published {
        imu,
        fix,
        altitude,
        field,
        baseline,
    }
}

#[test]
fn inertial_samples_are_published_as_their_mean_at_the_time_of_the_last_one() {
    let mut feed = feed();
    add_inertial(&mut feed, 0..400);
    publish(&mut feed, 396);
    add_inertial(&mut feed, 400..412);
    // The fastest packet took 3 ms, of which 2 are stated.
    assert!(
        !publish(&mut feed, 396).imu.measured.is_set(),
        "not in the future"
    );
    let published = publish(&mut feed, 409);
    assert!(published.imu.measured.is_set());
    assert_eq!(published.imu.measured_ns, 409 * MS);
    let mean: f64 = [396.0, 400.0, 404.0, 408.0].iter().sum::<f64>() / 4.0;
    assert_eq!(published.imu.angular_velocity_body[0], mean);
    assert_eq!(published.imu.specific_force_body[2], -9.81);
    assert_eq!(published.field.field_body, [0.2, 0.0, 0.4]);
    assert!(!publish(&mut feed, 410).imu.measured.is_set(), "once");
}

/// Adds inertial samples every 4 ms, each of which takes 3 ms, a delay that changes every second, and one of its own, µs. Returns stamps
/// and times of those that are used, ns of the sender's clock.
fn timed(feed: &mut ReceiverFeed, delays_us: &[u64], own_us: &[u64]) -> Vec<(u64, u64)> {
    let mut times = Vec::new();
    let mut arrived_ns = 0;
    for (index, own_us) in (0_u64..).zip(own_us) {
        let at_ms = 4 * index;
        let delay_us = delays_us[usize::try_from(at_ms / 1000).unwrap() % delays_us.len()];
        arrived_ns = arrived_ns.max(OFFSET_NS + (at_ms + 3) * MS + (delay_us + own_us) * 1000);
        let packet = Packet::HighresImu(AUTOPILOT, inertial(at_ms, 0.0, 30.0));
        feed.add(&packet, 0, arrived_ns);
        let used = feed.inertial.0.drain(..);
        times.extend(used.map(|(time_ns, _)| (at_ms * MS, time_ns - OFFSET_NS)));
    }
    times
}

proptest! {
    /// A rate is integrated over these spans: one that is too long by 4 ms turns the vehicle by 4 mrad at 1 rad/s.
    #[test]
    fn spans_of_inertial_samples_are_those_of_their_stamps(
        delays_us in prop::collection::vec(0..7000_u64, 5),
        own_us in prop::collection::vec(0..2000_u64, 1250),
    ) {
        let times = timed(&mut feed(), &delays_us, &own_us);
        // Those of the first 0.2 s relate the clocks.
        prop_assert!(times.len() > 1190, "{}", times.len());
        for pair in times.windows(2) {
            let [(stamp_ns, time_ns), (next_stamp_ns, next_ns)] = [pair[0], pair[1]];
            let stamps_ns = next_stamp_ns - stamp_ns;
            prop_assert_eq!(stamps_ns, 4 * MS, "none is lost");
            prop_assert!((next_ns - time_ns).abs_diff(stamps_ns) <= stamps_ns / 100, "{pair:?}");
            // The fastest packet took 3 ms, of which 2 are stated.
            prop_assert!((stamp_ns..=stamp_ns + 11 * MS).contains(&time_ns), "{pair:?}");
        }
    }

    #[test]
    fn a_span_that_is_not_that_of_the_stamps_is_a_gap(
        delays_us in prop::collection::vec(0..50_000_u64, 5),
        own_us in prop::collection::vec(0..8000_u64, 1250),
    ) {
        let times = timed(&mut feed(), &delays_us, &own_us);
        prop_assert!(times.len() > 900, "{}", times.len());
        for pair in times.windows(2) {
            let (stamps_ns, span_ns) = (pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
            prop_assert!(
                span_ns.abs_diff(stamps_ns) <= stamps_ns / 100 || span_ns > LONGEST_IMU_PERIOD_NS,
                "{pair:?}"
            );
        }
    }
}

#[test]
fn a_restarted_driver_continues_the_spans() {
    let mut before = feed();
    add_inertial(&mut before, 0..400);
    let last_ns = before.motion.last_ns;
    let mut after = ReceiverFeed::new(LATENCIES_NS, -0.2, false).with_baselines(true);
    after.restore(&before.save(), OFFSET_NS + 401 * MS);
    // 5 ms late: the clock's line does not follow yet, and neither does the time.
    let packet = Packet::HighresImu(AUTOPILOT, inertial(400, 0.0, 30.0));
    after.add(&packet, 0, OFFSET_NS + 408 * MS);
    assert_eq!(after.inertial.0[0].0, last_ns + 4 * MS);
}

#[test]
fn the_first_altitude_is_that_of_the_vehicle_on_the_ground() {
    let mut on_ground = feed();
    add_inertial(&mut on_ground, 0..400);
    let packet = Packet::HighresImu(AUTOPILOT, inertial(400, 0.0, 31.5));
    on_ground.add(&packet, 0, OFFSET_NS + 403 * MS);
    assert!((publish(&mut on_ground, 402).altitude.altitude - 1.3).abs() < 1e-12);
    let mut in_flight = ReceiverFeed::new(LATENCIES_NS, -0.2, false).with_baselines(true);
    add_inertial(&mut in_flight, 0..400);
    assert!(!publish(&mut in_flight, 402).altitude.measured.is_set());
    in_flight.restore(&on_ground.save(), OFFSET_NS + 404 * MS);
    let packet = Packet::HighresImu(AUTOPILOT, inertial(404, 0.0, 32.5));
    in_flight.add(&packet, 0, OFFSET_NS + 407 * MS);
    let altitude = publish(&mut in_flight, 406).altitude;
    assert!(altitude.measured.is_set(), "its clock is that of its predecessor");
    assert!((altitude.altitude - 2.3).abs() < 1e-12);
}

#[test]
fn a_fix_states_when_it_was_valid_and_continues_at_the_end_of_a_week() {
    let mut feed = feed();
    // 1 s before the end of the week; a fix takes 130 ms, of which 100 are stated.
    let week_ms = 604_800_000;
    for k in 0..20 {
        let week_time_ms = (week_ms - 1000 + 100 * k) % week_ms;
        let packet = Packet::NavPvt(pvt(week_time_ms, 48.0 + f64::from(k)));
        feed.add(&packet, 0, OFFSET_NS + u64::from(100 * k + 130) * MS);
    }
    let fix = publish(&mut feed, 1931).fix;
    assert_eq!(fix.valid_ns, 1930 * MS);
    assert_eq!(
        (fix.latitude, fix.velocity_ned, fix.kind),
        (67.0, [1.0, 2.0, 3.0], 2)
    );
    assert!(fix.measured.is_set());
    let figures = feed.figures(0, 0);
    assert_eq!((figures.mistimed, figures.clock_steps), (0, 0));
}

#[test]
fn a_late_packet_or_another_receiver_does_not_begin_another_week() {
    let mut feed = feed();
    let week_ms = 604_800_000;
    // The last seconds of the week; the packet of its last 100 ms comes after the first of the next.
    let order = (0..10).chain([11, 10]).chain(12..20);
    let mut arrived_ns = 0;
    for k in order {
        arrived_ns = arrived_ns.max(OFFSET_NS + u64::from(100 * k + 130) * MS);
        let packet = Packet::NavPvt(pvt((week_ms - 1100 + 100 * k) % week_ms, 48.0));
        feed.add(&packet, 0, arrived_ns);
        feed.add(&Packet::NavPvt(pvt(0, 0.0)), 1, arrived_ns);
    }
    let fix = publish(&mut feed, 1931).fix;
    assert_eq!((fix.valid_ns, fix.latitude), (1930 * MS, 48.0));
    let figures = feed.figures(0, 0);
    assert_eq!((figures.foreign, figures.clock_steps), (20, 0));
    assert_eq!((figures.repeated, figures.mistimed), (0, 1));
}

#[test]
fn fixes_of_an_autopilot_have_no_velocity_and_those_of_a_receiver_replace_them() {
    let mut feed = feed();
    for k in 0..10 {
        let packet = Packet::GpsRawInt(AUTOPILOT, raw(100 * k, 5));
        feed.add(&packet, 0, OFFSET_NS + (100 * k + 130) * MS);
    }
    let fix = publish(&mut feed, 1000).fix;
    assert_eq!((fix.kind, fix.velocity_ned), (1, [0.0; 3]));
    assert_eq!(
        [fix.horizontal_accuracy, fix.vertical_accuracy, fix.speed_accuracy],
        [0.5, 0.8, 100.0]
    );
    for k in 10..20 {
        let packet = Packet::GpsRawInt(AUTOPILOT, raw(100 * k, 5));
        feed.add(&packet, 0, OFFSET_NS + (100 * k + 130) * MS);
        let packet = Packet::NavPvt(pvt(100 * u32::try_from(k).unwrap(), 48.5));
        feed.add(&packet, 1, OFFSET_NS + (100 * k + 131) * MS);
    }
    assert_eq!(publish(&mut feed, 2000).fix.latitude, 48.5);
    assert_eq!(feed.figures(0, 0).foreign, 9);
}

#[test]
fn what_is_no_sample_is_counted() {
    let mut feed = feed();
    add_inertial(&mut feed, 0..400);
    let again = Packet::HighresImu(AUTOPILOT, inertial(396, 0.0, 30.0));
    feed.add(&again, 0, OFFSET_NS + 400 * MS);
    let of_another = Sender {
        system: 2,
        component: 1,
    };
    let packet = Packet::HighresImu(of_another, inertial(400, 0.0, 30.0));
    feed.add(&packet, 0, OFFSET_NS + 403 * MS);
    let late = Packet::HighresImu(AUTOPILOT, inertial(404, 0.0, 30.0));
    feed.add(&late, 0, OFFSET_NS + 600 * MS);
    let heartbeat = Heartbeat {
        autopilot: 12,
        kind: 2,
        is_armed: false,
    };
    feed.add(&Packet::Heartbeat(AUTOPILOT, heartbeat), 0, OFFSET_NS + 601 * MS);
    for k in 0..10 {
        let mut without = pvt(100 * k, 48.0);
        without.solution = Solution::None;
        feed.add(
            &Packet::NavPvt(without),
            0,
            OFFSET_NS + u64::from(100 * k + 700) * MS,
        );
    }
    let figures = feed.figures(OFFSET_NS, OFFSET_NS);
    let counted = |name: &str| {
        figures
            .happened()
            .find(|(what, _)| *what == name)
            .map(|(_, count)| count)
    };
    assert_eq!(counted("repeated"), Some(1));
    assert_eq!(counted("foreign"), Some(1));
    assert_eq!(counted("mistimed"), Some(1));
    assert_eq!(counted("without a position"), Some(10));
    // Before the clock was known.
    assert_eq!(counted("unsettled"), Some(50));
    assert_eq!(figures.samples, [50, 0, 50, 50]);
}

#[test]
fn a_feed_that_nobody_empties_keeps_the_newest_samples() {
    let mut feed = feed();
    add_inertial(&mut feed, 0..1000);
    let published = publish(&mut feed, 1001);
    let oldest = 996 - 4 * (WAITING as u64 - 1);
    assert_eq!(
        published.imu.angular_velocity_body[0],
        (996 + oldest) as f64 / 2.0
    );
    assert!(feed.figures(0, 0).left_out > 0);
}

#[test]
fn the_same_autopilot_by_another_source_replaces_a_source_that_is_silent() {
    let mut feed = feed();
    add_inertial(&mut feed, 0..400);
    let last = publish(&mut feed, 398).imu;
    assert_eq!(last.measured_ns, 397 * MS);
    let other_vehicle = Sender {
        system: 2,
        component: 1,
    };
    let mut foreign = 0;
    for at_ms in (400..1000_u64).step_by(4) {
        // The last packet arrived at 399 ms.
        let arrived_ns = OFFSET_NS + (at_ms + 3) * MS;
        let mut sample = inertial(at_ms, 1.0, 30.0);
        sample.sensor = 3;
        feed.add(&Packet::HighresImu(other_vehicle, sample), 0, arrived_ns);
        feed.add(&Packet::HighresImu(AUTOPILOT, sample), 1, arrived_ns);
        foreign += 1 + u64::from(at_ms + 3 <= 399 + 100);
        assert_eq!(feed.figures(0, 0).foreign, foreign, "{at_ms} ms");
    }
    let published = publish(&mut feed, 998).imu;
    assert_eq!(published.measured_ns, 997 * MS);
    // The source that was silent remains replaced.
    let back = Packet::HighresImu(AUTOPILOT, inertial(1000, 0.0, 30.0));
    feed.add(&back, 0, OFFSET_NS + 1003 * MS);
    assert_eq!(feed.figures(0, 0).foreign, foreign + 1);
    let restored = Timeline::restored(&feed.motion.save(), feed.arrived_ns);
    assert_eq!(restored.origin, feed.motion.origin);
}

#[test]
fn another_receiver_replaces_one_that_is_silent_and_an_autopilot_does_not() {
    let mut feed = feed().with_baselines(false);
    let mut add = |k: u32, source: u8, latitude: f64| {
        let packet = Packet::NavPvt(pvt(100 * k, latitude));
        feed.add(&packet, source, OFFSET_NS + u64::from(100 * k + 130) * MS);
        let fix = Packet::GpsRawInt(AUTOPILOT, raw(u64::from(100 * k), 5));
        feed.add(&fix, 2, OFFSET_NS + u64::from(100 * k + 131) * MS);
    };
    for k in 0..10 {
        add(k, 0, 48.0);
    }
    for k in 10..30 {
        add(k, 1, 49.0);
    }
    // Ten packets of the other receiver while the first was silent for no more than 1 s, and all of the autopilot.
    assert_eq!(feed.figures(0, 0).foreign, 10 + 30);
    let fix = publish(&mut feed, 2931).fix;
    assert_eq!((fix.latitude, fix.valid_ns), (49.0, 2930 * MS));
}

#[test]
fn of_two_antennas_the_second_gives_no_fix_after_the_first() {
    let mut feed = feed();
    for k in 0..40 {
        let source = u8::from(k >= 10);
        let fix = Packet::NavPvt(pvt(100 * k, 48.0 + f64::from(source)));
        feed.add(&fix, source, OFFSET_NS + u64::from(100 * k + 130) * MS);
    }
    assert_eq!(feed.figures(0, 0).foreign, 30);
    assert_eq!(publish(&mut feed, 3931).fix.latitude, 48.0);
}

#[test]
fn a_receiver_without_a_position_takes_no_place_from_an_autopilot_that_has_one() {
    let mut feed = feed();
    let add = |feed: &mut ReceiverFeed, k: u32, solution: Solution| {
        let mut fix = pvt(100 * k, 49.0);
        fix.solution = solution;
        feed.add(&Packet::NavPvt(fix), 0, OFFSET_NS + u64::from(100 * k + 130) * MS);
        let raw = Packet::GpsRawInt(AUTOPILOT, raw(u64::from(100 * k), 5));
        feed.add(&raw, 1, OFFSET_NS + u64::from(100 * k + 131) * MS);
    };
    for k in 0..30 {
        add(&mut feed, k, Solution::None);
    }
    assert_eq!(
        feed.fixes.origin,
        Some(Origin::new(1, AUTOPILOT.system, AUTOPILOT.component))
    );
    for k in 30..60 {
        add(&mut feed, k, Solution::ThreeDimensional);
    }
    assert_eq!(feed.fixes.origin, Some(Origin::new(0, 0, 0)));
    assert_eq!(publish(&mut feed, 5931).fix.latitude, 49.0);
}

fn relative(week_time_ms: u32, carrier: Carrier) -> RelativePosition {
    RelativePosition {
        time_of_week_ms: week_time_ms,
        baseline_ned: [0.6, 0.8, 0.1],
        accuracies_ned: [0.006, 0.006, 0.01],
        length: 1.005,
        carrier,
        is_valid: true,
        is_moving: true,
        heading: Some(Heading {
            angle: 0.93,
            deviation: 0.006,
        }),
    }
}

/// At the end of a week too; that of a base station never.
#[test]
fn baselines_of_two_antennas_are_published_at_their_time_of_validity() {
    let mut feed = feed();
    let begin_ms = 604_799_000;
    let add = |feed: &mut ReceiverFeed, at_ms: u64, relative: RelativePosition| {
        feed.add(
            &Packet::RelativePosition(relative),
            1,
            OFFSET_NS + (at_ms + 100) * MS,
        );
    };
    let week_ms = |at_ms: u64| u32::try_from((begin_ms + at_ms) % 604_800_000).unwrap();
    for at_ms in (0..2000).step_by(100) {
        add(&mut feed, at_ms, relative(week_ms(at_ms), Carrier::Fixed));
    }
    let published = publish(&mut feed, 2000).baseline;
    assert!(
        published.measured.is_set() && published.fixed.is_set(),
        "{published:?}"
    );
    assert_eq!(published.valid_ns, 1900 * MS);
    assert_eq!(published.baseline_ned, [0.6, 0.8, 0.1]);
    assert_eq!(published.accuracies_ned, [0.006, 0.006, 0.01]);
    assert!(!publish(&mut feed, 2001).baseline.measured.is_set(), "once");

    add(&mut feed, 2000, relative(week_ms(2000), Carrier::Float));
    assert!(!publish(&mut feed, 2100).baseline.fixed.is_set());
    let before = feed.figures(0, 0);
    let base_station = RelativePosition {
        is_moving: false,
        ..relative(week_ms(2100), Carrier::Fixed)
    };
    add(&mut feed, 2100, base_station);
    let invalid = RelativePosition {
        is_valid: false,
        ..relative(week_ms(2200), Carrier::Fixed)
    };
    add(&mut feed, 2200, invalid);
    let after = feed.figures(0, 0);
    assert_eq!(after.foreign, before.foreign + 1);
    assert_eq!(after.without_position, before.without_position + 1);
    assert!(!publish(&mut feed, 2300).baseline.measured.is_set());

    // A restarted driver continues with their clock.
    let memory = feed.save();
    let now_ns = OFFSET_NS + 2300 * MS;
    let mut restarted = ReceiverFeed::new(LATENCIES_NS, -0.2, false).with_baselines(true);
    restarted.restore(&memory, now_ns);
    add(&mut restarted, 2300, relative(week_ms(2300), Carrier::Fixed));
    assert_eq!(publish(&mut restarted, 2400).baseline.valid_ns, 2300 * MS);
}
