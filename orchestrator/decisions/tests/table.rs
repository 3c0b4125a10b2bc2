//! The tables of docs/decision_table.md: every event in every state, as the state machine itself answers it.
//!
//! `GERONO_BLESS=1 cargo test -p decisions --test table` writes the tables into the page.

#![expect(clippy::disallowed_methods, reason = "the page is written on request")]

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use decisions::Phase;
use decisions::conduct::{Conduct, EndRequest};
use decisions::event::{Action, Event, Facts, News};
use decisions::moment::Moment;
use decisions::process::{Exit, ProcessNumber, Said};
use decisions::restart_policy::{AFTER_CLOSING, FRESH_LIMIT, READY_LIMIT};
use decisions::supervision::{RestartPolicies, Supervision};
use host::activity::Activity;
use host::step::NonFinite;
use scenario::{KillSwitchLoss, OperatorDevices};
use shared_types::samples::RcFrame;
use shared_types::{Schedule, ServiceId};
use zerocopy::FromZeros;

const SERVICE: ServiceId = ServiceId::Controller;
const NOW: Moment = Moment(60_000_000_000);
const STEPPED: u64 = 1000;

const LAST_TICK: u64 = 1_000_000;

/// A service that has stepped up to some tick and is asleep.
struct Asleep {
    steps_until: u64,
}

/// A service in flight.
const IN_FLIGHT: Asleep = Asleep { steps_until: STEPPED };

/// A service that has done its last step.
const DONE: Asleep = Asleep {
    steps_until: LAST_TICK + 1,
};

impl Facts for Asleep {
    fn steps_until(&self, _: ServiceId) -> u64 {
        self.steps_until
    }

    fn next_tick(&self, _: ServiceId) -> u64 {
        self.steps_until
    }

    fn restarts_seen(&self, _: ServiceId) -> u32 {
        u32::MAX
    }

    fn activity(&self, _: ProcessNumber) -> Option<Activity> {
        Some(Activity {
            is_runnable: false,
            is_ready: false,
            cpu_time_ns: 0,
            run_delay_ns: 0,
        })
    }
}

fn ended() -> Event {
    let description = "killed (SIGKILL)".to_owned();
    Event::Ended(Exit {
        killed: true,
        description,
    })
}

/// Something that happens to a supervision.
type Happening = fn(&mut Supervision, ProcessNumber);

fn tell(supervision: &mut Supervision, process: ProcessNumber, event: Event) {
    supervision.handle(NOW, process, event, &IN_FLIGHT);
}

fn wait(supervision: &mut Supervision, time: Duration) {
    supervision.look(NOW + time, &IN_FLIGHT);
}

fn reason() -> String {
    "a reason".to_owned()
}

const EVENTS: [(&str, Happening); 14] = [
    ("the system does not start it", |all, own| {
        tell(all, own, Event::NotStarted(reason()));
    }),
    ("it says that it is ready", |all, own| {
        tell(all, own, Event::Said(Said::Ready { warnings: Vec::new() }));
    }),
    ("it has all samples that it had missed", |all, own| {
        tell(all, own, Event::MissedSent);
        tell(all, own, Event::Said(Said::CaughtUp));
    }),
    ("it says that it has finished, with steps to do", |all, own| {
        tell(all, own, Event::Said(Said::Finished));
    }),
    ("it says after its last step that it has finished", finish),
    ("it says that a number is not finite", |all, own| {
        let [service, topic, field] = ["controller", "rc/command", "thrust"].map(str::to_owned);
        let found = NonFinite {
            service,
            tick: STEPPED,
            topic,
            field,
        };
        tell(all, own, Event::Said(Said::NonFinite(found)));
    }),
    ("it says that it has failed", |all, own| {
        tell(all, own, Event::Said(Said::Failed { reason: reason() }));
    }),
    ("it says what cannot be read", |all, own| {
        tell(all, own, Event::Unreadable(reason()));
    }),
    ("it does not read its messages", |all, own| {
        tell(all, own, Event::Deaf);
    }),
    ("it has closed its channel and lives 0.1 s later", |all, own| {
        tell(all, own, Event::HungUp);
        wait(all, AFTER_CLOSING + Duration::from_millis(1));
    }),
    ("it hangs", |all, _| {
        all.replace_hung(SERVICE, NOW, Duration::from_millis(100));
    }),
    ("it ends", |all, own| tell(all, own, ended())),
    ("1 s passes", |all, _| {
        wait(all, FRESH_LIMIT + Duration::from_millis(1));
    }),
    ("30 s pass", |all, _| {
        wait(all, READY_LIMIT + Duration::from_millis(1));
    }),
];

