//! Paths from files of points and of polynomials: what they become, and what is refused with the place in the file.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use scenario::{Curve, Waypoints};

use super::*;

/// Polynomials of minimum snap through five points, by `numpy.linalg.solve`, printed with six digits.
const POLYNOMIALS: &str = include_str!("polynomials.csv");

const FLIGHT: &str = "duration = 4.0\nvehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n";

/// The scenario with the path of a file of this content and more keys of the waypoints.
fn load_file(content: &str, more: &str, sets: &[&str]) -> Result<Scenario, ScenarioError> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("paths")).unwrap();
    std::fs::write(folder.path().join("paths/flown.csv"), content).unwrap();
    let text = format!("{FLIGHT}[path.curve.waypoints]\nfile = \"paths/flown.csv\"\n{more}\n");
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    load_from(&folder.path().join("flight.toml"), &text, &sets, None)
}

fn waypoints(scenario: &Scenario) -> &Waypoints {
    match &scenario.path.curve {
        Curve::Waypoints(way) => way,
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn refused(content: &str, more: &str, pieces: &[&str]) {
    let error = load_file(content, more, &[]).expect_err("the file is wrong");
    let shown = format!("{error:#}\n{}", narrated(&error));
    for piece in pieces {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}

/// The expected points are those of `numpy.polynomial.polynomial.polyval`.
#[test]
fn polynomials_become_points_at_equal_times_with_z_down() {
    let scenario = load_file(POLYNOMIALS, "", &[]).unwrap();
    let way = waypoints(&scenario);
    assert!((way.interval - 0.1).abs() < 1e-12, "{}", way.interval);
    assert_eq!(way.points.len(), 41);
    for (index, expected) in [
        (0, [0.0, 0.0, -0.2]),
        (
            7,
            [
                0.236_895_211_707_700,
                0.184_043_327_181_000,
                -0.290_201_484_218_300,
            ],
        ),
        (11, [0.7, 0.4, -0.5]),
        (
            23,
            [
                0.829_717_378_457_600,
                -0.817_734_211_712_000,
                -0.692_312_780_748_800,
            ],
        ),
        (
            32,
            [
                -0.310_378_958_745_600,
                -0.626_108_506_675_200,
                -0.196_861_425_612_800,
            ],
        ),
        (
            40,
            [
                -0.600_001_412_915_200,
                -0.400_001_204_582_400,
                -0.100_002_743_449_600,
            ],
        ),
    ] {
        for (axis, expected) in expected.into_iter().enumerate() {
            let found = way.points[index][axis];
            // Where two polynomials meet, either end may be taken.
            assert!((found - expected).abs() < 2e-6, "{index} {axis}: {found}");
        }
    }
    assert!(way.points[0][1].is_sign_positive(), "no negative zero");
}

/// SHA-256 by `sha256sum`.
#[test]
fn the_scenario_has_name_and_hash_of_the_file_and_refuses_another() {
    let content = "x,y,z\n0,0,1\n1,0,1\n";
    let sum = "9fa356f582a071e1518388205eab137d2a42bca5b6b009600078450196243ee4";
    let scenario = load_file(content, "", &[]).unwrap();
    let way = waypoints(&scenario);
    assert_eq!(way.file.as_deref(), Some(Path::new("flown.csv")));
    assert_eq!(way.sha256.as_deref(), Some(sum));
    assert_eq!(way.points, [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0]]);
    load_file(content, &format!("sha256 = \"{sum}\""), &[]).unwrap();
    refused(
        content,
        "sha256 = \"00\"",
        &["`path.curve.waypoints.sha256`", sum, "has changed since"],
    );
    // What a log has needs no file.
    let text = crate::to_toml(&scenario).unwrap();
    let again = super::load_text(&text, &[]).unwrap();
    assert_eq!(again, scenario);
}

#[test]
fn points_follow_in_the_order_of_lines_with_stated_or_equal_times() {
    let plain = load_file(
        "\u{feff}id, X, Y, Z,\r\n7, 0, 0.5, 1,\r\n\r\n9, 1, -0.5, 1.25,\r\n",
        "interval = 0.5\noffset = [0.0, 1.0, -0.5]",
        &[],
    )
    .unwrap();
    let way = waypoints(&plain);
    assert_eq!(way.points, [[0.0, 0.5, -1.5], [1.0, 1.5, -1.75]]);
    assert_eq!(way.interval, 0.5);
    // As numpy.savetxt writes names, and a third of a second to three digits.
    let timed = load_file(
        "# t,x,y,z\n2.000,0,0,1\n2.333,1,0,1\n2.667,1,1,1\n3.000,0,1,1\n",
        "closed = true",
        &[],
    )
    .unwrap();
    let way = waypoints(&timed);
    assert!((way.interval - 1.0 / 3.0).abs() < 1e-12, "{}", way.interval);
    assert!(way.closed);
}

#[test]
fn a_closed_path_of_polynomials_has_no_point_twice() {
    // There along x in one second, and back in the next.
    let there_and_back = "duration,x^0,x^1,x^2,x^3,y^0,y^1,z^0\n1,0,0,3,-2,0,0,1\n1,1,0,-3,2,0,0,1\n";
    let open = load_file(there_and_back, "", &[]).unwrap();
    let closed = load_file(there_and_back, "closed = true", &[]).unwrap();
    let [open, closed] = [&open, &closed].map(waypoints);
    assert_eq!(open.points.len(), closed.points.len() + 1);
    assert_eq!(open.points[..closed.points.len()], closed.points);
    refused(
        "duration,x^0,x^1,y^0,z^0\n1,0,1,0,1\n",
        "closed = true",
        &[
            "flown.csv:2",
            "it ends 1.000 m from its start",
            "leave `closed` out",
        ],
    );
}

#[test]
fn a_file_that_is_no_path_is_refused_with_place_reason_and_fix() {
    for (content, more, pieces) in [
        ("", "", &["the file is empty", "write points as `x,y,z`"][..]),
        (
            "0,0,1\n1,0,1\n",
            "",
            &["flown.csv:1", "does not name the columns"],
        ),
        (
            "x;y;z\n0;0;1\n",
            "",
            &["flown.csv:1", "no comma between column names"],
        ),
        ("x,y\n0,0\n", "", &["there is no column `z`"]),
        (
            "x,y,z,x\n0,0,1,0\n",
            "",
            &["flown.csv:1:7", "a second column `x`", "remove one of them"],
        ),
        (
            "x,y,z\n0,0,1\n1,eins,1\n",
            "",
            &["flown.csv:3:3", "`eins` is not a number"],
        ),
        (
            "x,y,z\n0,0,1\n1,inf,1\n",
            "",
            &["flown.csv:3:3", "`inf` is not a number"],
        ),
        (
            "x,y,z\n0,0,1\n1,0\n",
            "",
            &["flown.csv:3", "2 numbers below 3 names"],
        ),
        (
            "x,y,z\n0,0,1\n1,0,1\n1,0,1\n",
            "",
            &[
                "flown.csv:4",
                "equals that of the previous line",
                "stops are not part of a path",
            ],
        ),
        (
            "x,y,z,yaw\n0,0,1,0\n1,0,1,0.5\n",
            "",
            &["flown.csv:3:7", "`yaw` is 0.5", "`path.yaw`"],
        ),
        (
            "t,x,y,z\n0,0,0,1\n1,1,0,1\n3,2,0,1\n",
            "",
            &[
                "flown.csv:3",
                "the time 1.0 s is not 1.5 s",
                "leave the column `t` out",
            ],
        ),
        (
            "t,x,y,z\n1,0,0,1\n1,1,0,1\n",
            "",
            &["flown.csv:2", "the time 1.0 s"],
        ),
        (
            "t,x,y,z\n0,0,0,1\n1,1,0,1\n",
            "interval = 2.0",
            &[
                "`path.curve.waypoints.interval`",
                "follows from the times",
                "`path.speed`",
            ],
        ),
        ("x,y,z\n0,0,1\n", "", &["an open curve through 1 points"]),
        ("x,y,z\n", "", &["an open curve through 0 points"]),
        ("duration,x^0,y^0,z^0\n", "", &["the file has no polynomials"]),
        (
            "duration,x^0,x^2,y^0,z^0\n1,0,1,0,1\n",
            "",
            &["flown.csv:1:14", "the column `x^2` is unknown"],
        ),
        (
            "duration,x^0,x^1,y^0,z^0\n0,0,1,0,1\n",
            "",
            &["flown.csv:2", "the duration 0.0 s is not above 0"],
        ),
        (
            "duration,x^0,x^1,y^0,z^0\n1,0,1,0,1\n1,1.2,1,0,1\n",
            "",
            &["flown.csv:3", "starts 0.200 m from the end"],
        ),
        (
            "duration,x^0,x^1,y^0,z^0\n1,0,1,0,1\n1,1,2,0,1\n",
            "",
            &["flown.csv:3", "jumps by 1.000 m/s"],
        ),
        (
            "duration,x^0,x^1,x^2,y^0,z^0\n1,0,2,-1,0,1\n1,1,0,0,0,1\n",
            "",
            &["flown.csv:3", "stops at 1.10 s"],
        ),
        (
            "duration,x^0,x^1,y^0,z^0\n2000,0,1,0,1\n",
            "",
            &["takes 2000.0 s", "split it into several paths"],
        ),
        (
            "duration,x^0,x^1,y^0,z^0,yaw^0\n1,0,1,0,1,0.1\n",
            "",
            &["flown.csv:2:11", "`yaw^0` is 0.1"],
        ),
        (
            "x,y,z\n0,0,1\n1,0,1\n",
            "points = [[0.0, 0.0, 1.0]]",
            &["both points and a file", "leave `points` or `file` out"],
        ),
    ] {
        refused(content, more, pieces);
    }
}

#[test]
fn a_file_that_is_not_there_and_keys_without_a_file_are_refused() {
    let at_root = Path::new("/nowhere/flight.toml");
    let error = |more: &str| {
        let text = format!("{FLIGHT}[path.curve.waypoints]\n{more}\n");
        narrated(&load_from(at_root, &text, &[], None).unwrap_err())
    };
    let missing = error("file = \"x.csv\"");
    assert!(
        missing.contains("cannot read /nowhere/x.csv") && missing.contains("label at line 4"),
        "{missing}"
    );
    let idle = error("points = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]\noffset = [0.0, 0.0, -1.0]");
    assert!(
        idle.contains("`path.curve.waypoints.offset` cannot be used"),
        "{idle}"
    );
}

#[test]
fn a_setting_names_another_file() {
    let scenario = load_file(
        "x,y,z\n0,0,1\n1,0,1\n",
        "",
        &["path.curve.waypoints.offset=[0.0,0.0,-1.0]"],
    )
    .unwrap();
    assert_eq!(waypoints(&scenario).points[0], [0.0, 0.0, -2.0]);
    let error = load_file(
        "x,y,z\n0,0,1\n1,0,1\n",
        "",
        &["path.curve.waypoints.file=other.csv"],
    )
    .unwrap_err();
    assert!(format!("{error:#}").contains("other.csv"), "{error:#}");
}
