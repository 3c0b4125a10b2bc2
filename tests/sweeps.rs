//! Sweeps: shards and kills change no byte, every row can be repeated, and wrong input is refused with its reason.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::cmp::Ordering;
use std::path::Path;
use std::process::{Command, Stdio};

use ::flight::interrupt::Interrupt;
use rustix::process::Signal;
use sweep::definition::Source;
use sweep::flight;
use sweep::plan::Plan;

use crate::common::processes::{await_catching, signal};
use crate::common::{Place, begin, complaint, finish, output, scenario, succeed};
use crate::plugins::{ROOT, compile};

/// Twelve short flights of two laws; one of the vehicles is too heavy for any law.
fn write_sweep(place: &Place, more: &str) -> String {
    let text = format!(
        "scenario = {:?}\nsamples = 12\nseed = 5\nset = [\"duration=1.5\", \"vehicle.change=[]\"]\n\
         [vary]\nm = {{ uniform = [0.15, 0.3] }}\n\"vehicle.mass\" = \"m\"\n\
         \"vehicle.inertia\" = [\"3.2e-3 * m\", \"3.2e-3 * m\", \"6.4e-3 * m\"]\n\
         \"vehicle.initial.position\" = [{{ normal = [0.0, 0.2] }}, 0.0, {{ choice = [-1.0, -1.2] }}]\n\
         [judge]\nnear = \"max < 1.3\"\n{more}\
         [[compare]]\nname = \"paper\"\n[[compare]]\nname = \"slow\"\nset = [\"controller.k1=2.0\"]\n",
        scenario("fig1")
    );
    let path = place.path("sweep.toml");
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Content of a file that a merge has written.
fn merged(place: &Place, folder: &str, file: &str) -> Vec<u8> {
    std::fs::read(place.path(folder).join(file)).unwrap()
}

#[test]
fn the_merge_of_shards_has_the_bytes_of_one() {
    let place = Place::new();
    let sweep = write_sweep(&place, "");
    succeed(&mut place.gerono(&["sweep", "run", &sweep, "--out", "whole", "--jobs", "2"]));
    for index in (0..5).rev() {
        let shard = format!("{index}/5");
        succeed(&mut place.gerono(&[
            "sweep", "run", &sweep, "--shard", &shard, "--out", "parts", "--jobs", "1",
        ]));
    }
    let refused = place.gerono(&["sweep", "merge", "nowhere"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(1), "{refused:?}");
    succeed(&mut place.gerono(&["sweep", "merge", "parts"]));
    for file in ["results.parquet", "sweep.json", "sweep.md", "index.html"] {
        assert!(
            merged(&place, "whole", file) == merged(&place, "parts", file),
            "{file}"
        );
    }
    std::fs::remove_file(place.path("parts").join("shard-00003-of-00005.rows")).unwrap();
    let refused = place.gerono(&["sweep", "merge", "parts"]).output().unwrap();
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        refused.status.code() == Some(2) && words.contains("not complete, by number 3"),
        "{words}"
    );
}

#[test]
fn a_shard_that_is_killed_goes_on_and_ends_with_the_same_bytes() {
    let place = Place::new();
    let sweep = write_sweep(&place, "");
    succeed(&mut place.gerono(&["sweep", "run", &sweep, "--shard", "0/1", "--out", "whole"]));
    let rows = place.path("killed").join("shard-00000-of-00001.rows");
    let mut kills = 0;
    while !rows.exists() {
        let mut command = place.gerono(&[
            "sweep", "run", &sweep, "--shard", "0/1", "--out", "killed", "--jobs", "1",
        ]);
        let mut child = command.stdout(Stdio::null()).spawn().unwrap();
        // Killed as soon as it has gone further than the one before, or when it is done.
        let partial = rows.with_extension("rows.partial");
        let before = size(&partial);
        while child.try_wait().unwrap().is_none() && size(&partial) <= before + 8192 {
            std::thread::yield_now();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
        assert!(kills < 100, "no progress from kill to kill");
    }
    assert_eq!(
        std::fs::read(&rows).unwrap(),
        merged(&place, "whole", "shard-00000-of-00001.rows")
    );
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |metadata| metadata.len())
}

#[test]
fn a_full_disk_keeps_what_was_flown_and_the_shard_goes_on_when_there_is_room() {
    let place = Place::new();
    let sweep = write_sweep(&place, "");
    let arguments = ["sweep", "run", &sweep, "--shard", "0/1", "--out", "whole"];
    succeed(&mut place.gerono(&arguments));
    let whole = merged(&place, "whole", "shard-00000-of-00001.rows");
    let run = place.gerono(&["sweep", "run", &sweep, "--shard", "0/1", "--out", "full"]);
    // A limit on the size of files fails writes as a full disk does; `ulimit -f` counts blocks of 512 bytes.
    let blocks = whole.len() / 2 / 512;
    let limited = Command::new("sh")
        .args([
            "-c",
            &format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\""),
        ])
        .arg(run.get_program())
        .args(run.get_args())
        .current_dir(run.get_current_dir().unwrap())
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&limited.stderr).into_owned();
    assert_eq!(limited.status.code(), Some(4), "{words}");
    assert!(words.contains("shard-00000-of-00001.rows.partial"), "{words}");
    succeed(&mut place.gerono(&["sweep", "run", &sweep, "--shard", "0/1", "--out", "full"]));
    assert_eq!(merged(&place, "full", "shard-00000-of-00001.rows"), whole);
}