fn finish(all: &mut Supervision, own: ProcessNumber) {
    all.handle(NOW, own, Event::Said(Said::Finished), &DONE);
}

/// All services ready.
fn set_up(is_real_time: bool) -> Supervision {
    let schedule = Schedule::ideal(1_000_000, LAST_TICK);
    let mut all = Supervision::new(&schedule, is_real_time, RestartPolicies::default());
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/fig1.toml");
    let scenario = scenario_file::load(&file, &[], None).unwrap();
    for _ in ServiceId::ALL {
        let number = all.start_next(NOW, &scenario);
        tell(&mut all, number, Event::Started { pid: 100 + number.0 });
    }
    all
}

fn ready(mut all: Supervision) -> Supervision {
    for service in ServiceId::ALL {
        let number = all.process_of(service);
        tell(
            &mut all,
            number,
            Event::Said(Said::Ready { warnings: Vec::new() }),
        );
    }
    all
}

fn flying(is_real_time: bool) -> Supervision {
    let mut all = ready(set_up(is_real_time));
    all.go();
    all
}

/// The service after these happenings in flight.
fn after(is_real_time: bool, happenings: &[Happening]) -> Supervision {
    let mut all = flying(is_real_time);
    for happening in happenings {
        let own = all.process_of(SERVICE);
        happening(&mut all, own);
    }
    all
}

fn states(is_real_time: bool) -> Vec<(&'static str, Supervision)> {
    let end: Happening = |all, own| tell(all, own, ended());
    let look: Happening = |all, _| wait(all, Duration::ZERO);
    let say_ready: Happening = |all, own| tell(all, own, Event::Said(Said::Ready { warnings: Vec::new() }));
    let hang: Happening = |all, _| all.replace_hung(SERVICE, NOW, Duration::from_millis(100));
    let fail: Happening = |all, own| tell(all, own, Event::Said(Said::Failed { reason: reason() }));
    let mut states = vec![
        ("starting, before the flight", set_up(is_real_time)),
        ("ready, before the flight", ready(set_up(is_real_time))),
        ("flying", flying(is_real_time)),
        ("dying", after(is_real_time, &[hang])),
        ("dead", after(is_real_time, &[end])),
        ("starting, in flight", after(is_real_time, &[end, look])),
        ("ready, in flight", after(is_real_time, &[end, look, say_ready])),
        ("given up", after(is_real_time, &[fail])),
        ("finished", after(is_real_time, &[finish])),
    ];
    if !is_real_time {
        let caught = after(is_real_time, &[end, look, say_ready, look, look]);
        states.insert(7, ("catching up", caught));
    }
    states
}

fn phase_in_words(phase: Phase) -> &'static str {
    match phase {
        Phase::Starting => "starting",
        Phase::Ready => "ready",
        Phase::Flying => "flying",
        Phase::CatchingUp => "catching up",
        Phase::Finished => "finished",
        Phase::Dying => "dying",
        Phase::Dead(_) => "dead",
        Phase::GivenUp => "given up",
    }
}

