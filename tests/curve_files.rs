//! Paths from files: flown as the program that wrote them means them, and whole in the log without the file.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common::{Place, assert_flown_to_the_end, complaint, output, said, succeed};

/// Polynomials of minimum snap through five points, by `numpy.linalg.solve`, printed with six digits.
const POLYNOMIALS: &str = include_str!("../orchestrator/scenario_file/src/tests/polynomials.csv");

/// Their values in {I} 1.5 m higher, by `numpy.polynomial.polynomial.polyval`: between points, and where two meet.
const VALUES: [(f64, [f64; 3]); 7] = [
    (0.55, [0.115_326_859, 0.095_711_049, -1.742_285_420]),
    (1.1, [0.7, 0.4, -2.0]),
    (1.23, [0.845_809_919, 0.404_472_306, -2.078_219_321]),
    (1.87, [1.108_782_606, -0.253_673_252, -2.300_581_101]),
    (2.345, [0.783_532_120, -0.854_367_228, -2.170_361_663]),
    (3.05, [-0.138_137_427, -0.738_162_086, -1.761_348_074]),
    (3.72, [-0.591_273_606, -0.407_733_394, -1.602_536_317]),
];

/// A place with a scenario whose path is the file, with more keys of the waypoints.
fn place(content: &str, more: &str) -> Place {
    let place = Place::new();
    std::fs::write(place.path("flown.csv"), content).unwrap();
    let text = format!(
        "duration = 4.2\n\
         vehicle = {{ mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4], initial = {{ position = [0.0, 0.0, -1.5] }} }}\n\
         [path]\nmode = \"trajectory_tracking\"\n\
         [path.curve.waypoints]\nfile = \"flown.csv\"\n{more}\n"
    );
    std::fs::write(place.path("flight.toml"), text).unwrap();
    place
}

/// What a command prints.
fn answer(place: &Place, arguments: &[&str]) -> String {
    String::from_utf8(succeed(&mut place.gerono(arguments)).stdout).unwrap()
}

/// With trajectory tracking γ is the time. The curve through the points was measured within 2.8 µm of the polynomials.
#[test]
fn polynomials_are_flown_as_numpy_evaluates_them_and_replayed_without_their_file() {
    let place = place(POLYNOMIALS, "offset = [0.0, 0.0, -1.5]");
    let run = ["run", "flight.toml", "--quiet", "--out"];
    for more in [&["alone", "--host", "inprocess"][..], &["processes"]] {
        assert_flown_to_the_end(&output(&mut place.gerono(&[&run[..], more].concat())));
    }
    std::fs::remove_file(place.path("flown.csv")).unwrap();
    let digest = |out: &str| succeed(&mut place.gerono(&["digest", out])).stdout;
    assert_eq!(digest("alone"), digest("processes"));
    let replayed = said(&succeed(&mut place.gerono(&["replay", "processes", "--quiet"])));
    assert!(replayed.contains("identical: "), "{replayed}");

    let table = answer(&place, &["export", "alone", "--csv", "--topic", "path/reference"]);
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().unwrap();
    let at = |name: &str| names.iter().position(|known| *known == name).unwrap();
    let columns = [
        "gamma",
        "position_world.0",
        "position_world.1",
        "position_world.2",
    ]
    .map(at);
    let rows: Vec<[f64; 4]> = lines
        .map(|line| columns.map(|column| line[column].parse().unwrap()))
        .collect();
    for (time, expected) in VALUES {
        let row = rows.iter().find(|row| (row[0] - time).abs() < 1e-6).unwrap();
        for (found, expected) in row[1..].iter().zip(expected) {
            assert!((found - expected).abs() < 1e-5, "{time} s: {row:?}");
        }
    }
    let info: serde_json::Value =
        serde_json::from_str(&answer(&place, &["info", "alone", "--json"])).unwrap();
    let way = &info["scenario"]["path"]["curve"]["waypoints"];
    assert_eq!(way["file"], "flown.csv");
    assert_eq!(way["points"].as_array().unwrap().len(), 41);
    assert_eq!(way["sha256"].as_str().map(str::len), Some(64));
}

#[test]
fn check_says_that_a_path_lies_below_the_ground_or_begins_far_away() {
    let check = |place: &Place| said(&succeed(&mut place.gerono(&["check", "flight.toml"])));
    let well_placed = check(&place(POLYNOMIALS, "offset = [0.0, 0.0, -1.5]"));
    assert!(!well_placed.contains("warning: `path.curve`"), "{well_placed}");
    let below = check(&place("x,y,z\n0,0,-1\n1,0,-1\n", "closed = false"));
    assert!(
        below.contains("goes down to z = 1.00 m, 1.00 m below the ground"),
        "{below}"
    );
    assert!(below.contains("starts 2.50 m from the vehicle"), "{below}");
}

#[test]
fn the_rows_of_a_sweep_belong_to_the_content_of_the_file() {
    let place = place("x,y,z\n0,0,1.5\n1,0,1.5\n", "");
    let sweep = "scenario = \"flight.toml\"\nsamples = 2\nseed = 1\n[vary]\n\"vehicle.mass\" = { uniform = [0.18, 0.22] }\n";
    std::fs::write(place.path("sweep.toml"), sweep).unwrap();
    let run = ["sweep", "run", "sweep.toml", "--out", "results"];
    succeed(&mut place.gerono(&run));
    std::fs::write(place.path("flown.csv"), "x,y,z\n0,0,1.5\n1,0,1.6\n").unwrap();
    let again = output(&mut place.gerono(&run));
    assert_eq!(again.status.code(), Some(2), "{}", complaint(&again));
    let told = complaint(&again);
    assert!(
        told.contains("the file of the path of `as stated` is another file"),
        "{told}"
    );
}
