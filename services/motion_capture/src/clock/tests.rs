use proptest::prelude::*;

use super::*;

const MS: i64 = 1_000_000;

/// Sender at 100 Hz, with its clock and the delays of its packets.
struct Sender {
    offset_ns: i64,
    drift: f64,
    random: u64,
}

impl Sender {
    fn next(&mut self) -> f64 {
        // xorshift64*
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        let bits = self.random.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        bits as f64 / (1_u64 << 53) as f64
    }

    /// Stamp and arrival of the packet that is sent at a local time.
    fn packet(&mut self, sent_local_ns: i64) -> (i64, u64) {
        let delay = 0.2e-3 - 0.5e-3 * libm::log(1.0 - self.next());
        // One packet in fifty is held up.
        let delay = if self.next() < 0.02 { delay + 0.03 } else { delay };
        let stamp = sent_local_ns + self.offset_ns + (sent_local_ns as f64 * self.drift) as i64;
        (stamp, (sent_local_ns + (delay * 1e9) as i64) as u64)
    }
}

/// Runs the clock for some seconds from a time on. Returns the largest error of a mapped stamp, ns.
fn listen(clock: &mut RemoteClock, sender: &mut Sender, from_s: i64, seconds: i64) -> (i64, u32) {
    let (mut worst, mut mapped) = (0, 0);
    let mut last_arrival = 0;
    for tick in 0..seconds * 100 {
        let sent = from_s * 1_000_000_000 + tick * 10 * MS;
        let (stamp, arrival) = sender.packet(sent);
        last_arrival = arrival.max(last_arrival);
        if let Mapped::At(at) = clock.map(stamp, last_arrival) {
            // The minimum delay of 0.2 ms cannot be distinguished from an offset of the clock.
            worst = worst.max((at - sent - MS / 5).abs());
            mapped += 1;
        }
    }
    (worst, mapped)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn stamps_are_mapped_for_any_clocks_and_jitter(
        offset_s in -1_000_000_000i64..1_000_000_000,
        drift_ppm in -100.0..100.0f64,
        seed in 1u64..,
    ) {
        let mut clock = RemoteClock::new();
        let mut sender = Sender { offset_ns: offset_s * 1_000_000_000, drift: drift_ppm * 1e-6, random: seed };
        // With a few windows only, drift is not known yet.
        let (worst, mapped) = listen(&mut clock, &mut sender, 1, 10);
        prop_assert!(worst < MS, "{worst} ns in the first seconds");
        prop_assert!(mapped > 950);
        listen(&mut clock, &mut sender, 11, 10);
        let (worst, mapped) = listen(&mut clock, &mut sender, 21, 60);
        prop_assert!(worst < MS / 4, "{worst} ns");
        prop_assert_eq!(mapped, 6000);
        let error = clock.drift() + drift_ppm * 1e-6;
        prop_assert!(error.abs() < 2e-5, "drift is off by {error}");
    }

    #[test]
    fn single_wrong_stamps_have_no_effect(seed in 1u64.., lies in prop::collection::vec(any::<i64>(), 1..20)) {
        let mut clock = RemoteClock::new();
        let mut sender = Sender { offset_ns: 77, drift: 3e-5, random: seed };
        listen(&mut clock, &mut sender, 1, 20);
        let before = clock.clone();
        for lie in lies {
            prop_assert!(!matches!(clock.map(lie, 21_000_000_000), Mapped::At(at) if (at - 21_000_000_000).abs() > 70 * MS));
        }
        prop_assert_eq!(clock.drift(), before.drift());
        let (worst, _) = listen(&mut clock, &mut sender, 21, 10);
        prop_assert!(worst < MS, "{worst} ns");
    }

    #[test]
    fn a_clock_that_is_set_is_followed(seed in 1u64.., step_ms in prop_oneof![-100_000i64..-70, 70..100_000i64]) {
        let mut clock = RemoteClock::new();
        let mut sender = Sender { offset_ns: 0, drift: 1e-5, random: seed };
        listen(&mut clock, &mut sender, 1, 20);
        sender.offset_ns += step_ms * MS;
        let (worst, mapped) = listen(&mut clock, &mut sender, 21, 10);
        prop_assert!(worst < MS, "{worst} ns");
        prop_assert!(mapped > 900, "{mapped}");
    }

    /// Cannot be distinguished from an increased network delay.
    #[test]
    fn a_clock_that_is_set_back_a_little_is_followed_too(seed in 1u64.., step_ms in 6i64..50) {
        let mut clock = RemoteClock::new();
        let mut sender = Sender { offset_ns: 0, drift: -1e-5, random: seed };
        listen(&mut clock, &mut sender, 1, 20);
        sender.offset_ns -= step_ms * MS;
        let (worst, _) = listen(&mut clock, &mut sender, 21, 3);
        prop_assert!(worst <= step_ms * MS + MS);
        let (worst, _) = listen(&mut clock, &mut sender, 24, 10);
        prop_assert!(worst < MS, "{worst} ns");
    }
}

