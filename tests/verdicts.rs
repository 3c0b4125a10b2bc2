//! The reported end of a flight is the true one: on the terminal, in `summary.json`, in the exit code, and of the log
//! alone.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::process::Output;

use common::{Place, complaint, output, said, scenario, succeed};
use serde_json::Value;

const LOST: Option<i32> = Some(9);

/// A flight in the laboratory whose radio fails for good, so that the vehicle goes on with its last frame.
const ADRIFT: [&str; 3] = [
    "duration=8.0",
    "vehicle.change=[]",
    "fault=[{at = 3.0, service = \"rc_output\", kind = \"off\"}]",
];

/// `gerono run` of a committed scenario with these settings, to the folder `out`.
fn run(place: &Place, name: &str, out: &str, settings: &[&str], more: &[&str]) -> Output {
    let stated = scenario(name);
    let mut arguments = vec!["run", stated.to_str().unwrap(), "--out", out];
    arguments.extend(settings.iter().flat_map(|setting| ["--set", setting]));
    arguments.extend(more);
    output(&mut place.gerono(&arguments))
}

fn info(place: &Place, out: &str, more: &[&str]) -> String {
    let log = place.log(out);
    let mut arguments = vec!["info", log.to_str().unwrap()];
    arguments.extend(more);
    String::from_utf8(succeed(&mut place.gerono(&arguments)).stdout).unwrap()
}

#[test]
fn a_vehicle_that_leaves_its_path_is_lost_in_every_host_and_in_the_log_alone() {
    let place = Place::new();
    for host in ["inprocess", "lockstep"] {
        let flown = run(&place, "fig3_6", host, &ADRIFT, &["--host", host]);
        assert_eq!(flown.status.code(), LOST, "{}", complaint(&flown));
        assert!(
            said(&flown).contains("\nthe vehicle was lost\nLOST at "),
            "{}",
            said(&flown)
        );
    }
    let [one, other] = ["inprocess", "lockstep"].map(|out| place.summary(out));
    assert_eq!(one["outcome"], "lost");
    let reason = one["reason"].as_str().unwrap();
    assert!(reason.contains("m from the path, more than 5.00 m"), "{reason}");
    assert_eq!(one["simulated_seconds"], 8.0, "it is flown to its end");
    for key in ["lost", "metrics", "phases"] {
        assert_eq!(one[key], other[key], "{key}");
    }
    let lost = &one["lost"];
    assert_eq!(
        (&lost["reason"], &lost["limit"]),
        (&Value::from("left_path"), &Value::from(5.0))
    );
    assert!(
        lost["time"].as_f64().unwrap() > 3.0 && lost["value"].as_f64().unwrap() < 5.1,
        "{lost}"
    );
    assert!(one["metrics"]["max"].as_f64().unwrap() > 20.0);

    // Without anything beside it the log tells the same.
    std::fs::remove_file(place.path("inprocess").join("summary.json")).unwrap();
    assert!(info(&place, "inprocess", &[]).contains("LOST at "));
    let told: Value = serde_json::from_str(&info(&place, "inprocess", &["--json"])).unwrap();
    assert_eq!(told["judged"]["lost"], *lost);
    assert_eq!(told["judged"]["metrics"], one["metrics"]);
    succeed(&mut place.gerono(&["report", "inprocess", "-o", "page"]));
    let page = std::fs::read_to_string(place.path("page/report.html")).unwrap();
    assert!(page.contains("\"words\":\"5.0"), "the page says how it was lost");
}

#[test]
fn a_flight_that_is_to_end_when_the_vehicle_is_lost_ends_there_with_the_same_bytes_in_every_host() {
    let place = Place::new();
    let settings = [ADRIFT.as_slice(), &["judge={end_when_lost = true}"]].concat();
    let logs = ["inprocess", "lockstep"].map(|host| {
        let flown = run(&place, "fig3_6", host, &settings, &["--host", host]);
        assert_eq!(flown.status.code(), LOST, "{}", complaint(&flown));
        assert!(
            said(&flown).contains("ended when the vehicle was lost"),
            "{}",
            said(&flown)
        );
        std::fs::read(place.log(host)).unwrap()
    });
    assert!(logs[0] == logs[1]);
    let summary = place.summary("inprocess");
    let [ended, lost] = [&summary["simulated_seconds"], &summary["lost"]["time"]];
    let late = ended.as_f64().unwrap() - lost.as_f64().unwrap();
    assert!((0.0..0.01).contains(&late), "it ends {late} s after the loss");
}

