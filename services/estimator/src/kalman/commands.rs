//! History of the sent frames, by the time at which each takes effect.

use nalgebra::Vector3;
use scenario::{GRAVITY, Key, Model, Problem};
use shared_types::samples::RcFrame;
use shared_types::service::{nanoseconds, seconds};
use shared_types::{Schedule, Topic};

/// Capacity of the history, commands.
pub const CAPACITY: usize = 64;

/// Maximum step of a propagation, ns.
const LONGEST_STEP_NS: u64 = 2_000_000;

/// Bound on the magnitude of inputs, SI units; powers and products of several such numbers stay finite.
pub(super) const LARGEST: f64 = 1e9;

shared_types::sample! {
    /// Command that thrust and body rates follow from a time on.
    pub struct Command {
        /// Time from which it acts, ns since the start of the flight.
        pub acts_from_ns: u64,
        /// Thrust, N.
        pub thrust: f64,
        /// Body rates in {B}, rad/s.
        pub rates_body: [f64; 3],
    }
}

/// Command between two times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Beginning, ns since the start of the flight.
    pub from_ns: u64,
    /// End, ns since the start of the flight; after the beginning.
    pub to_ns: u64,
    pub command: Command,
}

/// Command over a number of equal steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    pub command: Command,
    /// Number of steps.
    pub steps: u64,
    /// Length of a step, s.
    pub h: f64,
}

/// Commands in effect or in transit, oldest first. The first one is assumed to hold at all earlier times.
#[derive(Clone, Debug, PartialEq)]
pub struct CommandHistory {
    commands: [Command; CAPACITY],
    /// At least 1.
    count: usize,
}

impl CommandHistory {
    /// Makes a history without commands whose thrust equals the weight of `mass` (kg): the rig starts in the air.
    #[must_use]
    pub fn hovering(mass: f64) -> Self {
        let hover = Command {
            acts_from_ns: 0,
            thrust: mass * GRAVITY,
            rates_body: [0.0; 3],
        };
        Self {
            commands: [hover; CAPACITY],
            count: 1,
        }
    }

    /// Makes a history without commands and without thrust: the vehicle stands on the ground.
    #[must_use]
    pub fn resting() -> Self {
        Self::hovering(0.0)
    }

    /// Returns the commands, oldest first.
    #[must_use]
    #[inline]
    pub fn commands(&self) -> &[Command] {
        &self.commands[..self.count]
    }

    /// Returns whether the history is full.
    #[must_use]
    #[inline]
    pub fn is_full(&self) -> bool {
        self.count == CAPACITY
    }

    /// Returns the command of a `frame` that takes effect at `acts_from_ns`.
    ///
    /// In failsafe the motors stop. A frame with a torque has no rates: the last rates are held, and the filter's rate bias
    /// absorbs the difference.
    #[must_use]
    pub fn command_of(&self, acts_from_ns: u64, frame: &RcFrame) -> Command {
        let bounded = |value: f64| value.clamp(-LARGEST, LARGEST);
        Command {
            acts_from_ns,
            thrust: if frame.failsafe.is_set() {
                0.0
            } else {
                bounded(frame.thrust)
            },
            rates_body: if frame.mode == RcFrame::MODE_RATES {
                frame.rates_body.map(bounded)
            } else {
                self.newest().rates_body
            },
        }
    }

    /// Adds a command that takes effect after all others; ignores an older or repeated one, and any if the history is full.
    pub fn push(&mut self, command: Command) {
        let is_first_known = self.count == 1 && self.commands[0].acts_from_ns == 0;
        if !self.is_full() && (is_first_known || command.acts_from_ns > self.newest().acts_from_ns) {
            self.commands[self.count] = command;
            self.count += 1;
        }
    }

    /// Drops the commands that have ended before `time_ns`, except the last one: it would still hold if the next frame were
    /// lost.
    pub fn drop_before(&mut self, time_ns: u64) {
        let begun = self
            .commands()
            .partition_point(|command| command.acts_from_ns <= time_ns);
        self.drop_first(begun.saturating_sub(2));
    }

