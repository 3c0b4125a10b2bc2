//! Restart of a service: from the end of its process until another one flies in its place.

use std::time::Duration;

use host::step::NonFinite;
use metrics::summary::restart::Restart;
use shared_types::ServiceId;

use crate::event::{Action, Facts, News};
use crate::failure::ServiceFailure;
use crate::member::{Member, Phase};
use crate::moment::Moment;
use crate::process::{Exit, Role};
use crate::restart_policy::{EXTERNAL_LIMIT, MISSED_LIMIT};
use crate::supervision::Supervision;

impl Supervision {
    /// Records the end of a process once, and whether its service has made progress by it. Returns how it ended, and the
    /// number that is not finite for which it did.
    pub(crate) fn record_exit(
        &mut self,
        at: usize,
        mut exit: Exit,
        facts: &dyn Facts,
    ) -> (Exit, Option<NonFinite>) {
        let member = &mut self.members[at];
        if member.process.is_recorded {
            return (exit, None);
        }
        member.process.is_recorded = true;
        let flown_until = facts.steps_until(member.service);
        member.note_progress(flown_until);
        let (not_finite, words) = member.take_last_words(flown_until);
        if let Some(words) = words {
            exit.description = words;
        }
        match member.blamed.take() {
            Some(what) => exit.description = format!("killed, because it {what}"),
            None => member.deaths += 1,
        }
        let record = (Some(member.service), member.process.pid, exit.clone());
        self.exits.push(record);
        (exit, not_finite)
    }

    /// Handles the end of a process: records it, and decides on a restart.
    pub(crate) fn reap(&mut self, at: usize, now: Moment, exit: Exit, facts: &dyn Facts) {
        let service = self.members[at].service;
        // Only now: until its end the process may have written another checkpoint.
        let (next_tick, flown_until) = (facts.next_tick(service), facts.steps_until(service));
        let can_be_followed = self.can_be_followed();
        let (exit, not_finite) = self.record_exit(at, exit, facts);
        let member = &mut self.members[at];
        let pid = member.process.pid;
        if member.is_over() || self.is_stopping {
            return;
        }
        if member.is_external && !can_be_followed {
            let failure = member.violation(end_of_external_service(member, &exit));
            let lost = member.give_up(failure);
            self.act(Action::MarkGone { service });
            self.news.push(lost);
            return;
        }
        let timetable = &self.timetables[at];
        let after = timetable.steps.first_at_or_after(flown_until);
        let is_planned = flown_until > 0 && timetable.dies_after(flown_until - 1, after);
        let next = timetable.steps.first_at_or_after(next_tick);
        let pause = match is_planned {
            true => Some(Duration::ZERO),
            false => self.policies[at].pause(member.fruitless),
        };
        // From here on, no service in real time waits for the dead one.
        self.actions.push(Action::MarkGone { service });
        let Some(pause) = pause else {
            let died = ServiceFailure::Died {
                service: member.name.to_owned(),
                pid,
                tick: flown_until.saturating_sub(1),
                how: exit.description,
                times: member.fruitless,
            };
            let lost = member.give_up(not_finite.map_or(died, ServiceFailure::from));
            self.news.push(lost);
            return;
        };
        // A death before the first step extends the gap that the death before it began.
        let silent_since = member.silent_since.take();
        let gap_began = member
            .died_at
            .filter(|_| member.is_replacement())
            .or(silent_since);
        member.died_at = (!is_planned).then_some(gap_began.unwrap_or(now));
        member.phase = match next.is_some_and(|next| next <= self.schedule.last_tick()) {
            true => Phase::Dead(now + pause),
            false => Phase::Finished,
        };
        let is_at_once = member.phase == Phase::Dead(now);
        // Must precede the clean-up of its ports: a publisher must not wait for room in the queue of a receiver that
        // never reads.
        self.act(Action::ForgetReceivers { service });
        // If the service restarts at once, `respawn` cleans up.
        if !is_at_once {
            self.act(Action::CleanUp);
        }
        // Services that waited for the dead one check again.
        self.act(Action::Wake);
        self.news.push(News::Died { pid });
    }

    /// Restarts services that were given up, after their longest back-off: a vehicle in the air needs all of them to
    /// land.
    pub fn retry_given_up(&mut self, now: Moment) {
        for at in 0..self.members.len() {
            if self.members[at].phase != Phase::GivenUp {
                continue;
            }
            self.kill(at, now);
            let service = self.members[at].service;
            self.act(Action::MarkGone { service });
            self.act(Action::ForgetReceivers { service });
            let pause = self.policies[at].longest_pause;
            self.members[at].phase = Phase::Dead(now + pause);
        }
    }