#[test]
fn every_row_can_be_repeated_with_its_log() {
    let place = Place::new();
    let sweep = write_sweep(&place, "");
    succeed(&mut place.gerono(&["sweep", "run", &sweep, "--out", "results"]));
    for (sample, law) in [("0", "paper"), ("11", "slow")] {
        let out = format!("again-{sample}");
        let mut command = place.gerono(&[
            "sweep", "fly", "results", "--sample", sample, "--law", law, "--out", &out,
        ]);
        let words = String::from_utf8(succeed(&mut command).stdout).unwrap();
        assert!(
            words.contains("the row matches the results bit for bit"),
            "{words}"
        );
        // Its log is that of the same flight by `gerono run`, events included.
        let command = words.lines().find(|line| line.contains("gerono run ")).unwrap();
        let arguments = command.split("gerono run ").nth(1).unwrap();
        let same = format!("same-{sample}");
        let run = format!(
            "{} run {arguments} --quiet --out {same}",
            env!("CARGO_BIN_EXE_gerono")
        );
        succeed(
            std::process::Command::new("sh")
                .args(["-c", &run])
                .current_dir(place.path("")),
        );
        succeed(&mut place.gerono(&["diff", &out, &same]));
    }
    let none = place
        .gerono(&["sweep", "fly", "results", "--sample", "12"])
        .output()
        .unwrap();
    assert_eq!(none.status.code(), Some(2));
}

#[test]
fn a_flight_whose_law_does_not_use_a_varied_gain_can_be_repeated_by_a_command() {
    let place = Place::new();
    // Its path is to be one word of the command.
    let own = place.path("what's flown.toml");
    std::fs::copy(scenario("fig3_6"), &own).unwrap();
    let text = format!(
        "scenario = {own:?}\nsamples = 1\nset = [\"duration=1.5\", \"vehicle.change=[]\"]\n\
         [vary]\n\"controller.k1\" = {{ uniform = [3.0, 5.0] }}\n\
         [[compare]]\nname = \"paper\"\n[[compare]]\nname = \"INDI\"\nset = [\"controller.law=indi\"]\n"
    );
    std::fs::write(place.path("sweep.toml"), text).unwrap();
    succeed(&mut place.gerono(&["sweep", "run", "sweep.toml", "--out", "results"]));
    for (law, has_gain) in [("paper", true), ("INDI", false)] {
        let mut command = place.gerono(&[
            "sweep", "fly", "results", "--sample", "0", "--law", law, "--out", law,
        ]);
        let words = String::from_utf8(succeed(&mut command).stdout).unwrap();
        let run = words.lines().find(|line| line.contains("gerono run ")).unwrap();
        assert_eq!(run.contains("controller.k1"), has_gain, "{run}");
        let arguments = run.split("gerono run ").nth(1).unwrap();
        let program = env!("CARGO_BIN_EXE_gerono");
        let run = format!("{program} run {arguments} --host inprocess --quiet --out same-{law}");
        succeed(Command::new("sh").args(["-c", &run]).current_dir(place.path("")));
        succeed(&mut place.gerono(&["diff", law, &format!("same-{law}")]));
    }
}

#[test]
fn ctrl_c_ends_the_trial_flights_of_a_plan_with_its_exit_code() {
    let place = Place::new();
    let text = format!(
        "scenario = {:?}\nsamples = 4\nset = [\"duration=30000.0\", \"vehicle.change=[]\"]\n",
        scenario("fig1")
    );
    std::fs::write(place.path("sweep.toml"), text).unwrap();
    let child = begin(&mut place.gerono(&["sweep", "plan", "sweep.toml"]));
    await_catching(child.id(), Signal::INT);
    signal(child.id(), Signal::INT);
    assert_eq!(finish(child).status.code(), Some(130));
}