#[test]
fn the_scenario_says_what_is_lost() {
    let place = Place::new();
    let in_process = ["--host", "inprocess"];
    // 51 m away and still on its way, whatever counts as near.
    let far = ["duration=3.0", "vehicle.change=[]", "judge={distance_max = 0.05}"];
    let flown = run(&place, "fig2_far", "far", &far, &in_process);
    assert_eq!(flown.status.code(), Some(0), "{}", complaint(&flown));
    // Where it first comes to its path it overshoots by 8.9 cm.
    for (limit, code) in [("0.1", Some(0)), ("0.05", LOST)] {
        let judge = format!("judge={{distance_max = {limit}}}");
        let settings = ["duration=5.0", "vehicle.change=[]", &judge];
        let flown = run(&place, "fig1", limit, &settings, &in_process);
        assert_eq!(flown.status.code(), code, "{limit} m: {}", complaint(&flown));
    }
    let time = place.summary("0.05")["lost"]["time"].as_f64().unwrap();
    assert!((1.0..2.0).contains(&time), "{time}");
    let refused = run(&place, "hover", "refused", &["judge={tilt_max = 4.0}"], &[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        complaint(&refused).contains("upside down is π"),
        "{}",
        complaint(&refused)
    );
}

#[test]
fn a_vehicle_whose_motors_are_stopped_in_the_air_is_lost() {
    let place = Place::new();
    let settings = ["flight.kill_at=18.0", "duration=20.0", "flight.land_at=19.0"];
    let flown = run(
        &place,
        "takeoff_and_land",
        "out",
        &settings,
        &["--host", "inprocess"],
    );
    assert_eq!(flown.status.code(), LOST, "{}", complaint(&flown));
    let lost = &place.summary("out")["lost"];
    assert_eq!(
        (&lost["reason"], &lost["cause"]),
        (&Value::from("motors_stopped"), &Value::from("the operator kills"))
    );
    let time = lost["time"].as_f64().unwrap();
    assert!((18.0..18.05).contains(&time), "{lost}");
    let text = "LOST at 18.0";
    assert!(
        said(&flown).contains("\nthe vehicle was lost\n"),
        "{}",
        said(&flown)
    );
    assert!(said(&flown).contains(text), "{}", said(&flown));
    let summary = place.summary("out");
    assert_eq!(summary["outcome"], "lost");
    assert_eq!(
        summary["reason"],
        "the motors were stopped in the air: the operator kills"
    );
    let landed = run(
        &place,
        "takeoff_and_land",
        "landed",
        &[],
        &["--host", "inprocess"],
    );
    assert_eq!(landed.status.code(), Some(0), "{}", complaint(&landed));
}

#[test]
fn a_flight_that_is_killed_on_the_ground_is_not_completed_and_says_so_first() {
    let place = Place::new();
    let in_process = ["--host", "inprocess"];
    // Armed, and the motors idle.
    for (at, out, code) in [("2.5", "armed", LOST), ("39.0", "landed", Some(0))] {
        let kill = format!("flight.kill_at={at}");
        let flown = run(&place, "takeoff_and_land", out, &[&kill], &in_process);
        assert_eq!(flown.status.code(), code, "{}", complaint(&flown));
    }
    let [armed, landed] = ["armed", "landed"].map(|out| place.summary(out));
    let first = "\nKILLED at 2.508 s: the operator kills\n";
    assert_eq!(
        (&armed["outcome"], &armed["lost"]),
        (&"killed".into(), &Value::Null)
    );
    assert_eq!(armed["reason"], "killed at 2.508 s: the operator kills");
    assert!(info(&place, "armed", &[]).contains(first));
    assert_eq!(landed["outcome"], "completed");
    assert_eq!(landed["killed"]["after_landing"], true);
    succeed(&mut place.gerono(&["report", "armed", "-o", "page"]));
    let page = std::fs::read_to_string(place.path("page/report.html")).unwrap();
    assert!(page.contains("\"killed\":{\"time\":2.508,\"by\":\"the operator kills\""));
}

#[test]
fn a_run_that_cannot_be_set_up_says_why_once_and_shows_nothing_else() {
    let place = Place::new();
    let runtime = place.path("runtime");
    std::fs::create_dir(&runtime).unwrap();
    let user = rustix::process::geteuid().as_raw();
    std::fs::write(runtime.join(format!("gerono-{user}")), "no folder").unwrap();
    let mut command = place.short_flight("out", 1.0, &[]);
    command.env("XDG_RUNTIME_DIR", runtime);
    let failed = output(&mut command);
    assert_eq!(failed.status.code(), Some(1), "{}", said(&failed));
    assert_eq!(
        said(&failed).matches("cannot set the run up").count(),
        1,
        "{}",
        said(&failed)
    );
    assert!(failed.stdout.is_empty(), "{}", said(&failed));
    // The same command is not refused because of what the first one left.
    assert!(!place.path("out").exists());
    succeed(&mut place.short_flight("out", 0.2, &[]));
}

#[test]
fn a_log_that_could_not_be_written_to_its_end_has_as_many_samples_as_are_said_to_be_in_it() {
    let place = Place::new();
    let flight = place.short_flight("out", 9.0, &["--host", "inprocess", "--compression", "none"]);
    // No file may be larger than so many blocks of 512 bytes: as on a full disk, what is written then fails.
    let mut limited = std::process::Command::new("sh");
    limited
        .args(["-c", "trap '' XFSZ; ulimit -f 6000; exec \"$@\"", "sh"])
        .arg(flight.get_program())
        .args(flight.get_args())
        .current_dir(place.path(""));
    let failed = output(&mut limited);
    assert_eq!(failed.status.code(), Some(4), "{}", said(&failed));
    let summary = place.summary("out");
    let in_log = summary["in_log"].as_u64().unwrap();
    let text = said(&failed);
    assert!(
        text.contains(&format!("of which {in_log} are in the log")),
        "{text}"
    );
    assert!(!text.contains("none lost"), "{text}");
    let partial = place.path("out").join("run.mcap.partial");
    let told = output(&mut place.gerono(&["info", partial.to_str().unwrap(), "--json"]));
    let told: Value = serde_json::from_slice(&told.stdout).unwrap();
    let kept = told["recovery"]["samples"].as_object().unwrap().values();
    let kept: u64 = kept.map(|count| count.as_u64().unwrap()).sum();
    assert_eq!(kept, in_log, "what a recovery keeps");
    assert!(in_log > 1000, "{in_log}");
}

#[test]
fn what_a_flight_will_not_survive_is_warned_of_and_one_that_ends_in_the_air_says_so() {
    let place = Place::new();
    let check = |name: &str, setting: &str| {
        let file = scenario(name);
        said(&succeed(&mut place.gerono(&[
            "check",
            file.to_str().unwrap(),
            "--set",
            setting,
        ])))
    };
    assert!(!check("takeoff_and_land", "seed=1").contains("warning: "));
    for (setting, words) in [
        (
            "duration=26.0",
            "a landing at 25.0 s takes up to 15 s: the vehicle may fly at the end",
        ),
        (
            "flight={arm_at=2.0}",
            "no landing is requested: the vehicle flies at the end",
        ),
    ] {
        let said = check("takeoff_and_land", setting);
        assert!(said.contains(words), "{said}");
    }
    let upside_down = "envelope.box={min=[-2.0, -2.0, 0.0], max=[2.0, 2.0, 2.5], action=\"land\"}";
    let said_of_box = check("takeoff_and_land", upside_down);
    assert!(said_of_box.contains("m outside of the box"), "{said_of_box}");
    let fast = check("laboratory", "estimator.kalman.coast=0.1");
    assert!(
        fast.contains("the law continues for 0.30 s without tracking"),
        "{fast}"
    );
    let alone = check("laboratory", "real_time.orchestrator_loss=\"continue\"");
    assert!(
        alone.contains("the vehicle does not land before the end"),
        "{alone}"
    );
    let said_of_laboratory = check("laboratory", "flight.landing_speed=0.01");
    assert!(
        said_of_laboratory.contains("the vehicle will not be armed"),
        "{said_of_laboratory}"
    );

    let heavier = check("laboratory", "model.mass=0.4");
    assert!(
        heavier.contains("the law starts with 0.2 kg, and the estimator believes 0.4 kg"),
        "{heavier}"
    );
    let in_grams = check("takeoff_and_land", "vehicle.inertia=[6500.0, 6500.0, 13000.0]");
    assert!(in_grams.contains("1 g cm² is 1e-7"), "{in_grams}");
    let in_grams = check("laboratory", "controller.initial.inertia=[0.65, 0.65, 1.3]");
    let [unit, rule] = ["1 g cm² is 1e-7", "set `controller.beta`"].map(|part| in_grams.find(part).unwrap());
    assert!(unit < rule, "the advice on another key comes first: {in_grams}");

    let flown = run(
        &place,
        "takeoff_and_land",
        "short",
        &["duration=26.0"],
        &["--host", "inprocess"],
    );
    let told = said(&flown).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        told.contains("it ended before the vehicle was disarmed"),
        "{told}"
    );
}