/// A network delay that increases, for a while or permanently, costs no pose: the time error is at most the delay.
#[test]
fn a_slower_network_bends_the_line_and_refuses_nothing() {
    for (extra_ms, until_s) in [(0, 6.0), (3, 6.0), (6, 5.2), (6, 6.0), (10, 60.0), (20, 7.0)] {
        let mut clock = RemoteClock::new();
        let mut sender = Sender {
            offset_ns: 5,
            drift: 2e-5,
            random: 9,
        };
        let mut last_arrival = 0;
        for tick in 0..3000_i64 {
            let sent = 1_000_000_000 + tick * 10 * MS;
            let seconds = tick as f64 * 0.01;
            let extra = if (4.0..until_s).contains(&seconds) {
                extra_ms * MS
            } else {
                0
            };
            let (stamp, arrival) = sender.packet(sent);
            last_arrival = (arrival + extra.unsigned_abs()).max(last_arrival);
            let mapped = clock.map(stamp, last_arrival);
            let case = format!("{extra_ms} ms until {until_s} s, at {seconds} s");
            if tick > 20 {
                let Mapped::At(at) = mapped else {
                    panic!("{case}: {mapped:?}")
                };
                let error = (at - sent - MS / 5).abs();
                assert!(error < extra_ms * MS + MS, "{case}: {error} ns");
                // Two windows after the end of the delay nothing is left of it.
                assert!(seconds < until_s + 1.5 || error < MS, "{case}: {error} ns");
            }
        }
        assert!(clock.drift().abs() < 1e-4 + 1e-9);
    }
}

#[test]
fn a_stamp_that_is_early_by_mistake_is_forgotten_after_two_windows() {
    let mut clock = RemoteClock::new();
    let mut sender = Sender {
        offset_ns: 0,
        drift: 0.0,
        random: 3,
    };
    listen(&mut clock, &mut sender, 1, 20);
    let early = 21_000_000_000 - 30 * MS;
    assert!(matches!(
        clock.map(21_000_000_000 - MS, early as u64 + 1),
        Mapped::At(_)
    ));
    let (worst, mapped) = listen(&mut clock, &mut sender, 21, 2);
    assert!(worst < 31 * MS && mapped == 200);
    let (worst, mapped) = listen(&mut clock, &mut sender, 23, 5);
    assert!(worst < MS && mapped == 500, "{worst} ns");
}

/// Packets that were held up and arrive in one burst are late; the clock was not set.
#[test]
fn packets_that_were_held_up_do_not_set_the_clock() {
    for (held_ms, rate) in [(190, 200), (310, 100), (110, 500), (950, 100)] {
        let mut clock = RemoteClock::new();
        let mut sender = Sender {
            offset_ns: -3,
            drift: 1e-5,
            random: 5,
        };
        let mut last_arrival = 0;
        for frame in 0..6 * rate {
            let sent = 1_000_000_000 + frame * (1_000_000_000 / rate);
            let (stamp, arrival) = sender.packet(sent);
            let is_held = (4_000..4_000 + held_ms).contains(&(sent / MS - 1_000));
            let arrival = if is_held {
                (5_000 + held_ms) as u64 * MS.cast_unsigned()
            } else {
                arrival
            };
            last_arrival = arrival.max(last_arrival);
            let mapped = clock.map(stamp, last_arrival);
            let late_ms = (last_arrival.cast_signed() - sent) / MS;
            if sent > 2_000_000_000 && late_ms < 60 {
                let is_right = matches!(mapped, Mapped::At(at) if (at - sent).abs() < MS);
                assert!(
                    is_right,
                    "{held_ms} ms at {rate} Hz: {mapped:?} at {sent}, {late_ms} ms late"
                );
            }
            assert!(mapped != Mapped::Stepped, "{held_ms} ms at {rate} Hz");
        }
    }
}