#[test]
fn a_flight_that_fails_or_cannot_be_flown_is_a_row() {
    let place = Place::new();
    // A mass below zero cannot be flown by the scenario's checks, a radius below zero by the sweep's own word, and with
    // Λw = 1e-6 a number is not finite.
    let text = format!(
        "scenario = {:?}\nmethod = \"grid\"\nset = [\"duration=2.0\", \"vehicle.change=[]\"]\nrequire = [\"r > 0\"]\n\
         [vary]\nr = {{ choice = [-1.0, 1.0] }}\n\"vehicle.mass\" = {{ choice = [-0.2, 0.2] }}\n\
         \"controller.lambda_inertia\" = {{ choice = [1e-10, 1e-6] }}\n\
         [keep]\nlogs = \"failed\"\n",
        scenario("fig1")
    );
    let path = place.path("grid.toml");
    std::fs::write(&path, text).unwrap();
    let swept = succeed(&mut place.gerono(&["sweep", "run", path.to_str().unwrap(), "--out", "results"]));
    let said = String::from_utf8(swept.stderr).unwrap();
    assert!(
        said.starts_with("note: 6 flights are refused: `as stated`, sample 0: it does not meet `r > 0`"),
        "{said}"
    );
    let report: serde_json::Value = serde_json::from_slice(&merged(&place, "results", "sweep.json")).unwrap();
    let law = &report["laws"][0];
    let counts = ["completed", "lost", "failed", "refused"].map(|name| law[name].as_u64().unwrap());
    assert_eq!(counts, [1, 0, 1, 6], "{report:#}");
    assert_eq!(law["criteria"][0]["flown"], 2);
    // An interval holds for independent samples alone.
    assert!(law["criteria"][0]["wilson"].is_null());
    let logs: Vec<_> = std::fs::read_dir(place.path("results").join("logs"))
        .unwrap()
        .collect();
    assert_eq!(logs.len(), 1, "the log of the flight that failed");
    // `gerono run` has the same word for it.
    let settings = ["--host", "inprocess", "--set", "controller.lambda_inertia=1e-6"];
    let flown = output(&mut place.short_flight("flown", 2.0, &settings));
    assert_eq!(flown.status.code(), Some(3), "{flown:?}");
    let summary: serde_json::Value =
        serde_json::from_slice(&merged(&place, "flown", "summary.json")).unwrap();
    assert_eq!(
        (&summary["outcome"], &summary["lost"]["reason"]),
        (&"failed".into(), &"not_finite".into())
    );
}

