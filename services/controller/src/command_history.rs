//! History of commands: those that the vehicle has followed since a late state.

use shared_types::service::seconds;

use control_law::signals::Commanded;

/// Number of spans in the history.
const SPANS: usize = 16;

shared_types::sample! {
    /// The mean command of a span of time.
    pub struct CommandSpan {
        /// Duration, ns.
        pub duration_ns: u64,
        /// The command.
        pub command: Commanded,
    }
}

shared_types::sample! {
    /// The last spans without gaps, the newest first; all zero before the first command.
    pub struct CommandHistory {
        /// The spans.
        pub spans: [CommandSpan; SPANS],
    }
}

impl CommandHistory {
    /// Adds a command that was followed for a time, ns, to a history of at least `length_ns`.
    pub fn push(&mut self, command: &Commanded, duration_ns: u64, length_ns: u64) {
        if duration_ns == 0 {
            return;
        }
        let [newest, ..] = &mut self.spans;
        // All spans but the newest, which is not full, make up the length.
        if newest.duration_ns == 0 || newest.duration_ns >= length_ns / (SPANS as u64 - 1) {
            self.spans.rotate_right(1);
            self.spans[0] = CommandSpan {
                duration_ns,
                command: *command,
            };
            return;
        }
        let share = duration_ns as f64 / (newest.duration_ns + duration_ns) as f64;
        newest.command = mean(&newest.command, command, share);
        newest.duration_ns += duration_ns;
    }

    /// Returns the commands of the last `time_ns`, each with the time (s) for which it was followed, the oldest first. The
    /// oldest command counts for the time before the history as well.
    pub fn last(&self, time_ns: u64) -> impl Iterator<Item = (&Commanded, f64)> {
        let mut left_ns = time_ns;
        let newest_first = self.spans.each_ref().map(|span| {
            let taken_ns = span.duration_ns.min(left_ns);
            left_ns -= taken_ns;
            (&span.command, taken_ns)
        });
        let oldest = self.spans.iter().rposition(|span| span.duration_ns > 0);
        newest_first
            .into_iter()
            .enumerate()
            .rev()
            .map(move |(index, (command, taken_ns))| {
                let before_ns = if Some(index) == oldest { left_ns } else { 0 };
                (command, seconds(taken_ns + before_ns))
            })
            .filter(|(_, time)| *time > 0.0)
    }
}

fn mean(one: &Commanded, other: &Commanded, share: f64) -> Commanded {
    let between = |one: f64, other: f64| one + share * (other - one);
    let each = |one: [f64; 3], other: [f64; 3]| std::array::from_fn(|axis| between(one[axis], other[axis]));
    Commanded {
        thrust: between(one.thrust, other.thrust),
        torque_body: each(one.torque_body, other.torque_body),
        rates_body: each(one.rates_body, other.rates_body),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use zerocopy::FromZeros;

    fn of_thrust(thrust: f64) -> Commanded {
        Commanded {
            thrust,
            ..Commanded::NOTHING
        }
    }

    const LENGTH_NS: u64 = 200_000_000;

    proptest! {
        #[test]
        fn the_impulse_of_the_history_is_that_of_the_commands(
            commands in proptest::collection::vec((0.0..4.0f64, 1_000_000..30_000_000u64), 1..300), share in 0.0..1.0f64,
        ) {
            let mut history = CommandHistory::new_zeroed();
            for (thrust, duration_ns) in &commands {
                history.push(&of_thrust(*thrust), *duration_ns, LENGTH_NS);
            }
            let time_ns = (share * LENGTH_NS as f64) as u64;
            let found: Vec<_> = history.last(time_ns).collect();
            let whole: f64 = found.iter().map(|(_, time)| time).sum();
            prop_assert!((whole - seconds(time_ns)).abs() < 1e-9, "{whole}");
            let impulse: f64 = found.iter().map(|(command, time)| command.thrust * time).sum();
            let (mut expected, mut left_ns) = (0.0, time_ns);
            for (thrust, duration_ns) in commands.iter().rev() {
                let taken_ns = left_ns.min(*duration_ns);
                expected += thrust * seconds(taken_ns);
                left_ns -= taken_ns;
            }
            // Before the history the oldest span counts, which may be the mean of several commands.
            expected += found.first().map_or(0.0, |(oldest, _)| oldest.thrust) * seconds(left_ns);
            // A span is a mean: at its older end it is wrong by up to 4 N, over the 15th part of the history and a step.
            let tolerance = 4.0 * (seconds(LENGTH_NS) / 15.0 + 0.03);
            prop_assert!((impulse - expected).abs() < tolerance, "{impulse} {expected}");
        }
    }

    #[test]
    fn the_history_has_its_length_whatever_the_step() {
        for step_ns in (100_000..30_000_000).step_by(700_000) {
            let mut history = CommandHistory::new_zeroed();
            for _ in 0..3 * LENGTH_NS / step_ns {
                history.push(&of_thrust(1.0), step_ns, LENGTH_NS);
            }
            let length: u64 = history.spans.iter().map(|span| span.duration_ns).sum();
            assert!(length >= LENGTH_NS, "{step_ns}: {length}");
        }
    }

    #[test]
    fn commands_at_least_as_long_as_a_span_are_returned_exactly() {
        let mut history = CommandHistory::new_zeroed();
        assert_eq!(history.last(1).count(), 0);
        for step in 0..40 {
            history.push(&of_thrust(f64::from(step)), 22_000_000, LENGTH_NS);
        }
        let found: Vec<_> = history
            .last(50_000_000)
            .map(|(command, time)| (command.thrust, (1e3 * time).round()))
            .collect();
        assert_eq!(found, [(37.0, 6.0), (38.0, 22.0), (39.0, 22.0)]);
    }
}