    /// Returns the difference in the body's turn between two times if every frame were lost and the previous command held,
    /// rad.
    #[must_use]
    pub fn turn_if_missed(&self, from_ns: u64, to_ns: u64) -> f64 {
        let mut turn = 0.0;
        for pair in self.commands().windows(2) {
            let [before, command] = [&pair[0], &pair[1]];
            let ends_ns = self.end_of(command);
            let acts_ns = ends_ns
                .min(to_ns)
                .saturating_sub(command.acts_from_ns.max(from_ns));
            let difference = Vector3::from(command.rates_body) - Vector3::from(before.rates_body);
            turn += difference.norm() * seconds(acts_ns);
        }
        turn
    }

    /// Returns the time at which the next command takes effect.
    fn end_of(&self, command: &Command) -> u64 {
        let later = |next: &&Command| next.acts_from_ns > command.acts_from_ns;
        self.commands()
            .iter()
            .find(later)
            .map_or(u64::MAX, |next| next.acts_from_ns)
    }

    /// Drops the oldest command, unless it is the only one.
    pub fn drop_oldest(&mut self) {
        self.drop_first(1.min(self.count - 1));
    }

    fn drop_first(&mut self, number: usize) {
        if number > 0 {
            self.commands.copy_within(number..self.count, 0);
            self.count -= number;
        }
    }

    /// Returns the command in effect at a time.
    #[must_use]
    pub fn acting(&self, time_ns: u64) -> &Command {
        let begun = self
            .commands()
            .partition_point(|command| command.acts_from_ns <= time_ns);
        &self.commands[begun.saturating_sub(1)]
    }

    /// Returns the commands in effect between two times, contiguous and in order.
    pub fn segments(&self, from_ns: u64, to_ns: u64) -> impl Iterator<Item = Segment> {
        let commands = self.commands();
        let ends = commands[1..]
            .iter()
            .map(|next| next.acts_from_ns)
            .chain([u64::MAX]);
        let begins = [0]
            .into_iter()
            .chain(commands[1..].iter().map(|command| command.acts_from_ns));
        begins
            .zip(ends)
            .zip(commands)
            .map(move |((begin, end), &command)| Segment {
                from_ns: begin.max(from_ns),
                to_ns: end.min(to_ns),
                command,
            })
            .filter(|segment| segment.from_ns < segment.to_ns)
    }

    /// Returns these commands with the steps of a propagation.
    pub fn stretches(&self, from_ns: u64, to_ns: u64) -> impl Iterator<Item = Stretch> {
        self.segments(from_ns, to_ns).map(|segment| {
            let length_ns = segment.to_ns - segment.from_ns;
            let steps = length_ns.div_ceil(LONGEST_STEP_NS);
            Stretch {
                command: segment.command,
                steps,
                h: seconds(length_ns) / steps as f64,
            }
        })
    }

    /// Checks that a history holds the commands in effect from a measurement of this age, ns, until the newest frame acts.
    ///
    /// # Errors
    /// If more frames are sent in that time. `measured` says of what the age is, and `shorten` what else makes it shorter.
    pub(crate) fn check_capacity(
        age_ns: u64,
        model: &Model,
        schedule: &Schedule,
        measured: &str,
        shorten: &str,
    ) -> Result<(), Problem> {
        let frame_period_ns = schedule.time_ns(schedule.topic_rate(Topic::RcFrame).period);
        let in_transit_ns = age_ns.saturating_add(nanoseconds(model.radio_latency));
        // Plus the one in effect at the beginning, its predecessor, and one that may begin at either end.
        let needed = in_transit_ns.div_ceil(frame_period_ns) + 3;
        if needed <= CAPACITY as u64 {
            return Ok(());
        }
        Err(Problem::new(
            Key::root().then("model").then("radio_latency"),
            format!(
                "the estimator stores {CAPACITY} frames, but {needed} are sent from {measured} until the newest frame acts"
            ),
            format!("shorten this latency, {shorten}, or give `rc/frame` a longer period"),
        ))
    }

    fn newest(&self) -> &Command {
        &self.commands[self.count - 1]
    }

    /// Returns the whole array, unused elements included, and the number in use.
    pub(crate) fn save(&self) -> ([Command; CAPACITY], usize) {
        (self.commands, self.count)
    }

