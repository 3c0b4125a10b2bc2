//! Services that are killed in flight: the finished log shows nothing of it.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use common::logs::last_tick;
use common::processes::{await_end, await_process, await_successor, processes_of, shared_memory_of, signal};
use common::{Begun, Place, begin, complaint, finish, output, scenario, succeed, until};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use runtime::process::SPARE;
use rustix::process::{Pid, Signal, kill_process};
use shared_types::ServiceId;

/// Place where a service can be killed in a flight that goes on, each after a tick more, with `S` for its name.
const DEATHS: [&str; 9] = [
    "S@0:before-ports",
    "S@0:after-ports",
    "S@100:before-step",
    "S@0:recovering",
    "S@200:after-step",
    "S@300:between-publishes",
    "S@400:after-publishing",
    "S@500:checkpointing",
    "S@600:before-waking",
];

/// Number of restarts after the deaths of [`DEATHS`]: a process that dies while it makes its ports does not count.
const BIRTHS: usize = DEATHS.len() - 1;

fn log(place: &Place, out: &str) -> Vec<u8> {
    std::fs::read(place.log(out)).unwrap()
}

/// Deaths that the summary of a run tells of.
fn restarts(place: &Place, out: &str) -> Vec<String> {
    let summary = place.summary(out);
    let restarts = summary["restarts"].as_array();
    restarts.into_iter().flatten().map(ToString::to_string).collect()
}

/// Returns the ends of the spare processes of a run, in the words of its record.
fn deaths_of_spares(place: &Place, out: &str) -> Vec<String> {
    recorded(place, out, "a standby process: ")
}

/// Returns the events of a run's record that contain these words.
fn recorded(place: &Place, out: &str, words: &str) -> Vec<String> {
    let record = std::fs::read(place.path(out).join("host.mcap")).unwrap();
    let events = mcap::MessageStream::new(&record).unwrap().map(Result::unwrap);
    let texts = events.map(|event| String::from_utf8_lossy(&event.data).into_owned());
    texts.filter(|text| text.contains(words)).collect()
}

fn with_crashes(mut command: Command, crashes: &[String]) -> Command {
    command.args(crashes.iter().flat_map(|crash| ["--crash", crash]));
    command
}

fn deaths_of(service: ServiceId) -> impl Iterator<Item = String> {
    DEATHS.iter().map(move |death| death.replace('S', service.name()))
}