#[test]
fn wrong_sweeps_are_refused_before_anything_is_flown() {
    let place = Place::new();
    let refused = |text: &str| {
        std::fs::write(place.path("bad.toml"), text).unwrap();
        let output = place
            .gerono(&["sweep", "run", "bad.toml", "--out", "bad"])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}\n{output:?}");
        assert!(!place.path("bad").exists(), "{text}");
        String::from_utf8(output.stderr).unwrap()
    };
    let head = format!("scenario = {:?}\nsamples = 3\n", scenario("fig1"));
    for (more, words) in [
        ("[vary]\n\"vehicle.mas\" = { uniform = [0.1, 0.2] }\n", "mas"),
        ("[vary]\na = \"b\"\nb = \"a\"\n", "is part of a cycle"),
        (
            "[vary]\nmass = { uniform = [0.16, 0.22] }\n",
            "no expression uses it",
        ),
        (
            "[vary]\nmass = { uniform = [0.16, 0.22] }\n\"vehicle.mass\" = \"mass\"\n",
            "a row has two columns `mass`",
        ),
        (
            "[vary]\nm = { uniform = [0.16, 0.22] }\n\"vehicle.mass\" = \"m\"\n[judge]\nM = \"max < 1\"\n",
            "a row has two columns `M`",
        ),
        (
            "[vary]\n\"vehicle.mass\" = { uniform = [-0.2, -0.1] }\n",
            "none of the 3 samples can be flown with `as stated`",
        ),
        (
            "[vary]\n\"vehicle.mass\" = { choice = [0.2, \"heavy\"] }\n",
            "`vehicle.mass` has the wrong type",
        ),
        (
            "[[compare]]\nname = \"mine\"\nset = [\"plugins.controller=none.so\"]\n",
            "none.so",
        ),
        ("[judge]\ngood = \"rms < 1\"\n", "there is no value `rms`"),
        (
            "[[compare]]\nname = \"x\"\nset = [\"controller.k9=1.0\"]\n",
            "settings of the sweep with `x`:1:12",
        ),
        (
            "[[compare]]\nname = \"x\"\n[[compare]]\nname = \"y\"\n",
            "`y` flies the same as `x` (`compare.1`, `compare.0`)",
        ),
        ("sampels = 3\n", "did you mean `samples`?"),
        ("method = \"sobl\"\n", "did you mean `sobol`?"),
        ("rank = \"rms\"\n", "`rank`: a row has no `rms`"),
        ("rank = \"steady_rms\"\n", "did you mean `steady_rmse`?"),
        (
            "set = [\"vehicle.mass=0.25\"]\n[vary]\n\"vehicle.mass\" = { uniform = [0.18, 0.22] }\n",
            "`set` of the sweep states `vehicle.mass`",
        ),
        (
            "[vary]\n\"vehicle.inertia.2\" = { uniform = [1e-3, 2e-3] }\n[[compare]]\nname = \"w\"\nset = [\"vehicle.inertia=[6e-4, 6e-4, 1e-3]\"]\n",
            "`set` of w states `vehicle.inertia`",
        ),
        (
            "[[compare]]\nname = \"x\"\nset = [\"seed=9\"]\n",
            "every sample draws its own",
        ),
        (
            "[[compare]]\nname = \"x\"\nset = [\"judge.steady_after=0.01\"]\n",
            "states `judge.steady_after`, but the measurement",
        ),
        (
            "[[compare]]\nname = \"x\"\nset = [\"duration=9.0\"]\n",
            "states `duration`, but the measurement",
        ),
        (
            "[vary]\n\"vehicle.drag\" = [{ uniform = [0.0, 0.1] }, 0.0, 0.0]\n\"vehicle.drag.0\" = { uniform = [0.0, 0.1] }\n",
            "`vary` states both",
        ),
        (
            "[vary]\n\"controller.baseline.integral_gain\" = { uniform = [9.0, 18.0] }\n",
            "no law of the sweep uses it",
        ),
        (
            "[[compare]]\nname = \"x\"\nset = [\"controller.baseline.integral_gain=9.0\"]\n",
            "does not use it",
        ),
        (
            "[judge]\ngood = \"outcome == 1\"\n",
            "there is no value `outcome`",
        ),
        (
            "[vary]\n\"vehicle.mass\" = { uniform = [0.18, 0.22], levels = 9 }\n",
            "apply to a grid only",
        ),
        (
            "[vary]\nflight = { choice = [1, 2] }\n\"vehicle.mass\" = { uniform = [0.18, 0.22] }\n",
            "no expression uses it",
        ),
        (
            "[[map]]\nx = \"m\"\ny = \"rmse\"\n",
            "`map.0.x`: a row has no `m`",
        ),
    ] {
        let refusal = refused(&format!("{head}{more}"));
        assert!(refusal.contains(words), "{more}: {refusal}");
    }
    assert!(refused("scenario = \"nowhere.toml\"\nsamples = 1\n").contains("cannot read"));
    let flight = std::fs::read_to_string(scenario("fig1")).unwrap();
    assert!(refused(&flight).contains("this is a scenario, not a sweep: `gerono run bad.toml` flies it"));
    std::fs::write(place.path("sweep.toml"), &head).unwrap();
    let checked = place.gerono(&["check", "sweep.toml"]).output().unwrap();
    let said = String::from_utf8(checked.stderr).unwrap();
    assert_eq!(checked.status.code(), Some(2), "{said}");
    assert!(
        said.contains("this is a sweep, not a scenario") && said.contains("gerono sweep run sweep.toml"),
        "{said}"
    );
}

#[test]
fn a_varied_inertia_of_vehicles_that_follow_body_rates_is_noted_and_a_sweep_s_folder_is_no_log() {
    let place = Place::new();
    let vary = "[vary]\n\"vehicle.inertia\" = [\"1e-3 * j\", \"1e-3 * j\", \"2e-3 * j\"]\nj = { uniform = [0.5, 1.0] }\n";
    for (name, is_noted) in [("fig3_6", true), ("fig1", false)] {
        let head = format!(
            "scenario = {:?}\nsamples = 2\nset = [\"duration=0.1\", \"vehicle.change=[]\"]\n",
            scenario(name)
        );
        std::fs::write(place.path("sweep.toml"), head + vary).unwrap();
        let flown = place
            .gerono(&["sweep", "run", "sweep.toml", "--out", name])
            .output()
            .unwrap();
        let noted = complaint(&flown);
        assert!(flown.status.success(), "{noted}");
        let words = "`vary.\"vehicle.inertia\"` has no effect";
        assert_eq!(noted.contains(words), is_noted, "{name}: {noted}");
        let reported = complaint(&place.gerono(&["report", name]).output().unwrap());
        let words = format!("{name} is the folder of a sweep: open its `index.html`");
        assert!(reported.contains(&words), "{reported}");
    }
}