    /// Restores a saved history.
    pub(crate) fn restored(commands: [Command; CAPACITY], count: usize) -> Self {
        Self {
            commands,
            count: count.clamp(1, CAPACITY),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use zerocopy::FromZeros;

    fn command(acts_from_ns: u64, thrust: f64) -> Command {
        Command {
            acts_from_ns,
            thrust,
            rates_body: [thrust, 0.0, 0.0],
        }
    }

    /// History whose n-th known command has a thrust of n.
    fn history(times: &[u64]) -> CommandHistory {
        let mut history = CommandHistory::hovering(0.2);
        for (number, &time) in (1..).zip(times) {
            history.push(command(time, f64::from(number)));
        }
        history
    }

    fn times() -> impl Strategy<Value = Vec<u64>> {
        proptest::collection::btree_set(1..1000u64, 0..20).prop_map(Vec::from_iter)
    }

    proptest! {
        #[test]
        fn segments_cover_the_time_with_the_commands_that_act(
            times in times(), from in 0..1000u64, length in 1..1000u64,
        ) {
            let history = history(&times);
            let mut covered = from;
            for segment in history.segments(from, from + length) {
                prop_assert_eq!(segment.from_ns, covered);
                covered = segment.to_ns;
                let begun = times.iter().filter(|&&time| time <= segment.from_ns).count();
                let expected = if begun == 0 { 0.2 * GRAVITY } else { f64::from(u32::try_from(begun).unwrap()) };
                prop_assert_eq!(segment.command.thrust, expected);
                prop_assert_eq!(&segment.command, history.acting(segment.to_ns - 1));
                prop_assert!(!times.iter().any(|&time| segment.from_ns < time && time < segment.to_ns));
            }
            prop_assert_eq!(covered, from + length);
        }

        #[test]
        fn forgetting_changes_nothing_from_its_time_on(times in times(), at in 0..1000u64, length in 1..1000u64) {
            let whole = history(&times);
            let mut rest = whole.clone();
            rest.drop_before(at);
            prop_assert!(rest.segments(at, at + length).eq(whole.segments(at, at + length)));
            let turn = |history: &CommandHistory| history.turn_if_missed(at, at + length);
            prop_assert_eq!(turn(&rest), turn(&whole));
            let before = rest.commands().iter().filter(|command| command.acts_from_ns <= at).count();
            prop_assert!(before <= 2, "{} are kept", before);
        }
    }

    #[test]
    fn a_repeated_or_older_command_and_one_beyond_the_capacity_are_not_taken() {
        let mut history = history(&[10, 20]);
        let before = history.clone();
        history.push(command(20, 9.0));
        history.push(command(15, 9.0));
        assert_eq!(history, before);
        for time in 100..200 {
            history.push(command(time, 3.0));
        }
        assert!(history.is_full());
        assert_eq!(
            history.commands().last().unwrap().acts_from_ns,
            100 + CAPACITY as u64 - 4
        );
    }

    #[test]
    fn a_missed_frame_turns_by_the_difference_of_the_rates_for_as_long_as_it_acts() {
        let second = 1_000_000_000;
        let history = history(&[second, 2 * second]);
        // 0 rad/s, then 1, then 2.
        for (from, to, turn) in [(0, 1, 0.0), (0, 2, 1.0), (1, 3, 2.0), (2, 4, 2.0)] {
            assert_eq!(history.turn_if_missed(from * second, to * second), turn);
        }
    }

    #[test]
    fn a_command_of_the_first_instant_replaces_the_weight() {
        assert_eq!(history(&[0]).acting(0).thrust, 1.0);
    }

    #[test]
    fn failsafe_means_no_thrust_and_a_torque_says_nothing_of_the_rates() {
        let rates = RcFrame {
            thrust: 2.0,
            rates_body: [1.0, 2.0, 3.0],
            mode: RcFrame::MODE_RATES,
            ..RcFrame::new_zeroed()
        };
        let mut history = CommandHistory::hovering(0.2);
        history.push(history.command_of(10, &rates));
        assert_eq!(
            (history.acting(10).thrust, history.acting(10).rates_body),
            (2.0, [1.0, 2.0, 3.0])
        );
        let torque = RcFrame {
            thrust: 1.5,
            torque_body: [1.0; 3],
            mode: RcFrame::MODE_TORQUE,
            ..RcFrame::new_zeroed()
        };
        history.push(history.command_of(20, &torque));
        assert_eq!(
            (history.acting(20).thrust, history.acting(20).rates_body),
            (1.5, [1.0, 2.0, 3.0])
        );
        let failsafe = RcFrame {
            failsafe: true.into(),
            ..rates
        };
        history.push(history.command_of(30, &failsafe));
        assert_eq!(history.acting(30).thrust, 0.0);
    }
}
