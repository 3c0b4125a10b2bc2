//! Plug-ins fly as built-in services do, and what they do wrong ends in a clear failure or a restart, never in a wrong
//! log.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::path::Path;
use std::process::Command;

use crate::common::{Place, assert_flown_to_the_end, begin, complaint, finish, output, succeed};

pub(crate) const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Compiles a library from C.
pub(crate) fn compile(source: &str, library: &Path, flags: &[&str]) {
    let mut command = Command::new("cc");
    command
        .args(["-O2", "-std=c11", "-shared", "-fPIC", "-w", "-o"])
        .arg(library);
    for folder in ["services/plugin/include", "examples/plugin_c"] {
        command.arg(format!("-I{ROOT}/{folder}"));
    }
    command.arg(format!("{ROOT}/{source}")).args(flags).arg("-lm");
    let output = command.output().expect("a C compiler links Rust too");
    assert!(output.status.success(), "{}", complaint(&output));
}

/// Makes the example's scenario, for a second, with a library that does something it should not.
fn example(misconduct: &str, claim: &str, flags: &[&str]) -> Place {
    let place = Place::new();
    let defines = [format!("-DMISCONDUCT={misconduct}"), format!("-DCLAIM={claim}")];
    let flags: Vec<_> = defines
        .iter()
        .map(String::as_str)
        .chain(flags.iter().copied())
        .collect();
    compile("tests/plugins/misconduct.c", &place.path("libpid.so"), &flags);
    let scenario = std::fs::read_to_string(format!("{ROOT}/examples/plugin_c/eight.toml")).unwrap();
    let scenario = scenario.replace("duration = 20.0", "duration = 1.0");
    std::fs::write(place.path("eight.toml"), scenario).unwrap();
    place
}

fn fly(place: &Place, out: &str, more: &[&str]) -> Command {
    let scenario = place.path("eight.toml");
    let mut command = place.gerono(&["run", scenario.to_str().unwrap(), "--quiet", "--out", out]);
    command.args(more);
    command
}

