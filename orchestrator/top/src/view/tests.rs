use proptest::prelude::*;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

use super::super::keys::Key;
use super::*;
use metrics::summary::timing::Quantiles;
use run_client::snapshot::{
    BatterySnapshot, CamerasSnapshot, InputSnapshot, LinkSnapshot, LiveEvent, ReceiversSnapshot,
    ServiceSnapshot,
};

const DOCUMENT: &str = include_str!("../../../../docs/viewing.md");

fn times(p50: f64, p99: f64, max: f64) -> Option<Quantiles> {
    Some(Quantiles {
        count: 1000,
        p50,
        p90: p99,
        p99,
        p999: max,
        max,
    })
}

fn service(name: &str, pid: u32, hop: f64, inputs: &[(&str, f64)]) -> ServiceSnapshot {
    let input = |&(topic, age): &(&str, f64)| InputSnapshot {
        topic: topic.to_owned(),
        age: Some(age),
    };
    ServiceSnapshot {
        name: name.to_owned(),
        pid,
        flies: true,
        rate: 1000,
        wake: times(hop, 4.0 * hop, 60.0 * hop),
        step: times(2.0 * hop, 5.0 * hop, 20.0 * hop),
        inputs: inputs.iter().map(input).collect(),
        ..ServiceSnapshot::default()
    }
}

/// A flight whose controller has just been killed for the second time.
fn snapshot(time: f64) -> Snapshot {
    let mut services = vec![
        service("plant", 41_201, 31e-6, &[("rc/frame", 0.001)]),
        service(
            "estimator",
            41_202,
            9e-6,
            &[("mocap/pose", 0.0), ("rc/frame", 0.001)],
        ),
        service("path_generator", 41_203, 7e-6, &[("vehicle/state", 0.0)]),
        service(
            "controller",
            41_377,
            8e-6,
            &[("vehicle/state", 0.0), ("path/reference", 0.0)],
        ),
        service("rc_output", 41_205, 6e-6, &[("control/command", 0.034)]),
    ];
    services[3] = ServiceSnapshot {
        flies: false,
        rate: 0,
        wake: None,
        step: None,
        missed_steps: 61,
        restarts: 1,
        ..services[3].clone()
    };
    services[4].late_inputs = 12_345;
    let event = |time, text: &str| LiveEvent {
        time,
        text: text.to_owned(),
    };
    Snapshot {
        scenario: "Rise to a point and hover there".to_owned(),
        time,
        duration: 120.0,
        phase: Some("fly".to_owned()),
        armed: true,
        landing: false,
        killed: false,
        killed_by: None,
        refusal_to_arm: None,
        response: None,
        services,
        capture_to_frame: times(58e-6, 140e-6, 1.9e-3),
        cameras: None,
        receivers: None,
        radio_link: None,
        battery: None,
        position_error: Some(0.0167 + 0.5 / (1.0 + time * time)),
        mass_estimate: Some(0.2 + 0.01 / (1.0 + time)),
        disturbance_estimate: (time > 20.0).then_some(0.3742),
        recorded: 412_345,
        events: vec![
            event(12.0, "`controller` was killed by hand"),
            event(12.0, "`controller` (process 41204) died: signal 9 (SIGKILL)"),
            event(12.1, "`controller` was restarted"),
            event(45.0, "`controller` was killed by hand"),
        ],
    }
}

/// A view of the 45 seconds of that flight.
fn with_view<T>(controls: &Controls, silence: Option<Duration>, look: impl FnOnce(&View) -> T) -> T {
    let mut history = History::default();
    for quarter in 0..=180 {
        history.keep(&snapshot(f64::from(quarter) * 0.25));
    }
    let snapshot = snapshot(45.0);
    look(&View {
        run: "4711-0",
        snapshot: Some(&snapshot),
        history: &history,
        controls,
        silence,
    })
}

fn screen(controls: &Controls, width: u16, height: u16) -> String {
    with_view(controls, None, |view| {
        // As the terminal shows it: what has been drawn, cell by cell.
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal
            .draw(|frame| frame.render_widget(view, frame.area()))
            .unwrap();
        let drawn = terminal.backend().buffer();
        let text = view.lines(width, height).join("\n");
        let mut expected = Buffer::empty(drawn.area);
        view.render(drawn.area, &mut expected);
        assert_eq!(*drawn, expected);
        text
    })
}

fn selecting(place: usize) -> Controls {
    let mut controls = Controls::new(true);
    for _ in 0..place {
        controls.press(Key::Down, &snapshot(0.0).services);
    }
    controls
}

#[test]
fn the_view_in_the_documentation_is_the_one_of_80_by_24() {
    let drawn = screen(&selecting(3), 80, 24);
    let (_, shown) = DOCUMENT
        .split_once("```text\n")
        .expect("docs/viewing.md shows a view");
    let (shown, _) = shown.split_once("\n```").expect("a block ends");
    assert!(
        shown == drawn,
        "docs/viewing.md is out of date; it should show\n\n{drawn}\n"
    );
}