#[test]
fn a_law_is_ranked_over_those_values_alone_that_it_flew() {
    let place = Place::new();
    // The first law states the mass itself, and the sweep makes the array of which an element is varied.
    let text = format!(
        "scenario = {:?}\nsamples = 12\nset = [\"duration=1.5\", \"vehicle.change=[]\", \"vehicle.inertia=[6e-4, 6e-4, 1e-3]\"]\n\
         [vary]\n\"vehicle.mass\" = {{ uniform = [0.15, 0.25] }}\n\"vehicle.inertia.2\" = {{ uniform = [1e-3, 2e-3] }}\n\
         [[compare]]\nname = \"heavy\"\nset = [\"vehicle.mass=0.19\"]\n[[compare]]\nname = \"paper\"\n\
         [[map]]\nx = \"vehicle.mass\"\ny = \"vehicle.inertia.2\"\nvalue = \"max\"\n",
        scenario("fig1")
    );
    std::fs::write(place.path("sweep.toml"), text).unwrap();
    succeed(&mut place.gerono(&["sweep", "run", "sweep.toml", "--out", "results"]));
    let report: serde_json::Value = serde_json::from_slice(&merged(&place, "results", "sweep.json")).unwrap();
    let winners = report["winners"].as_array().unwrap();
    let over = |key: &'static str| winners.iter().filter(move |winner| winner["varied"] == key);
    assert!(over("vehicle.mass").count() > 1);
    assert!(over("vehicle.mass").all(|winner| winner["law"] == "paper" && winner["medians"][0].is_null()));
    assert!(over("vehicle.inertia.2").any(|winner| !winner["medians"][0].is_null()));
    let maps = std::fs::read_dir(place.path("results")).unwrap();
    let maps = maps.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let maps: Vec<_> = maps.filter(|name| name.starts_with("map-")).collect();
    assert!(maps.len() == 1 && maps[0].contains("paper"), "{maps:?}");
}

#[test]
fn a_law_that_loses_its_vehicles_is_compared_by_them_and_is_best_nowhere() {
    let place = Place::new();
    // With Λw = 1e-6 the vehicle is lost in some seconds; the first two laws fly the same.
    let text = format!(
        "scenario = {:?}\nsamples = 12\nset = [\"duration=2.0\", \"vehicle.change=[]\"]\nrank = \"settling_time\"\n\
         [vary]\n\"vehicle.mass\" = {{ choice = [0.18, 0.2, 0.22] }}\n\
         [[compare]]\nname = \"paper\"\n[[compare]]\nname = \"again\"\nset = [\"description=again\"]\n\
         [[compare]]\nname = \"lost\"\nset = [\"controller.lambda_inertia=1e-6\"]\n",
        scenario("fig1")
    );
    std::fs::write(place.path("sweep.toml"), text).unwrap();
    succeed(&mut place.gerono(&["sweep", "run", "sweep.toml", "--out", "results"]));
    let report: serde_json::Value = serde_json::from_slice(&merged(&place, "results", "sweep.json")).unwrap();
    let differences = report["differences"].as_array().unwrap();
    let lost = differences
        .iter()
        .find(|difference| difference["law"] == "lost")
        .unwrap();
    assert_eq!(
        (&lost["pairs"], &lost["only_law_failed"]),
        (&0.into(), &12.into()),
        "{lost:#}"
    );
    let p = lost["mcnemar_p"].as_f64().unwrap();
    assert!(
        (p - 2.0 * 0.5_f64.powi(12)).abs() < 1e-12 && lost["median"].is_null(),
        "{lost:#}"
    );
    // Within 2 s none has settled: twelve pairs were completed, and none has the result.
    let again = differences
        .iter()
        .find(|difference| difference["law"] == "again")
        .unwrap();
    assert_eq!(
        (&again["pairs"], &again["completed"]),
        (&0.into(), &12.into()),
        "{again:#}"
    );
    let markdown = String::from_utf8(merged(&place, "results", "sweep.md")).unwrap();
    assert!(markdown.contains("| 0 of 12 | – | – |"), "{markdown}");

    let ranked = std::fs::read_to_string(place.path("sweep.toml")).unwrap();
    std::fs::write(place.path("ranked.toml"), ranked.replace("settling_time", "max")).unwrap();
    succeed(&mut place.gerono(&["sweep", "run", "ranked.toml", "--out", "ranked"]));
    let report: serde_json::Value = serde_json::from_slice(&merged(&place, "ranked", "sweep.json")).unwrap();
    let winners = report["winners"].as_array().unwrap();
    let ranges: Vec<_> = winners.iter().map(|winner| winner["range"].to_string()).collect();
    assert_eq!(ranges, ["[0.18,0.18]", "[0.2,0.2]", "[0.22,0.22]"]);
    assert!(
        winners.iter().all(|winner| winner["law"] == "paper, again"),
        "{winners:#?}"
    );
    let without = winners
        .iter()
        .map(|winner| winner["without"][2].as_u64().unwrap());
    assert_eq!(without.sum::<u64>(), 12);
}