/// The option of restarts, which there are of processes only.
fn restarts(host: &str, count: &'static str) -> Vec<&'static str> {
    match host {
        "inprocess" => Vec::new(),
        _ => vec!["--restarts", count],
    }
}

fn log(place: &Place, out: &str) -> Vec<u8> {
    std::fs::read(place.log(out)).unwrap()
}

/// The commands of a flight, a line each.
fn commands(place: &Place, out: &str) -> String {
    let exported = succeed(&mut place.gerono(&["export", out, "--csv", "--topic", "control/command"]));
    String::from_utf8(exported.stdout).unwrap()
}

#[test]
fn a_library_flies_the_same_bytes_on_every_host_through_deaths_and_in_a_replay() {
    // Neither memory that it allocates nor what it does to its copies of the samples is seen by others.
    let place = example(
        "free(malloc(1000)); memset((void *)in[0].sample, 7, sizeof(gerono_vehicle_state))",
        "",
        &[],
    );
    succeed(&mut fly(&place, "alone", &["--host", "inprocess"]));
    let deaths = [
        "--crash",
        "controller@200:after-step",
        "--crash",
        "controller@700:checkpointing",
    ];
    succeed(&mut fly(&place, "died", &deaths));
    let fault = r#"fault=[{at=0.4, service="controller", kind="off", for=0.1}]"#;
    succeed(&mut fly(&place, "out", &["--set", fault]));
    succeed(&mut fly(
        &place,
        "out alone",
        &["--set", fault, "--host", "inprocess"],
    ));
    assert!(log(&place, "alone") == log(&place, "died"));
    assert!(log(&place, "out alone") == log(&place, "out"));
    for out in ["alone", "died", "out"] {
        succeed(&mut place.gerono(&["replay", out, "--quiet"]));
    }
    let parts = ["replay", "died", "--quiet", "--from", "0.6", "--processes"];
    succeed(&mut place.gerono(&parts));
    // Other gains are another flight.
    succeed(&mut fly(
        &place,
        "other",
        &["--host", "inprocess", "--set", "plugins.parameters.kp=9.0"],
    ));
    assert!(log(&place, "other") != log(&place, "alone"));
    // A run keeps its library, which is not replaced unseen.
    std::fs::remove_file(place.path("libpid.so")).unwrap();
    succeed(&mut place.gerono(&["replay", "alone", "--quiet"]));
    compile(
        "tests/plugins/misconduct.c",
        &place.path("alone/libpid.so"),
        &["-g"],
    );
    let refused = output(&mut place.gerono(&["replay", "alone", "--quiet"]));
    assert!(
        !refused.status.success() && complaint(&refused).contains("was built again"),
        "{}",
        complaint(&refused)
    );
}

#[test]
fn numbers_of_the_library_are_recorded_by_their_names() {
    let place = example("", "", &[]);
    succeed(&mut fly(
        &place,
        "died",
        &["--crash", "controller@500:after-step"],
    ));
    succeed(&mut fly(&place, "alone", &["--host", "inprocess"]));
    assert!(log(&place, "died") == log(&place, "alone"));
    succeed(&mut place.gerono(&["replay", "died", "--quiet"]));
    let table = |from: &str| {
        let csv = ["export", from, "--csv", "--topic", "control/telemetry"];
        String::from_utf8(succeed(&mut place.gerono(&csv)).stdout).unwrap()
    };
    let written = table("died");
    let mut lines = written.lines();
    let columns = "header.tick,header.stamp_ns,header.seq,integral_x,integral_y,integral_z";
    assert_eq!(lines.next(), Some(columns));
    let last: Vec<f64> = lines
        .next_back()
        .unwrap()
        .split(',')
        .map(|cell| cell.parse().unwrap())
        .collect();
    assert_eq!(last[0], 1000.0);
    assert!(last[3..].iter().all(|integral| *integral != 0.0), "{last:?}");
    // The names are in the schema, also of a log that was recovered.
    let whole = log(&place, "died");
    assert!(whole.windows(10).any(|bytes| bytes == b"integral_z"));
    std::fs::write(place.path("cut.mcap"), &whole[..whole.len() - 100]).unwrap();
    succeed(&mut place.gerono(&["recover", "cut.mcap"]));
    assert_eq!(table("cut.recovered.mcap"), written);
    succeed(&mut place.gerono(&["report", "died", "--output", "page"]));
    let page = std::fs::read_to_string(place.path("page/report.html")).unwrap();
    assert!(page.contains("Telemetry: integral_z"));
    // A slower rate keeps every tenth; without names there is no topic.
    let slower = r#"schedule.period={"control/telemetry"=0.01}"#;
    succeed(&mut fly(
        &place,
        "slower",
        &["--host", "inprocess", "--set", slower],
    ));
    assert_eq!(table("slower").lines().count(), 102);
    succeed(&mut fly(
        &place,
        "none",
        &["--host", "inprocess", "--set", "controller.telemetry=[]"],
    ));
    assert!(
        !log(&place, "none")
            .windows(17)
            .any(|bytes| bytes == b"control/telemetry")
    );
    let refused = output(&mut fly(
        &place,
        "bad",
        &["--set", "controller.telemetry=['x', 'X', 'x']"],
    ));
    let told = complaint(&refused);
    assert!(
        told.contains("`X` cannot be") && told.contains("`x` is listed twice"),
        "{told}"
    );
}

#[test]
fn what_a_library_does_wrong_in_its_step_ends_the_flight_clearly_and_the_log_is_right_until_then() {
    let good = example("", "", &[]);
    succeed(&mut fly(&good, "good", &["--host", "inprocess"]));
    let expected = commands(&good, "good");
    let cases = [
        (
            "return 7",
            "`libpid.so` in place of `controller` returned 7 from its step at tick 500",
            true,
        ),
        ("command->thrust = NAN", "thrust", true),
        (
            "command->mode = 0",
            "its vehicle takes body rates: write `rates_body`",
            true,
        ),
        (
            "memset(command, 0, sizeof *command + 8)",
            "wrote beyond a sample",
            true,
        ),
        #[cfg(target_arch = "x86_64")]
        (
            "_mm_setcsr(_mm_getcsr() | 0x8040)",
            "changed the floating-point mode",
            true,
        ),
        ("*(volatile int *)8 = 1", "SIGSEGV", false),
        ("abort()", "SIGABRT", false),
    ];
    for (misconduct, said, is_survived_in_process) in cases {
        let place = example(misconduct, "", &[]);
        let flown = output(&mut fly(&place, "processes", &["--restarts", "controller=1"]));
        let told = complaint(&flown);
        assert_eq!(flown.status.code(), Some(3), "{misconduct}: {told}");
        assert!(told.contains(said), "{misconduct}: {told}");
        let written = commands(&place, "processes");
        assert!(
            expected.starts_with(&written) && written.lines().count() >= 500,
            "{misconduct}"
        );
        let alone = output(&mut fly(&place, "alone", &["--host", "inprocess"]));
        if is_survived_in_process {
            assert_eq!(
                alone.status.code(),
                Some(3),
                "{misconduct}: {}",
                complaint(&alone)
            );
            assert!(
                complaint(&alone).contains(said),
                "{misconduct}: {}",
                complaint(&alone)
            );
            let written = commands(&place, "alone");
            assert!(
                expected.starts_with(&written) && written.lines().count() >= 500,
                "{misconduct}"
            );
        } else {
            assert_eq!(alone.status.code(), None, "{misconduct}: a signal ends it");
            assert!(
                !place.log("alone").exists(),
                "{misconduct}: a log that is not whole has another name"
            );
        }
    }
}

#[test]
fn a_library_that_hangs_is_ended() {
    let place = example("for (;;) {}", "", &[]);
    let alone = begin(&mut fly(&place, "alone", &["--host", "inprocess"]));
    let processes = begin(&mut fly(&place, "processes", &["--restarts", "controller=0"]));
    let alone = finish(alone);
    assert_eq!(alone.status.code(), Some(3), "{}", complaint(&alone));
    assert!(
        complaint(&alone).contains("has not returned for 20 s"),
        "{}",
        complaint(&alone)
    );
    let processes = finish(processes);
    assert_eq!(processes.status.code(), Some(3), "{}", complaint(&processes));
    assert!(
        complaint(&processes).contains("a step has taken longer than 20 s"),
        "{}",
        complaint(&processes)
    );
}

#[test]
fn a_library_that_ends_the_process_is_an_error_with_its_name() {
    for (misconduct, claim, function) in [
        ("exit(0)", "", "step"),
        ("quick_exit(0)", "", "step"),
        ("", "it.destroy = leave_at_the_end", "`destroy`"),
    ] {
        let place = example(misconduct, claim, &[]);
        let said =
            format!("the plug-in `libpid.so` in place of `controller` called `exit` in its {function}");
        let alone = output(&mut fly(&place, "alone", &["--host", "inprocess"]));
        assert_eq!(alone.status.code(), Some(3), "{}", complaint(&alone));
        assert!(complaint(&alone).contains(&said), "{}", complaint(&alone));
    }
    let thread = "pthread_t it; pthread_create(&it, NULL, leave_in_thread, NULL); pthread_join(it, NULL)";
    let place = example(thread, "", &["-pthread"]);
    let alone = output(&mut fly(&place, "alone", &["--host", "inprocess"]));
    assert_eq!(alone.status.code(), Some(3), "{}", complaint(&alone));
    assert!(
        complaint(&alone).contains("called `exit` while a plug-in flies"),
        "{}",
        complaint(&alone)
    );
    let place = example("exit(0)", "", &[]);
    let flown = output(&mut fly(&place, "processes", &["--restarts", "controller=1"]));
    assert_eq!(flown.status.code(), Some(3), "{}", complaint(&flown));
    let reason =
        "died after tick 499: the plug-in `libpid.so` in place of `controller` called `exit` in its step";
    assert!(complaint(&flown).contains(reason), "{}", complaint(&flown));
}

#[test]
fn a_library_that_truncates_descriptors_leaves_no_log_that_counts_as_whole() {
    for misconduct in [
        "for (int file = 3; file < 64; file++) (void)!ftruncate(file, 0)",
        "for (int file = 3; file < 64; file++) (void)!lseek(file, 0, SEEK_SET)",
    ] {
        let place = example(misconduct, "", &[]);
        let alone = output(&mut fly(&place, "alone", &["--host", "inprocess"]));
        assert_eq!(alone.status.code(), Some(4), "{}", complaint(&alone));
        assert!(
            complaint(&alone).contains("a plug-in, has changed it"),
            "{}",
            complaint(&alone)
        );
        assert!(!place.log("alone").exists());
    }
}

#[test]
fn a_library_whose_destroy_hangs_leaves_a_whole_log_and_a_reason() {
    let place = example("", "it.destroy = never", &[]);
    let scenario = place.path("eight.toml");
    let told = |out: &str, host: &str| {
        place.gerono(&["run", scenario.to_str().unwrap(), "--out", out, "--host", host])
    };
    let alone = begin(&mut told("alone", "inprocess"));
    // The processes have flown their last ticks, and are ended.
    succeed(&mut fly(&place, "processes", &[]));
    let in_real_time = output(&mut told("real", "realtime"));
    assert_flown_to_the_end(&in_real_time);
    let said = "`controller` has done its last step and not ended for 2 s";
    assert!(
        complaint(&in_real_time).contains(said),
        "{}",
        complaint(&in_real_time)
    );
    let alone = finish(alone);
    assert_eq!(alone.status.code(), Some(0), "{}", complaint(&alone));
    let said = "`destroy` of the plug-in `libpid.so` in place of `controller` has not returned for 20 s";
    assert!(complaint(&alone).contains(said), "{}", complaint(&alone));
    assert!(log(&place, "alone") == log(&place, "processes"));
}

/// No death needs the state: it is tried in every flight.
#[test]
fn a_library_whose_state_is_not_what_it_says_is_found_out() {
    let mut cases = vec![
        ("", "it.save = save_too_much", "wrote beyond its state"),
        ("", "it.save = save_nothing", "forgets a part of its state"),
        ("", "it.state_size = growing", "has a state of another size since"),
        // Forgotten from tick 500 on, and found soon after.
        (
            "it_forgets = 1",
            "it.save = save_until_asked",
            "forgets a part of its state",
        ),
    ];
    if cfg!(target_arch = "x86_64") {
        cases.push((
            "",
            "it.save = save_and_flush",
            "changed the floating-point mode in its `save`",
        ));
    }
    for (misconduct, claim, said) in cases {
        let place = example(misconduct, claim, &[]);
        for host in ["lockstep", "inprocess"] {
            let flown = output(fly(&place, host, &["--host", host]).args(restarts(host, "controller=1")));
            let told = complaint(&flown).replace("- ", "-");
            assert_eq!(flown.status.code(), Some(3), "{claim}, {host}: {told}");
            assert!(told.contains(said), "{claim}, {host}: {told}");
        }
    }
    let death = ["--crash", "controller@705:after-step"];
    let place = example("", "it.state_size = varying", &[]);
    let flown = output(fly(&place, "processes", &["--restarts", "controller=1"]).args(death));
    let told = complaint(&flown);
    assert_eq!(flown.status.code(), Some(3), "{told}");
    assert!(told.contains("`state_size` must return the same"), "{told}");
    // A replay begins with the state of another process.
    let place = example("", "it.state_size = varying", &[]);
    succeed(&mut fly(&place, "out", &["--set", "duration=2.5"]));
    let replayed = output(&mut place.gerono(&["replay", "out", "--quiet", "--from", "2.0"]));
    let told = complaint(&replayed);
    assert_eq!(replayed.status.code(), Some(1), "{told}");
    assert!(told.contains("`state_size` must return the same"), "{told}");
}

#[test]
fn libraries_of_one_name_get_the_same_inputs_in_every_host() {
    let place = example("", "", &[]);
    std::fs::create_dir(place.path("other")).unwrap();
    compile("tests/plugins/estimator.c", &place.path("other/libpid.so"), &[]);
    // Without a filter Gerono's own estimator would not read the frames.
    let estimator = ["--set", "plugins.estimator=other/libpid.so"];
    for host in ["lockstep", "inprocess"] {
        succeed(fly(&place, host, &["--host", host]).args(estimator));
        succeed(&mut place.gerono(&["replay", host, "--quiet"]));
    }
    assert!(log(&place, "lockstep") == log(&place, "inprocess"));
    let states = ["export", "lockstep", "--csv", "--topic", "vehicle/state"];
    let states = String::from_utf8(succeed(&mut place.gerono(&states)).stdout).unwrap();
    let mut rows = states.lines().map(|row| row.split(',').collect::<Vec<_>>());
    let head = rows.next().unwrap();
    let column = head.iter().position(|name| *name == "thrust").unwrap();
    let thrusts: Vec<f64> = rows.map(|row| row[column].parse().unwrap()).collect();
    assert_eq!(thrusts[0], -1.0);
    assert!(thrusts[10..].iter().all(|thrust| *thrust >= 0.0));
    let kept = std::fs::read_dir(place.path("lockstep")).unwrap();
    let mut kept: Vec<_> = kept
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .collect();
    kept.retain(|name| name.ends_with(".so"));
    kept.sort();
    assert_eq!(kept, ["estimator-libpid.so", "libpid.so"]);
}

#[test]
fn a_library_that_cannot_fly_is_refused_before_the_flight() {
    let mut cases = vec![
        ("it.abi = 2", "version 2 of the interface", &[][..]),
        ("it.layouts = others", "another layout of `path/reference`", &[]),
        ("it.layout_count = 3", "names 3 layouts", &[]),
        (r#"it.service = "plant""#, "it is a `plant`", &[]),
        ("it.restore = NULL", "a function of the interface is missing", &[]),
        ("it.state_size = enormous", "its state has 1048576 bytes", &[]),
        ("it.state_size = negative", "its state has -1 bytes", &[]),
        ("exit(0)", "called `exit` in its initialisation", &[]),
        ("it.create = leave", "called `exit` in its `create`", &[]),
        ("it.create = refuse", "it flies on Sundays only", &[]),
        ("return NULL", "returns NULL", &[]),
    ];
    if cfg!(target_arch = "x86_64") {
        cases.push((
            "",
            "changes the floating-point mode in its initialisation",
            &["-DFAST_MATH"],
        ));
        cases.push((
            "it.create = create_and_flush",
            "changes the floating-point mode in its `create`",
            &[],
        ));
        cases.push((
            "it.state_size = size_and_flush",
            "changes the floating-point mode in its `state_size`",
            &[],
        ));
    }
    for (claim, said, flags) in cases {
        let place = example("", claim, flags);
        let scenario = place.path("eight.toml");
        let refused = output(&mut place.gerono(&["check", scenario.to_str().unwrap()]));
        assert_eq!(refused.status.code(), Some(2), "{claim}: {}", complaint(&refused));
        assert!(
            complaint(&refused).contains(said),
            "{claim}: {}",
            complaint(&refused)
        );
        for host in ["inprocess", "lockstep"] {
            let refused = output(&mut fly(
                &place,
                host,
                &[&["--host", host][..], &restarts(host, "controller=0")].concat(),
            ));
            let told = complaint(&refused);
            let is_death = host == "lockstep" && said.contains("`exit`");
            // A process that ends while it starts is a death, whatever the reason.
            let code = if is_death { Some(3) } else { Some(2) };
            assert_eq!(refused.status.code(), code, "{claim}, {host}: {told}");
            // A long line may be broken behind a hyphen.
            assert!(told.replace("- ", "-").contains(said), "{claim}, {host}: {told}");
        }
    }
    let place = example("", "", &[]);
    let scenario = place.path("eight.toml");
    let scenario = scenario.to_str().unwrap();
    for (set, said) in [
        ("plugins.controller=libnone.so", "cannot be read"),
        ("plugins.controller=eight.toml", "cannot be loaded"),
        ("plugins.sha256={controller=\"00\"}", "was built again"),
        (
            "plugins.sha256={plant=\"00\"}",
            "no plug-in flies in place of `plant`",
        ),
        (
            "programs={controller=[\"true\"]}",
            "a program flies in place of `controller`",
        ),
        ("plugins.parameters.kp=inf", "give a finite number"),
        (
            "plugins.parameters.bandwith=4.0",
            "no plug-in asks for `plugins.parameters.bandwith`",
        ),
        ("controller.law=adaptive", "flies in place of the controller"),
        ("controller.k1=5.0", "flies in place of the controller"),
    ] {
        let refused = output(&mut place.gerono(&["check", scenario, "--set", set]));
        assert_eq!(refused.status.code(), Some(2), "{set}: {}", complaint(&refused));
        assert!(
            complaint(&refused).contains(said),
            "{set}: {}",
            complaint(&refused)
        );
    }
}

/// The examples in C, each with the largest distance from the path that it may have after 5 s, m.
const EXAMPLES: [(&str, &[&str], f64); 2] = [
    ("examples/plugin_c/pid.c", &[], 0.006),
    (
        "examples/plugin_casadi/controller.c",
        &["examples/plugin_casadi/law.c"],
        0.000_3,
    ),
];

#[test]
fn the_examples_in_c_fly_the_path() {
    for (source, more, limit) in EXAMPLES {
        let place = Place::new();
        let more: Vec<_> = more.iter().map(|file| format!("{ROOT}/{file}")).collect();
        let flags: Vec<_> = more.iter().map(String::as_str).collect();
        compile(source, &place.path("libpid.so"), &flags);
        std::fs::copy(
            format!("{ROOT}/examples/plugin_c/eight.toml"),
            place.path("eight.toml"),
        )
        .unwrap();
        // The laws have gains of their own.
        let sets = ["--set", "duration=10.0", "--set", "plugins.parameters={}"];
        succeed(&mut fly(&place, "flight", &sets));
        let summary = place.summary("flight");
        let ultimate = summary
            .pointer("/phases/0/ultimate")
            .and_then(serde_json::Value::as_f64);
        assert!(ultimate.unwrap() < limit, "{source}: {ultimate:?}");
        succeed(&mut place.gerono(&["replay", "flight", "--quiet"]));
    }
}

/// The mathematics of a built-in law in C command the same, to the bit, with the functions of `setup->math`.
#[test]
fn a_law_in_c_commands_as_the_built_in_one() {
    let place = Place::new();
    let text = std::fs::read_to_string(format!("{ROOT}/tests/plugins/geometric_pid.toml")).unwrap();
    let own = text.replace("law = \"geometric_pid\"\n", "") + "[plugins]\ncontroller = \"liblaw.so\"\n";
    let flags = ["-ffp-contract=off"];
    compile("tests/plugins/geometric_pid.c", &place.path("liblaw.so"), &flags);
    for (name, text) in [("built_in", text), ("own", own)] {
        let scenario = format!("{name}.toml");
        std::fs::write(place.path(&scenario), text).unwrap();
        let arguments = ["run", &scenario, "--host", "inprocess", "--quiet", "--out", name];
        succeed(&mut place.gerono(&arguments));
    }
    let expected = commands(&place, "built_in");
    assert_eq!(expected.lines().count(), 10_002);
    assert!(commands(&place, "own") == expected);
}