/// The line of cameras, receivers, link and battery in a window of this width.
fn line_of_the_laboratory(snapshot: &Snapshot, width: u16) -> String {
    let view = View {
        run: "4711-0",
        snapshot: Some(snapshot),
        history: &History::default(),
        controls: &selecting(3),
        silence: None,
    };
    view.without_keys(width).lines().nth(3).unwrap().to_owned()
}

#[test]
fn a_battery_has_its_voltage_in_the_line_of_the_laboratory_and_a_low_one_comes_first() {
    let line = |battery| {
        let snapshot = Snapshot {
            battery: Some(battery),
            ..snapshot(45.0)
        };
        line_of_the_laboratory(&snapshot, 80)
    };
    let measured = BatterySnapshot {
        voltage: 7.412,
        age: Some(0.42),
        factor: Some(1.05),
        trouble: None,
    };
    assert_eq!(line(measured.clone()), "battery 7.41 V, 0.4s old");
    let modelled = BatterySnapshot {
        age: None,
        ..measured.clone()
    };
    assert_eq!(line(modelled), "battery 7.41 V, modelled");
    let low = BatterySnapshot {
        trouble: Some("the battery is low".to_owned()),
        ..measured
    };
    assert!(line(low).starts_with("the battery is low  battery 7.41 V"));
}

#[test]
fn what_is_in_a_laboratory_has_a_line_and_what_is_the_matter_comes_first() {
    let drawn_in = |width: u16, cameras: Option<CamerasSnapshot>| {
        let snapshot = Snapshot {
            cameras,
            radio_link: Some(LinkSnapshot {
                trouble: None,
                sent: 812,
                lost: 3,
            }),
            ..snapshot(45.0)
        };
        line_of_the_laboratory(&snapshot, width)
    };
    let drawn = |cameras| drawn_in(80, cameras);
    let cameras = CamerasSnapshot {
        rate: 99.96,
        latency: 4.2e-3,
        jitter: 310e-6,
        frames: 9012,
        believed: 9000,
        trouble: None,
        refused: None,
    };
    let well = drawn(Some(cameras.clone()));
    assert_eq!(
        well,
        "cameras 100.0 Hz, 4.2ms old ±310µs, 9000 of 9012 believed  link 812 sent, 3 lost"
    );
    let trouble = "the last pose of `quad` that can be believed is 2.0 s old".to_owned();
    let blind = drawn(Some(CamerasSnapshot {
        trouble: Some(trouble.clone()),
        ..cameras.clone()
    }));
    assert!(blind.starts_with(&trouble), "{blind}");
    let reason = "poses of other bodies refused: 3 times a coordinate or an angle is not a number";
    let stranger = CamerasSnapshot {
        refused: Some(reason.to_owned()),
        ..cameras
    };
    let stranger = drawn_in(200, Some(stranger));
    assert!(
        stranger.starts_with("cameras 100.0 Hz") && stranger.contains(reason),
        "{stranger}"
    );
    assert_eq!(drawn(None), "link 812 sent, 3 lost");
}

#[test]
fn receivers_have_their_rates_in_the_line_of_the_laboratory_and_a_failure_comes_first() {
    let line = |receivers: &ReceiversSnapshot| {
        let snapshot = Snapshot {
            receivers: Some(receivers.clone()),
            ..snapshot(45.0)
        };
        line_of_the_laboratory(&snapshot, 200)
    };
    let good = ReceiversSnapshot {
        rates: [249.6, 9.96, 25.0, 0.0],
        packets: 9012,
        ..ReceiversSnapshot::default()
    };
    let figures = "receivers, Hz: inertial 249.6, fixes 10.0, altitudes 25.0, fields 0.0";
    assert_eq!(line(&good), figures);
    let refused = Some("3 times HIGHRES_IMU had wrong checksum".to_owned());
    let spoilt = ReceiversSnapshot { refused, ..good };
    assert_eq!(
        line(&spoilt),
        format!("{figures}  3 times HIGHRES_IMU had wrong checksum")
    );
    let trouble = "no sample for `gnss/fix` has come".to_owned();
    let lost = ReceiversSnapshot {
        trouble: Some(trouble.clone()),
        ..spoilt
    };
    assert_eq!(line(&lost), format!("{trouble}  {figures}"));
}

#[test]
fn what_is_wrong_has_a_line_below_the_state() {
    let refusal = "the cameras do not see the vehicle".to_owned();
    let mut seen = Snapshot {
        refusal_to_arm: Some(refusal),
        ..snapshot(45.0)
    };
    let lines = |seen: &Snapshot, height| {
        let view = View {
            run: "4711-0",
            snapshot: Some(seen),
            history: &History::default(),
            controls: &selecting(3),
            silence: None,
        };
        view.lines(80, height)
    };
    let words = "will not arm: the cameras do not see the vehicle";
    assert_eq!(lines(&seen, 24)[2], words);
    assert_eq!(lines(&seen, 4)[1], words, "it needs little room");
    seen.response = Some("roll answers with the wrong sign".to_owned());
    (seen.killed, seen.killed_by) = (true, Some("`envelope.box` was exceeded".to_owned()));
    assert_eq!(
        lines(&seen, 24)[2],
        "killed: `envelope.box` was exceeded; WRONG: roll answers with the wrong sign"
    );
}