#[test]
fn a_file_that_is_changed_while_a_sweep_flies_ends_it() {
    let place = Place::new();
    let points = place.path("points.csv");
    std::fs::write(&points, "t,x,y,z\n0,0,0,-1\n1,1,0,-1\n2,1,1,-1\n").unwrap();
    let waypoints = std::fs::read_to_string(scenario("waypoints")).unwrap();
    let mut document: toml::Table = toml::from_str(&waypoints).unwrap();
    document["path"]["curve"] = toml::from_str::<toml::Table>("waypoints.file = \"points.csv\"")
        .unwrap()
        .into();
    let path = place.path("scenario.toml");
    let text = toml::to_string(&document).unwrap();
    std::fs::write(&path, &text).unwrap();
    let sweep = "scenario = \"scenario.toml\"\nsamples = 2\nset = [\"duration=1.0\"]\n[vary]\n\"vehicle.mass\" = { uniform = [0.19, 0.21] }\n";
    let source = Source::new(&place.path("sweep.toml"), sweep.to_owned(), path, text).unwrap();
    let plan = Plan::new(source).unwrap();
    let fly = |index| flight::fly(&plan, &plan.sample(index), &plan.entries[0], &Interrupt::never());
    fly(0).unwrap().unwrap();
    std::fs::write(&points, "t,x,y,z\n0,0,0,-1\n1,2,0,-1\n2,1,1,-1\n").unwrap();
    let refused = format!("{:?}", fly(1).unwrap_err());
    assert!(refused.contains("was changed since the sweep began"), "{refused}");
}

#[test]
fn a_complete_folder_belongs_to_one_sweep_scenario_and_plug_in() {
    let place = Place::new();
    let library = |gain: &str| {
        let flags = [format!("-DMISCONDUCT=command->thrust *= {gain}")];
        compile(
            "tests/plugins/misconduct.c",
            &place.path("libpid.so"),
            &flags.each_ref().map(String::as_str),
        );
    };
    library("1.0");
    let scenario = std::fs::read_to_string(format!("{ROOT}/examples/plugin_c/eight.toml")).unwrap();
    let scenario = scenario.replace("duration = 20.0", "duration = 1.0");
    std::fs::write(place.path("eight.toml"), &scenario).unwrap();
    let sweep =
        "scenario = \"eight.toml\"\nsamples = 3\n[vary]\n\"vehicle.mass\" = { uniform = [0.18, 0.22] }\n";
    std::fs::write(place.path("sweep.toml"), sweep).unwrap();
    let again = || {
        let mut run = place.gerono(&["sweep", "run", "sweep.toml", "--out", "results"]);
        let output = run.output().unwrap();
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        (
            output.status.code(),
            words
                .split([' ', '\n', '│'])
                .filter(|word| !word.is_empty())
                .collect::<Vec<_>>()
                .join(" "),
        )
    };
    assert_eq!(again().0, Some(0));
    let table = merged(&place, "results", "results.parquet");
    let (code, words) = again();
    assert!(
        code == Some(0) && words.contains("complete already, nothing was flown"),
        "{words}"
    );
    let refused = |reason: &str| {
        let (code, words) = again();
        assert!(
            code == Some(2) && words.contains(reason),
            "{reason}: {code:?} {words}"
        );
        assert!(merged(&place, "results", "results.parquet") == table);
    };
    std::fs::write(place.path("sweep.toml"), sweep.replace("0.22", "0.23")).unwrap();
    refused("it is of another sweep");
    std::fs::write(place.path("sweep.toml"), sweep).unwrap();
    std::fs::write(place.path("eight.toml"), scenario.replace("1.0", "2.0")).unwrap();
    refused("it is of another scenario");
    std::fs::write(place.path("eight.toml"), &scenario).unwrap();
    library("1.1");
    refused("the plug-in in place of `controller` of `as stated` is another file");
    library("1.0");
    assert_eq!(again().0, Some(0));
}