fn action_in_words(action: &Action) -> &'static str {
    match action {
        Action::Start { role: Some(_), .. } => "start a process for it",
        Action::Start { role: None, .. } => "start a standby process",
        Action::Become { .. } => "give the standby process its role",
        Action::MakePorts { .. } => "let it create its ports",
        Action::Go { .. } => "let it fly",
        Action::Beat { .. } => "ask the standby process for an answer",
        Action::Connect { .. } => "let external services connect to it",
        Action::Stop { .. } => "tell it to end",
        Action::Kill { .. } => "kill it",
        Action::Announce { .. } => "publish its ports",
        Action::CatchUp { .. } | Action::SendMissed { .. } => "send what it has missed",
        Action::MarkGone { .. } => "let nobody wait for it",
        Action::ForgetReceivers { .. } => "let no publisher wait for its queues",
        Action::CleanUp => "remove what it left",
        Action::Wake => "wake all",
        Action::LendReserve => "release reserved memory",
        Action::RefillReserve => "reserve memory",
        Action::SetStopping => "let all end",
    }
}

fn news_in_words(news: &News) -> Option<&'static str> {
    match news {
        News::Lost(_) => Some("**the flight has failed**"),
        News::Ready(..) | News::Finished(_) | News::Died { .. } => None,
    }
}

/// The rows of all states and events that change something.
fn table(is_real_time: bool) -> String {
    let mut text = "| it is | and | becomes | what is done |\n| --- | --- | --- | --- |\n".to_owned();
    for (state, supervision) in states(is_real_time) {
        for (event, happening) in EVENTS {
            let mut all = supervision.clone();
            let before = all.phase_of(SERVICE);
            all.take_actions();
            all.take_news();
            let own = all.process_of(SERVICE);
            happening(&mut all, own);
            let mut done: Vec<_> = all.take_actions().iter().map(action_in_words).collect();
            done.extend(all.take_news().iter().filter_map(news_in_words));
            done.dedup();
            // The standby process is kept in every state.
            done.retain(|action| !["reserve memory", "start a standby process"].contains(action));
            let phase = all.phase_of(SERVICE);
            if phase != before || !done.is_empty() {
                let becomes = if phase == before {
                    "–"
                } else {
                    phase_in_words(phase)
                };
                let _ = writeln!(text, "| {state} | {event} | {becomes} | {} |", done.join(", "));
            }
        }
    }
    text
}

/// A flight in real time of this scenario.
fn conduct_of(name: &str, on_loss: Option<KillSwitchLoss>) -> Conduct {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../scenarios/{name}.toml"));
    let mut scenario = scenario_file::load(&file, &[], None).unwrap();
    scenario.operator = on_loss.map(|on_loss| OperatorDevices {
        on_loss,
        ..toml::from_str("kill_device = \"/dev/input/event3\"").unwrap()
    });
    Conduct::new(&scenario, &Schedule::ideal(1_000_000, LAST_TICK))
}

/// The motors turn, or have rested for this time.
fn observe(conduct: &mut Conduct, rest: Duration) {
    let mut frame = RcFrame::new_zeroed();
    conduct.observe_motors(Some(&frame), 0, true);
    frame.failsafe = true.into();
    let step = Duration::from_millis(50);
    for number in 1..=rest.div_duration_f64(step) as u64 {
        frame.header.stamp_ns = number * step.as_nanos() as u64;
        conduct.observe_motors(Some(&frame), frame.header.stamp_ns, true);
    }
}

type Incident = (&'static str, fn(&mut Conduct) -> &'static str);

fn answer(request: Option<EndRequest>) -> &'static str {
    match request {
        Some(EndRequest::Land) => "ask for a landing",
        Some(EndRequest::Nothing) | None => "",
    }
}