#[test]
fn every_size_can_be_drawn_in_every_mode() {
    let services = snapshot(0.0).services;
    for keys in [
        &[][..],
        &[Key::Character('?')],
        &[Key::Character('s')],
        &[Key::Character('k')],
    ] {
        let mut controls = Controls::new(true);
        controls.set_gains(vec!["controller.k1=3.0".to_owned(); 30]);
        for &key in keys {
            controls.press(key, &services);
        }
        for (width, height) in [
            (0, 0),
            (1, 1),
            (19, 3),
            (20, 4),
            (40, 10),
            (80, 23),
            (80, 24),
            (200, 60),
            (500, 8),
        ] {
            screen(&controls, width, height);
        }
    }
}

proptest! {
    #[test]
    fn no_size_is_too_odd(width in 0..250_u16, height in 0..80_u16, place in 0..5_usize) {
        screen(&selecting(place), width, height);
    }
}

#[test]
fn what_matters_most_is_there_at_40_by_10() {
    let drawn = screen(&selecting(3), 40, 10);
    for text in [
        "45.0 s of 120.0 s",
        "plant",
        ">controller",
        "down",
        "wake",
        "q leave",
        "1000",
    ] {
        assert!(drawn.contains(text), "no {text:?} in\n{drawn}");
    }
}

#[test]
fn the_selected_service_is_never_scrolled_out() {
    for height in 4..12 {
        for place in 0..5 {
            let drawn = screen(&selecting(place), 80, height);
            assert!(
                drawn.lines().any(|line| line.starts_with('>')),
                "{height} rows:\n{drawn}"
            );
        }
    }
}

#[test]
fn a_large_terminal_tells_of_every_input_and_every_event() {
    let drawn = screen(&selecting(0), 200, 60);
    for text in [
        "mocap/pose 0ns, rc/frame 1.0ms",
        "control/command 34ms",
        "killed by hand",
    ] {
        assert!(drawn.contains(text), "no {text:?} in\n{drawn}");
    }
}

#[test]
fn a_question_names_what_it_would_do_and_to_whom() {
    let mut controls = Controls::new(true);
    controls.press(Key::Character('f'), &snapshot(0.0).services);
    let drawn = screen(&controls, 80, 24);
    assert!(
        drawn.ends_with("freeze plant (41201)? y: yes, else: no"),
        "{drawn}"
    );
}

#[test]
fn the_gains_are_shown_while_one_is_typed_and_of_a_long_setting_the_end() {
    let mut controls = Controls::new(false);
    controls.set_gains(vec![
        "controller.k1=3.0".to_owned(),
        "controller.k2=2.0".to_owned(),
    ]);
    controls.press(Key::Character('s'), &[]);
    let drawn = screen(&controls, 80, 24);
    assert!(
        drawn.contains("controller.k1=3.0") && drawn.contains("controller.k2=2.0"),
        "{drawn}"
    );
    assert!(
        drawn.ends_with("set controller.▏  Enter: set, Esc: no"),
        "{drawn}"
    );
    for digit in "lambda_disturbance=[1.0, 1.0, 0.5]".chars() {
        controls.press(Key::Character(digit), &[]);
    }
    let drawn = screen(&controls, 40, 24);
    assert!(
        drawn.ends_with("set 1.0, 1.0, 0.5]▏  Enter: set, Esc: no"),
        "{drawn}"
    );
}

#[test]
fn help_fits_a_small_terminal_whole() {
    let mut controls = Controls::new(false);
    controls.press(Key::Character('?'), &[]);
    let drawn = screen(&controls, 80, 24);
    assert!(
        drawn.contains("select a service") && drawn.contains("nothing was known. "),
        "{drawn}"
    );
}

#[test]
fn a_run_that_does_not_answer_is_told_of() {
    let controls = Controls::new(false);
    let silence = Some(Duration::from_secs(7));
    let drawn = with_view(&controls, silence, |view| view.lines(80, 24));
    assert!(drawn[0].ends_with("NO ANSWER for 7 s"), "{}", drawn[0]);
    let history = History::default();
    let nothing = View {
        run: "4711-0",
        snapshot: None,
        history: &history,
        controls: &controls,
        silence: None,
    };
    assert!(nothing.lines(80, 24)[1].contains("not answered yet"));
}

#[test]
fn a_killed_flight_says_so_first() {
    let (controls, history) = (Controls::new(false), History::default());
    let snapshot = Snapshot {
        killed: true,
        ..snapshot(45.0)
    };
    let view = View {
        run: "4711-0",
        snapshot: Some(&snapshot),
        history: &history,
        controls: &controls,
        silence: None,
    };
    assert!(view.lines(40, 10)[1].contains("KILLED"));
    let printed = view.without_keys(80);
    assert!(
        !printed.contains("q leave") && printed.ends_with("by hand\n"),
        "{printed}"
    );
}