#[test]
fn criteria_are_met_by_flights_that_were_flown_to_their_end() {
    let place = Place::new();
    // A vehicle that follows its rates after 0.9 s tips over; a mass below zero cannot be flown.
    let text = format!(
        "scenario = {:?}\nmethod = \"grid\"\nset = [\"duration=2.0\", \"vehicle.change=[]\"]\n\
         [vary]\n\"vehicle.mass\" = {{ choice = [-0.2, 0.19] }}\nlag = {{ choice = [0.02, 0.9] }}\n\
         \"vehicle.actuators.rate_lag\" = [\"lag\", \"lag\", 0.02]\n\
         [judge]\nany = \"max < 1e9\"\nchain = \"0 < max < 1e9\"\nlate = \"ended >= 0\"\nwas_lost = \"lost and max > 0\"\n",
        scenario("fig3_6")
    );
    std::fs::write(place.path("grid.toml"), text).unwrap();
    succeed(&mut place.gerono(&["sweep", "run", "grid.toml", "--out", "results"]));
    let report: serde_json::Value = serde_json::from_slice(&merged(&place, "results", "sweep.json")).unwrap();
    let law = &report["laws"][0];
    assert_eq!(
        ["completed", "lost", "refused"].map(|name| law[name].as_u64().unwrap()),
        [1, 1, 2]
    );
    let met = |name: &str| {
        let criteria = law["criteria"].as_array().unwrap();
        let found = criteria
            .iter()
            .find(|criterion| criterion["name"] == name)
            .unwrap();
        (found["met"].as_u64().unwrap(), found["flown"].as_u64().unwrap())
    };
    assert_eq!(
        ["any", "chain", "late", "was_lost", "survived"].map(met),
        [(1, 2), (1, 2), (2, 2), (1, 2), (1, 2)]
    );
    let rows = merged(&place, "results", "shard-00000-of-00001.rows");
    let rows = String::from_utf8(rows).unwrap();
    let refused = rows.lines().filter(|row| row.contains("\"refused\""));
    for row in refused {
        assert!(!row.contains("true") && !row.contains("false"), "{row}");
    }
}

#[test]
fn laws_are_ranked_by_what_the_sweep_says_and_numbers_drawn_as_a_heat_map() {
    let place = Place::new();
    let text = format!(
        "scenario = {:?}\nmethod = \"grid\"\nrank = \"ultimate\"\nset = [\"duration=1.0\", \"vehicle.change=[]\"]\n\
         [vary]\n\"vehicle.mass\" = {{ uniform = [0.18, 0.22], levels = 2 }}\nb = {{ uniform = [0.0, 0.5], levels = 3 }}\n\
         \"vehicle.disturbance\" = [\"b\", 0.0, 0.0]\n\
         [[compare]]\nname = \"slow\"\nset = [\"controller.k1=2.0\"]\n[[compare]]\nname = \"fast\"\n\
         [[map]]\nx = \"vehicle.mass\"\ny = \"b\"\nvalue = \"ultimate\"\n",
        scenario("fig1")
    );
    std::fs::write(place.path("sweep.toml"), text).unwrap();
    succeed(&mut place.gerono(&["sweep", "run", "sweep.toml", "--out", "results"]));
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(place.path("results/sweep.json")).unwrap()).unwrap();
    for winner in summary["winners"].as_array().unwrap() {
        let medians: Vec<f64> = winner["medians"]
            .as_array()
            .unwrap()
            .iter()
            .map(|median| median.as_f64().unwrap())
            .collect();
        let ranked = match medians[0].total_cmp(&medians[1]) {
            Ordering::Less => "slow",
            Ordering::Equal => "slow, fast",
            Ordering::Greater => "fast",
        };
        assert_eq!(winner["law"], ranked, "{winner}");
    }
    assert_eq!(summary["laws"][0]["quantiles"][0]["name"], "ultimate");
    let mut bars = Vec::new();
    for law in ["slow", "fast"] {
        let drawing = place.path(&format!("results/map-vehicle.mass-b-{law}.svg"));
        let drawing = std::fs::read_to_string(drawing).unwrap();
        assert_eq!(drawing.matches("stroke=\"#fff\"").count(), 6);
        // The bar of colours has the same five values for both laws.
        let bar = drawing
            .lines()
            .filter(|line| line.contains("text-anchor=\"start\""));
        bars.push(bar.map(str::to_owned).collect::<Vec<_>>());
    }
    assert!(bars[0].len() == 6 && bars[0] == bars[1], "{bars:?}");
}

