//! Failures of the receivers of a flight outdoors.

use scenario::Receivers;
use shared_types::receiver_figures::ReceiverFigures;
use shared_types::service::seconds;

use super::STALE;

/// Minimum rate of samples for arming, as a share of the scheduled one.
const MINIMUM_RATE: f64 = 0.8;

/// Returns why inertial navigation cannot rely on the receivers, if so. It does without altitudes, and without fixes where something
/// else measures the position.
pub(super) fn failure(
    stated: &Receivers,
    scheduled: &[f64; 4],
    figures: &ReceiverFigures,
    elapsed_ns: u64,
    needs_fixes: bool,
) -> Option<String> {
    let sources = stated.sources.join(", ");
    let all = stated.sources.len();
    if figures.packets == 0 && figures.refused == 0 {
        return Some(format!(
            "nothing has come from {sources} yet; `gerono gnss probe` shows what comes"
        ));
    }
    if (figures.open as usize) < all {
        return Some(format!(
            "{} of {all} receivers ({sources}) are lost; they are opened again in the background",
            all - figures.open as usize
        ));
    }
    let found = [
        figures.reason().into_owned(),
        figures
            .happened()
            .map(|(what, count)| format!("{what} {count}"))
            .collect::<Vec<_>>()
            .join(", "),
    ];
    let found: Vec<_> = found.into_iter().filter(|words| !words.is_empty()).collect();
    let because = match found.is_empty() {
        true => String::new(),
        false => format!("; so far {}", found.join("; ")),
    };
    let needed = [
        (
            ReceiverFigures::IMU,
            "HIGHRES_IMU of an autopilot has them: request it with MAV_CMD_SET_MESSAGE_INTERVAL",
        ),
        (
            ReceiverFigures::FIX,
            "NAV-PVT of a receiver has them, as soon as its antenna sees the sky",
        ),
        (
            ReceiverFigures::FIELD,
            "HIGHRES_IMU of an autopilot with a magnetometer has them",
        ),
    ];
    let is_needed = |(sensor, _): &(usize, &str)| needs_fixes || *sensor != ReceiverFigures::FIX;
    needed.into_iter().filter(is_needed).find_map(|(sensor, fix)| {
        let topic = ReceiverFigures::TOPICS[sensor];
        let (rate, scheduled) = (figures.rates[sensor], scheduled[sensor]);
        let age = seconds(elapsed_ns.saturating_sub(figures.arrived_ns[sensor]));
        if figures.samples[sensor] == 0 {
            return Some(format!("no sample for `{topic}` has come: {fix}{because}"));
        }
        if age > STALE {
            return Some(format!("the last sample for `{topic}` is {age:.1} s old{because}"));
        }
        if rate == 0.0 {
            return Some(format!("the rate of samples for `{topic}` is being measured"));
        }
        (rate < MINIMUM_RATE * scheduled).then(|| {
            format!(
                "{rate:.1} samples for `{topic}` come a second, and `schedule.period.\"{topic}\"` states {scheduled:.1}: raise \
                 the rate of the sender, or the period"
            )
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    const NOW_NS: u64 = 10_000_000_000;

    fn good() -> ReceiverFigures {
        ReceiverFigures {
            rates: [250.0, 10.0, 25.0, 50.0],
            arrived_ns: [NOW_NS - 10_000_000; 4],
            samples: [2500, 100, 250, 500],
            packets: 3000,
            open: 2,
            ..ReceiverFigures::new_zeroed()
        }
    }

    /// Change of good figures.
    type Spoil = fn(&mut ReceiverFigures);

    fn failure_of(spoil: impl FnOnce(&mut ReceiverFigures)) -> Option<String> {
        let stated = Receivers {
            sources: ["/dev/ttyACM0", "udp:0.0.0.0:14550"].map(str::to_owned).to_vec(),
            ..Receivers::default()
        };
        let mut figures = good();
        spoil(&mut figures);
        failure(&stated, &[250.0, 10.0, 25.0, 50.0], &figures, NOW_NS, true)
    }

    #[test]
    fn receivers_at_the_scheduled_rates_are_good_and_without_altitudes_as_well() {
        assert_eq!(failure_of(|_| ()), None);
        assert_eq!(
            failure_of(|figures| {
                figures.samples[ReceiverFigures::ALTITUDE] = 0;
                figures.rates = [201.0, 8.1, 0.0, 400.0];
            }),
            None
        );
    }

    #[test]
    fn what_is_missing_is_said_with_the_fix() {
        let spoils: [(Spoil, &str); 7] = [
            (
                |figures| figures.rates[ReceiverFigures::FIX] = 0.0,
                "the rate of samples for `gnss/fix` is being measured",
            ),
            (
                |figures| *figures = ReceiverFigures::new_zeroed(),
                "nothing has come from /dev/ttyACM0, udp:0.0.0.0:14550 yet; `gerono gnss probe` shows",
            ),
            (|figures| figures.open = 1, "1 of 2 receivers"),
            (
                |figures| figures.samples[ReceiverFigures::IMU] = 0,
                "no sample for `imu/sample` has come: HIGHRES_IMU of an autopilot has them",
            ),
            (
                |figures| {
                    figures.samples[ReceiverFigures::FIX] = 0;
                    figures.without_position = 7;
                },
                "as soon as its antenna sees the sky; so far without a position 7",
            ),
            (
                |figures| figures.arrived_ns[ReceiverFigures::FIELD] = NOW_NS - 2_000_000_000,
                "the last sample for `mag/field` is 2.0 s old",
            ),
            (
                |figures| figures.rates[ReceiverFigures::IMU] = 100.0,
                "100.0 samples for `imu/sample` come a second, and `schedule.period.\"imu/sample\"` states 250.0: raise the rate \
                 of the sender, or the period",
            ),
        ];
        for (spoil, words) in spoils {
            let failure = failure_of(spoil).unwrap();
            assert!(failure.contains(words), "{failure}");
        }
    }
}