const INCIDENTS: [Incident; 5] = [
    ("a failure", |conduct| answer(conduct.fail())),
    ("a request for the end", |conduct| {
        answer(Some(conduct.request_end()))
    }),
    ("the motors have rested for 1.9 s", |conduct| {
        observe(conduct, Duration::from_millis(1900));
        ""
    }),
    ("the motors have rested for 2.1 s", |conduct| {
        observe(conduct, Duration::from_millis(2100));
        ""
    }),
    ("the kill switch is lost", |conduct| {
        conduct.note_kill_switch(true);
        let reaction = conduct.reaction_to_loss(true);
        assert_eq!(conduct.reaction_to_loss(true), None, "once for each loss");
        match reaction {
            Some(KillSwitchLoss::Kill) => "stop the motors",
            Some(KillSwitchLoss::Land) => answer(Some(conduct.request_end())),
            Some(KillSwitchLoss::Ignore) => "say so",
            None => "",
        }
    }),
];

/// The rows of a flight as a whole.
fn table_of_flight() -> String {
    let mut text = "| the flight | and | what is done |\n| --- | --- | --- |\n".to_owned();
    let with_switch = |on_loss| conduct_of("takeoff_and_land", Some(on_loss));
    let after = |incident: fn(&mut Conduct)| {
        let mut conduct = with_switch(KillSwitchLoss::Kill);
        observe(&mut conduct, Duration::ZERO);
        incident(&mut conduct);
        conduct
    };
    let flights = [
        ("has phases, `on_loss = \"kill\"`", after(|_| ())),
        (
            "has phases, `on_loss = \"land\"`",
            with_switch(KillSwitchLoss::Land),
        ),
        (
            "has phases, `on_loss = \"ignore\"`",
            with_switch(KillSwitchLoss::Ignore),
        ),
        (
            "is to land",
            after(|conduct| {
                conduct.request_end();
            }),
        ),
        (
            "has failed",
            after(|conduct| {
                conduct.fail();
            }),
        ),
        ("has no phases", conduct_of("fig1", None)),
    ];
    for (flight, conduct) in flights {
        for (incident, happen) in INCIDENTS {
            let mut conduct = conduct.clone();
            observe(&mut conduct, Duration::ZERO);
            let done = happen(&mut conduct);
            let end = if conduct.permits_end() {
                "**the flight ends**"
            } else {
                ""
            };
            let done = [done, end]
                .into_iter()
                .filter(|words| !words.is_empty())
                .collect::<Vec<_>>();
            if !done.is_empty() {
                let _ = writeln!(text, "| {flight} | {incident} | {} |", done.join(", "));
            }
        }
    }
    text
}

fn documented(page: &str, name: &str) -> String {
    let (_, rest) = page.split_once(&format!("<!-- {name} -->\n")).expect(name);
    rest.split_once(&format!("<!-- end of {name} -->"))
        .expect(name)
        .0
        .to_owned()
}

#[test]
fn the_page_has_the_answers_of_the_state_machine() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/decision_table.md");
    let mut page = std::fs::read_to_string(&path).unwrap();
    for (name, table) in [
        ("real time", table(true)),
        ("the flight", table_of_flight()),
        ("lock step", table(false)),
    ] {
        let stated = documented(&page, name);
        if std::env::var_os("GERONO_BLESS").is_some() {
            page = page.replace(
                &format!("<!-- {name} -->\n{stated}"),
                &format!("<!-- {name} -->\n{table}"),
            );
            std::fs::write(&path, &page).unwrap();
        } else {
            assert_eq!(
                stated,
                table,
                "`GERONO_BLESS=1` writes the tables of {}",
                path.display()
            );
        }
    }
}

#[test]
fn a_start_that_the_system_refused_is_tried_again_after_10_ms() {
    let end: Happening = |all, own| tell(all, own, ended());
    let look: Happening = |all, _| wait(all, Duration::ZERO);
    let refuse: Happening = |all, own| tell(all, own, Event::NotStarted(reason()));
    let mut all = after(true, &[end, look, refuse]);
    let mut is_started_after = |milliseconds| {
        all.take_actions();
        wait(&mut all, Duration::from_millis(milliseconds));
        let is_start = |action: &Action| matches!(action, Action::Start { role: Some(_), .. });
        all.take_actions().iter().any(is_start)
    };
    assert!(!is_started_after(9));
    assert!(is_started_after(11));
}