#[test]
fn shards_of_another_sweep_do_not_mix() {
    let place = Place::new();
    let refused = |arguments: &[&str], reason: &str| {
        let output = place.gerono(arguments).output().unwrap();
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            output.status.code() == Some(2) && words.contains(reason),
            "{arguments:?}: {words}"
        );
    };
    let first = write_sweep(&place, "");
    succeed(&mut place.gerono(&["sweep", "run", &first, "--shard", "0/2", "--out", "results"]));
    let other = write_sweep(&place, "far = \"max > 1.3\"\n");
    refused(
        &["sweep", "run", &other, "--shard", "1/2", "--out", "results"],
        "of another sweep",
    );
    refused(
        &["sweep", "run", &other, "--shard", "1/3", "--out", "results"],
        "one of 2 shards",
    );
    refused(&["sweep", "run", &other, "--out", "results"], "one of 2 shards");
    // Nor beside a shard of which only some rows were flown.
    let whole = place.path("results").join("shard-00000-of-00002.rows");
    let part = place.path("results").join("shard-00000-of-00002.rows.partial");
    std::fs::rename(&whole, &part).unwrap();
    refused(
        &["sweep", "run", &other, "--shard", "1/2", "--out", "results"],
        "of another sweep",
    );
    std::fs::rename(&part, &whole).unwrap();
    // Brought together by hand.
    succeed(&mut place.gerono(&["sweep", "run", &other, "--shard", "1/2", "--out", "others"]));
    let name = "shard-00001-of-00002.rows";
    std::fs::copy(place.path("others").join(name), place.path("results").join(name)).unwrap();
    refused(&["sweep", "merge", "results"], "of another sweep");
    // A folder of something else is not made a sweep's.
    std::fs::create_dir(place.path("mine")).unwrap();
    std::fs::write(place.path("mine").join("notes.txt"), "mine").unwrap();
    refused(&["sweep", "run", &other, "--out", "mine"], "holds no sweep");
}

#[test]
fn the_shipped_sweeps_can_be_flown() {
    let place = Place::new();
    let mut count = 0;
    for file in std::fs::read_dir(format!("{ROOT}/scenarios/sweeps")).unwrap() {
        let path = file.unwrap().path();
        succeed(&mut place.gerono(&["sweep", "plan", path.to_str().unwrap()]));
        count += 1;
    }
    assert!(count >= 5, "{count}");
}

#[test]
fn a_law_that_no_plug_in_lets_fly_is_an_error() {
    let place = Place::new();
    compile("examples/plugin_c/pid.c", &place.path("libpid.so"), &[]);
    let scenario = std::fs::read_to_string(format!("{ROOT}/examples/plugin_c/eight.toml")).unwrap();
    std::fs::write(place.path("eight.toml"), scenario).unwrap();
    let sweep = "scenario = \"eight.toml\"\nsamples = 3\nset = [\"duration=0.1\"]\n[vary]\n\
                 \"plugins.parameters.kpp\" = { uniform = [0.18, 0.22] }\n";
    std::fs::write(place.path("sweep.toml"), sweep).unwrap();
    let output = place
        .gerono(&["sweep", "run", "sweep.toml", "--out", "results"])
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.code() == Some(2) && words.contains("no sample was flown"),
        "{words}"
    );
}

/// The columns of a table, as an independent reader has them, are checked by tests/interop/sweep.py.
#[test]
fn a_cluster_s_script_names_every_shard_once() {
    let place = Place::new();
    let sweep = write_sweep(&place, "");
    let output =
        succeed(&mut place.gerono(&["sweep", "plan", &sweep, "--slurm", "--shards", "7", "--cpus", "2"]));
    let script = String::from_utf8(output.stdout).unwrap();
    assert!(
        script.contains("--array=0-6") && script.contains("$SLURM_ARRAY_TASK_ID/7"),
        "{script}"
    );
    assert!(
        script.contains("--requeue") && script.contains("afterok"),
        "{script}"
    );
}