#[test]
fn a_death_at_any_place_of_any_service_leaves_no_trace_in_the_log() {
    let place = Place::new();
    succeed(&mut place.short_flight("undisturbed", 1.0, &[]));
    for service in ServiceId::ALL {
        let out = service.name();
        let crashes: Vec<_> = deaths_of(service).collect();
        succeed(&mut with_crashes(place.short_flight(out, 1.0, &[]), &crashes));
        assert!(log(&place, out) == log(&place, "undisturbed"), "{service}");
        let restarts = restarts(&place, out);
        assert_eq!(restarts.len(), BIRTHS, "{restarts:?}");
    }
    let everyone: Vec<_> = ServiceId::ALL.into_iter().flat_map(deaths_of).collect();
    succeed(&mut with_crashes(
        place.short_flight("everyone", 1.0, &[]),
        &everyone,
    ));
    assert!(log(&place, "everyone") == log(&place, "undisturbed"));
    assert_eq!(restarts(&place, "everyone").len(), BIRTHS * ServiceId::ALL.len());
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn the_charge_of_a_modelled_battery_survives_the_deaths_of_its_transmitter() {
    const BATTERY: &str = "rc_output.battery={source=\"modelled\", calibrated=8.4, \
                           model={full=8.4, thrust=1.962, endurance=10.0, fade=0.2}}";
    let place = Place::new();
    let settings = ["--set", BATTERY];
    succeed(&mut place.rig_flight("plain", 1.0, &[]));
    succeed(&mut place.rig_flight("undisturbed", 1.0, &settings));
    assert!(log(&place, "plain") != log(&place, "undisturbed"));
    let crashes: Vec<_> = deaths_of(ServiceId::RcOutput).collect();
    succeed(&mut with_crashes(
        place.rig_flight("deaths", 1.0, &settings),
        &crashes,
    ));
    assert!(log(&place, "deaths") == log(&place, "undisturbed"));
    assert_eq!(restarts(&place, "deaths").len(), BIRTHS);
}

#[test]
fn deaths_in_the_laboratory_leave_no_trace_in_the_log() {
    let place = Place::new();
    succeed(&mut place.rig_flight("undisturbed", 1.0, &[]));
    let everyone: Vec<_> = ServiceId::ALL.into_iter().flat_map(deaths_of).collect();
    succeed(&mut with_crashes(
        place.rig_flight("everyone", 1.0, &[]),
        &everyone,
    ));
    assert!(log(&place, "everyone") == log(&place, "undisturbed"));
    assert_eq!(restarts(&place, "everyone").len(), BIRTHS * ServiceId::ALL.len());
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Every service at the same tick, and each again while it recovers.
#[test]
fn deaths_at_once_and_in_recovery_leave_no_trace_in_the_log() {
    let place = Place::new();
    succeed(&mut place.short_flight("undisturbed", 1.0, &[]));
    for death in ["before-step", "after-step", "after-publishing", "checkpointing"] {
        let crashes: Vec<_> = ServiceId::ALL
            .into_iter()
            .flat_map(|service| {
                let again = ["recovering", "recovering", "before-ports", "recovering"];
                let again = again.map(|place| format!("{service}@0:{place}"));
                [format!("{service}@500:{death}")].into_iter().chain(again)
            })
            .collect();
        succeed(&mut with_crashes(place.short_flight(death, 1.0, &[]), &crashes));
        assert!(log(&place, death) == log(&place, "undisturbed"), "{death}");
        let restarts = restarts(&place, death);
        // Of the five deaths one is that of a process that was still starting.
        assert_eq!(restarts.len(), 4 * ServiceId::ALL.len(), "{restarts:?}");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Flies a committed scenario whole, with these deaths and undisturbed in one process, and compares.
fn committed_is_the_same_with(name: &str, crashes: &[String]) {
    let place = Place::new();
    let committed = scenario(name);
    let run = ["run", committed.to_str().unwrap(), "--quiet", "--out"];
    succeed(&mut with_crashes(
        place.gerono(&[&run[..], &["killed"]].concat()),
        crashes,
    ));
    let alone = ["undisturbed", "--host", "inprocess"];
    succeed(&mut place.gerono(&[&run[..], &alone].concat()));
    assert!(log(&place, "killed") == log(&place, "undisturbed"));
    assert_eq!(restarts(&place, "killed").len(), crashes.len());
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn fig_1_with_its_controller_killed_every_second_is_fig_1() {
    let crashes: Vec<_> = (1..60)
        .map(|second| format!("controller@{second}000:after-step"))
        .collect();
    committed_is_the_same_with("fig1", &crashes);
}

#[test]
fn fig_7_with_every_service_killed_in_turn_is_fig_7() {
    let turns = ServiceId::ALL.into_iter().cycle().zip(1..40);
    let crashes: Vec<_> = turns
        .map(|(service, turn)| format!("{service}@{}:after-step", 2000 * turn))
        .collect();
    committed_is_the_same_with("fig7", &crashes);
}

/// Outdoors each service dies on the path, the estimator also without fixes and beside false ones.
#[test]
fn a_flight_by_satellites_with_every_service_killed_in_turn_is_that_flight() {
    let turns = ServiceId::ALL.into_iter().cycle().zip(1..20);
    let in_turn = turns.map(|(service, turn)| format!("{service}@{}:after-step", 6_100 * turn));
    let estimator =
        [34_000, 46_000, 57_000, 81_000, 100_000].map(|tick| format!("estimator@{tick}:after-step"));
    committed_is_the_same_with("outdoor_events", &in_turn.chain(estimator).collect::<Vec<_>>());
}

/// In the hall, in its gate and outdoors each service dies.
#[test]
fn a_flight_in_and_out_of_a_hall_with_every_service_killed_in_turn_is_that_flight() {
    let turns = ServiceId::ALL.into_iter().cycle().zip(1..15);
    let in_turn = turns.map(|(service, turn)| format!("{service}@{}:after-step", 6_300 * turn));
    let estimator = [30_000, 33_000, 40_000, 52_000].map(|tick| format!("estimator@{tick}:after-step"));
    committed_is_the_same_with("indoor_outdoor", &in_turn.chain(estimator).collect::<Vec<_>>());
}

fn pid_named(child: &Begun, wanted: &str) -> u32 {
    until(wanted, || {
        let processes = processes_of(child.id());
        let found = processes.iter().find(|(name, _)| name == wanted);
        found.map(|(_, pid)| *pid)
    })
}

#[test]
fn a_service_that_is_stopped_for_a_while_is_waited_for() {
    let place = Place::new();
    let child = begin(&mut place.short_flight("stopped", 20.0, &[]));
    place.await_log("stopped", 1_000_000);
    for service in ServiceId::ALL {
        let pid = await_process(child.id(), service);
        signal(pid, Signal::STOP);
        std::thread::sleep(Duration::from_millis(30));
        signal(pid, Signal::CONT);
    }
    assert!(finish(child).status.success());
    succeed(&mut place.short_flight("undisturbed", 20.0, &["--host", "inprocess"]));
    assert!(log(&place, "stopped") == log(&place, "undisturbed"));
}

#[test]
fn a_stopped_service_is_named_after_five_seconds_and_waited_for_until_it_continues() {
    let place = Place::new();
    let mut flight = place.short_flight("stopped", 20.0, &[]);
    let mut child = begin(flight.stderr(std::process::Stdio::piped()));
    place.await_log("stopped", 1_000_000);
    let estimator = await_process(child.id(), ServiceId::Estimator);
    signal(estimator, Signal::STOP);
    let messages = std::io::BufReader::new(child.stderr.take().unwrap());
    let mut messages = std::io::BufRead::lines(messages).map(Result::unwrap);
    let said = messages
        .find(|line| line.contains("the flight waits at"))
        .unwrap();
    let expected = format!(
        " s for `estimator` (process {estimator}, stopped by a signal; `kill -CONT {estimator}` continues it); \
         Ctrl-C ends the flight"
    );
    assert!(said.ends_with(&expected), "{said}");
    signal(estimator, Signal::CONT);
    // Said once.
    assert_eq!(messages.find(|line| line.contains("the flight waits at")), None);
    assert!(finish(child).status.success());
    succeed(&mut place.short_flight("undisturbed", 20.0, &["--host", "inprocess"]));
    assert!(log(&place, "stopped") == log(&place, "undisturbed"));
}

/// The recorder does not take anything any more, so that publishers wait for room; then their consumers die.
#[test]
fn a_consumer_that_dies_while_its_publisher_waits_in_send_is_mended() {
    let place = Place::new();
    let child = begin(&mut place.short_flight("choked", 20.0, &[]));
    place.await_log("choked", 1_000_000);
    signal(child.id(), Signal::STOP);
    // Nobody can tell that a publisher waits; in this time the ring fills the recorder's buffers several times.
    std::thread::sleep(Duration::from_millis(200));
    for service in [ServiceId::Controller, ServiceId::Estimator, ServiceId::RcOutput] {
        signal(await_process(child.id(), service), Signal::KILL);
    }
    signal(child.id(), Signal::CONT);
    let ended = finish(child);
    assert!(
        ended.status.success(),
        "{}",
        String::from_utf8_lossy(&ended.stderr)
    );
    assert_eq!(restarts(&place, "choked").len(), 3);
    succeed(&mut place.short_flight("undisturbed", 20.0, &["--host", "inprocess"]));
    assert!(log(&place, "choked") == log(&place, "undisturbed"));
}

/// Ends the flight `out` of 40 s with so many restarts, and compares it with an undisturbed one.
fn finish_like_undisturbed(place: &Place, out: &str, child: Begun, deaths: usize) {
    let orchestrator = child.id();
    let ended = finish(child);
    let errors = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "{errors}");
    assert_eq!(restarts(place, out).len(), deaths);
    succeed(&mut place.short_flight("undisturbed", 40.0, &["--host", "inprocess"]));
    assert!(log(place, out) == log(place, "undisturbed"));
    assert_eq!(shared_memory_of(orchestrator), Vec::<PathBuf>::new());
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Kills processes of a run so that it finds them all dead at once.
fn kill_at_once(child: &Begun, pids: [u32; 2]) {
    signal(child.id(), Signal::STOP);
    for pid in pids {
        signal(pid, Signal::KILL);
    }
    pids.into_iter().for_each(await_end);
    signal(child.id(), Signal::CONT);
}

/// Names of the connections of every publisher to a service that died while it made them.
fn half_made_connections(orchestrator: u32) -> BTreeSet<PathBuf> {
    let half_made = |connection: PathBuf| {
        let name = connection.to_str()?.strip_suffix(".connection")?;
        let (publisher, _subscriber) = name.rsplit_once('_')?;
        Some(format!("{publisher}_1.connection").into())
    };
    shared_memory_of(orchestrator)
        .into_iter()
        .filter_map(half_made)
        .collect()
}

#[test]
fn nobody_waits_for_shared_memory_that_somebody_died_in_the_middle_of_making() {
    let place = Place::new();
    let child = begin(&mut place.short_flight("half-made", 40.0, &[]));
    place.await_log("half-made", 500_000);
    let estimator = await_process(child.id(), ServiceId::Estimator);
    signal(estimator, Signal::STOP);
    let half_made = half_made_connections(child.id());
    assert!(half_made.len() >= ServiceId::ALL.len(), "{half_made:?}");
    for path in &half_made {
        drop(std::fs::File::create_new(path).unwrap());
    }
    signal(estimator, Signal::KILL);
    await_successor(child.id(), ServiceId::Estimator, estimator);
    finish_like_undisturbed(&place, "half-made", child, 1);
}

#[test]
fn of_two_services_that_die_at_once_one_goes_on_in_the_spare_process_and_both_leave_no_trace() {
    let place = Place::new();
    let child = begin(&mut place.short_flight("both", 40.0, &[]));
    let spare = pid_named(&child, SPARE);
    let both = [ServiceId::Estimator, ServiceId::RcOutput]
        .map(|service| (service, await_process(child.id(), service)));
    kill_at_once(&child, both.map(|(_, pid)| pid));
    let successors = both.map(|(service, pid)| await_successor(child.id(), service, pid));
    assert!(successors.contains(&spare), "{spare} {successors:?}");
    assert_ne!(pid_named(&child, SPARE), spare);
    finish_like_undisturbed(&place, "both", child, 2);
}

#[test]
fn a_service_that_dies_together_with_the_spare_process_leaves_no_trace() {
    let place = Place::new();
    let child = begin(&mut place.short_flight("together", 40.0, &[]));
    for service in ServiceId::ALL {
        let spare = pid_named(&child, SPARE);
        let pid = await_process(child.id(), service);
        kill_at_once(&child, [pid, spare]);
        assert_ne!(await_successor(child.id(), service, pid), spare);
    }
    finish_like_undisturbed(&place, "together", child, ServiceId::ALL.len());
    // A spare process that is dead when it gets the place of the service counts as a death of that.
    let deaths = recorded(&place, "together", "killed (SIGKILL)");
    assert_eq!(deaths.len(), 2 * ServiceId::ALL.len(), "{deaths:?}");
}

#[test]
fn a_run_goes_on_without_a_spare_process_if_that_dies_again_and_again() {
    let place = Place::new();
    let child = begin(&mut place.short_flight("without", 40.0, &[]));
    place.await_log("without", 1_000_000);
    let mut last = None;
    // The flight waits for a service until all spare processes are dead.
    let estimator = await_process(child.id(), ServiceId::Estimator);
    signal(estimator, Signal::STOP);
    // It is not started again after nine deaths in a row.
    for _ in 0..9 {
        let spare = until("another spare process", || {
            Some(pid_named(&child, SPARE)).filter(|pid| Some(*pid) != last)
        });
        signal(spare, Signal::KILL);
        // One that is dying still may be given the place of a service, and is then no spare process that died.
        await_end(spare);
        last = Some(spare);
    }
    signal(estimator, Signal::CONT);
    for service in [ServiceId::Controller, ServiceId::Plant] {
        let pid = await_process(child.id(), service);
        signal(pid, Signal::KILL);
        await_successor(child.id(), service, pid);
    }
    finish_like_undisturbed(&place, "without", child, 2);
    let deaths = deaths_of_spares(&place, "without");
    assert_eq!(deaths.len(), 9, "{deaths:?}");
}

#[test]
fn a_service_that_dies_again_and_again_is_given_up_and_the_log_is_whole_up_to_there() {
    let place = Place::new();
    for service in ServiceId::ALL {
        let out = service.name();
        let crashes = vec![format!("{service}@300:before-step"); 20];
        let ended = output(&mut with_crashes(place.short_flight(out, 1.0, &[]), &crashes));
        let errors = complaint(&ended);
        assert_eq!(ended.status.code(), Some(3), "{errors}");
        for piece in [
            format!("`{service}`"),
            "after tick 299".to_owned(),
            "KILL".to_owned(),
            "9 deaths in a row".to_owned(),
        ] {
            assert!(errors.contains(&piece), "{piece} is not in {errors}");
        }
        let last = last_tick(&place.log(out));
        assert!((290..=300).contains(&last), "{last}");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn how_often_a_service_is_started_again_is_for_each_service_to_choose() {
    let place = Place::new();
    // The first death comes after many ticks flown, the others are fruitless.
    let crashes = vec!["controller@300:before-step".to_owned(); 4];
    let choices = [
        "--restarts",
        "0",
        "--restarts",
        "controller=2",
        "--restart-pause",
        "0.01",
    ];
    let ended = output(&mut with_crashes(
        place.short_flight("given-up", 1.0, &choices),
        &crashes,
    ));
    let errors = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(3), "{errors}");
    assert!(errors.contains("3 deaths in a row"), "{errors}");
    succeed(&mut with_crashes(
        place.short_flight("twice", 1.0, &choices),
        &crashes[..2],
    ));
    // One that may not be started again at all is lost by its first death, wherever it has come to.
    let crashes = ["plant@300:after-step".to_owned()];
    let ended = output(&mut with_crashes(
        place.short_flight("once", 1.0, &choices),
        &crashes,
    ));
    assert_eq!(ended.status.code(), Some(3));
    assert!((290..=300).contains(&last_tick(&place.log("once"))));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Kills services of a run at random moments from its start on, until it ends; tells how many.
fn under_fire(mut child: Begun, random: &mut ChaCha8Rng, longest_pause_ms: u32) -> (u32, Begun) {
    let mut kills = 0;
    let deadline = Instant::now() + Duration::from_secs(60);
    while child.try_wait().unwrap().is_none() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_micros(u64::from(
            random.next_u32() % (1000 * longest_pause_ms),
        )));
        // The services, and the spare process.
        let processes = processes_of(child.id());
        let chosen = usize::try_from(random.next_u32()).unwrap() % (ServiceId::ALL.len() + 1);
        if let Some((_, pid)) = processes.get(chosen) {
            let pid = Pid::from_raw(i32::try_from(*pid).unwrap()).unwrap();
            kills += u32::from(kill_process(pid, Signal::KILL).is_ok());
        }
    }
    (kills, child)
}

/// At least 60 kills; as many as `GERONO_KILLS` says in the long version.
#[test]
fn kills_at_random_moments_leave_no_trace_in_the_log_nor_anything_behind() {
    let wanted = std::env::var("GERONO_KILLS").map_or(60, |count| count.parse().unwrap());
    let place = Place::new();
    succeed(&mut place.short_flight("undisturbed", 10.0, &["--host", "inprocess"]));
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut kills = 0;
    for run in 0.. {
        let out = format!("run-{run}");
        // On a busy machine one service may be hit before each of its first steps.
        let child = begin(&mut place.short_flight(&out, 10.0, &["--quiet", "--restarts", "1000"]));
        let orchestrator = child.id();
        let (more, child) = under_fire(child, &mut random, 200);
        let ended = finish(child);
        assert!(
            ended.status.success(),
            "{}",
            String::from_utf8_lossy(&ended.stderr)
        );
        assert!(log(&place, &out) == log(&place, "undisturbed"), "{out} differs");
        assert_eq!(shared_memory_of(orchestrator), Vec::<PathBuf>::new());
        assert!(processes_of(orchestrator).is_empty());
        std::fs::remove_dir_all(place.path(&out)).unwrap();
        kills += more;
        if kills >= wanted {
            break;
        }
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
    println!("{kills} kills");
}