    /// Gives a service another process: the standby process, or a new one.
    pub(crate) fn respawn(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        let member = &self.members[at];
        let role = Role {
            service: member.service,
            deaths: member.deaths,
        };
        // The standby process has built the internal services, not the external one.
        let standby = match member.is_external {
            true => None,
            false => self.take_standby(role),
        };
        let (process, was_prepared) = match standby {
            Some((mut process, was_prepared)) => {
                let activity = facts.activity(process.number);
                process.delayed_before_ns = activity.map_or(0, |activity| activity.run_delay_ns);
                (process, was_prepared)
            }
            None => (self.start_process(now, Some(role)), false),
        };
        let number = process.number;
        self.members[at].begin(process, was_prepared);
        // Done while the process loads or opens its topics.
        self.act(Action::CleanUp);
        self.act(Action::LendReserve);
        self.act(Action::MakePorts { process: number });
        self.act(Action::Wake);
    }

    /// Sends a service that restarts in real time what it has missed. One that does not take it in time flies without.
    pub(crate) fn send_missed(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        let member = &mut self.members[at];
        let since = *member.missed_since.get_or_insert(now);
        if now.since(since) > MISSED_LIMIT {
            return self.resume_in_real_time(at, now, facts);
        }
        let action = Action::SendMissed {
            process: member.process.number,
            service: member.service,
        };
        self.act(action);
    }

    /// Lets a service that restarted in real time fly on with the newest samples.
    pub(crate) fn resume_in_real_time(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        if self.members[at].phase == Phase::Ready && self.is_in_flight {
            self.members[at].phase = Phase::Flying;
            self.note_restart(at, now, facts);
            self.send_go(at, true);
        }
    }

    /// Lets services that restarted in lock step fly on, once all others are connected to their ports: a sample
    /// published before would be lost for an unconnected consumer.
    pub(crate) fn resume_in_lock_step(&mut self, now: Moment, facts: &dyn Facts) {
        for at in 0..self.members.len() {
            if self.members[at].phase != Phase::Ready {
                continue;
            }
            let Some((birth, announced_at)) = self.members[at].birth else {
                self.announce(at, now);
                continue;
            };
            let is_unconnected = |member: &&Member| {
                let flies = matches!(member.phase, Phase::Flying | Phase::CatchingUp);
                flies && facts.restarts_seen(member.service) < birth
            };
            let unconnected: Vec<_> = self.members.iter().filter(is_unconnected).collect();
            if unconnected.is_empty() {
                self.members[at].phase = Phase::CatchingUp;
                self.note_restart(at, now, facts);
                let service = self.members[at].service;
                self.act(Action::CatchUp { service });
                self.send_go(at, true);
                continue;
            }
            let mut late = unconnected.iter();
            let late = late.find(|member| member.is_external && now.since(announced_at) > EXTERNAL_LIMIT);
            if let Some(member) = late {
                let limit = EXTERNAL_LIMIT.as_secs();
                let what =
                    format!("has not answered `Connect` within {limit} s, and no service can fly on before");
                self.news.push(News::Lost(member.violation(what)));
            }
        }
    }

    /// Publishes the ports of a restarted service.
    fn announce(&mut self, at: usize, now: Moment) {
        self.births += 1;
        let birth = self.births;
        self.members[at].birth = Some((birth, now));
        self.act(Action::Announce { birth });
        let external = self.members.iter();
        // One that has finished does not need the new ports.
        let external = external.filter(|member| member.is_external && member.phase == Phase::Flying);
        let external: Vec<_> = external.map(|member| member.process.number).collect();
        for process in external {
            self.act(Action::Connect { process, birth });
        }
        self.act(Action::Wake);
    }

    fn note_restart(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        let member = &self.members[at];
        if let Some(died_at) = member.died_at {
            self.restarts.push(Restart {
                service: member.service,
                name: member.name,
                pid: member.process.pid,
                tick: facts.steps_until(member.service).checked_sub(1),
                lost_seconds: now.since(died_at).as_secs_f64(),
            });
        }
    }

    /// Records the restart of a service that became ready before the flight.
    pub fn note_restart_of(&mut self, service: ServiceId, now: Moment, facts: &dyn Facts) {
        self.note_restart(service.index(), now, facts);
    }
}

fn end_of_external_service(member: &Member, exit: &Exit) -> String {
    let how = &exit.description;
    if member.has_flown {
        format!(
            "ended: {how}; an external service has no checkpoint, so that it cannot be restarted in lock-step"
        )
    } else if member.phase == Phase::Ready {
        format!("ended before the flight began: {how}")
    } else {
        format!("ended before it was ready: {how}")
    }
}
