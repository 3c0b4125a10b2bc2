//! Values that cannot be flown: shared_types decides which, here they are found in the file.

use super::*;

/// fig1.toml with one replacement is refused on the line of the replacement.
#[test]
fn values_that_do_not_fit_are_refused_at_their_line() {
    let cases: [(&str, &str, &[&str]); 12] = [
        (
            "sigma_max = 1.5",
            "sigma_max = 0.02",
            &[
                "σmax = 0.02 is not above |δ|/k1 = 0.1/4.0 = 0.025",
                "help: raise `sigma_max` above 0.025",
            ],
        ),
        (
            "delta = 0.1",
            "delta = 0.0",
            &[
                "δ is 0",
                "help: give a number other than 0; the angular velocity (18) divides by it",
            ],
        ),
        (
            "epsilon_eta = 0.01",
            "epsilon_eta = 1.7",
            &[
                "ε = 1.7 1/kg is not below 1/mmax = 1/0.6 = 1.66667 1/kg",
                "help: lower `epsilon_eta` below 1.66667",
            ],
        ),
        (
            "mass_min = 0.1",
            "mass_min = 0.7",
            &[
                "mmin = 0.7 kg is not below mmax = 0.6 kg",
                "help: lower `mass_min` or raise `mass_max`",
            ],
        ),
        (
            "k3 = 13.0",
            "k3 = -13.0",
            &["k3 = -13.0 is not above 0", "help: give a number above 0"],
        ),
        (
            "k4 = 1.0",
            "k4 = 0.0",
            &["k4 = 0.0 is not above 0", "help: give a number above 0"],
        ),
        (
            "inertia = [7.96e-4, 7.96e-4, 15.92e-4]",
            "inertia = [7.96e-4, 7.96e-4, 20.0e-4]",
            &[
                "`vehicle.change.0.inertia.2`",
                "no body is like that",
                "help: check the moments",
            ],
        ),
        (
            "mass = 0.245",
            "mass = 0.9",
            &[
                "the vehicle's new mass of 0.9 kg lies outside the controller's bounds from 0.1 kg to 0.6 kg (Assumption 1)",
                "help: raise `controller.bounds.mass_max` to 0.9 or more",
            ],
        ),
        (
            "disturbance = [0.3, 0.2, 0.1]",
            "disturbance = [0.3, 5.0, 0.1]",
            &[
                "5.0 m/s² lies outside the controller's bounds of ±3.0 m/s²",
                "help: raise `controller.bounds.disturbance`",
            ],
        ),
        (
            "at = 30.0 ",
            "at = 60.5 ",
            &[
                "the change at 60.5 s comes after the end of the flight at 60.0 s",
                "help: let it happen earlier",
            ],
        ),
        (
            "duration = 60.0",
            "duration = 60.0005",
            &[
                "60.0005 s is not a whole number of base ticks of 0.001 s",
                "help: use 60.0 or 60.001",
            ],
        ),
        (
            "alpha1 = 0.5",
            "alpha1 = 1.5",
            &["α1 = 1.5 m is not below α2 = 1.5 m", "help: lower `alpha1`"],
        ),
    ];
    for (part, replacement, pieces) in cases {
        let text = with(&fig1(), part, replacement);
        refused_on_line(&text, line_of(&text, replacement), pieces);
    }
}

#[test]
fn a_change_before_the_one_above_it() {
    let text = fig1() + "\n[[vehicle.change]]\nat = 20.0\nmass = 0.3\n";
    refused_on_line(
        &text,
        line_of(&text, "at = 20.0"),
        &[
            "`vehicle.change.1.at`",
            "is listed after the one at 30.0 s",
            "help: put the changes in the order",
        ],
    );
}

#[test]
fn a_change_of_nothing() {
    let text = fig1() + "\n[[vehicle.change]]\nat = 45.0\n";
    let last_header = line_of(&text, "at = 45.0") - 1;
    refused_on_line(
        &text,
        last_header,
        &["the change changes nothing", "help: state a new `mass`"],
    );
}

#[test]
fn waypoints_that_coincide() {
    let text = std::fs::read_to_string(repository("scenarios/waypoints.toml")).unwrap();
    let text = with(
        &text,
        "[1.0, -1.0, -1.4],",
        "[1.0, -1.0, -1.4],\n    [1.0, 1.0, -1.0],",
    );
    let closing = text.rfind("[1.0, 1.0, -1.0]").unwrap();
    refused_on_line(
        &text,
        text[..closing].matches('\n').count() + 1,
        &[
            "`path.curve.waypoints.points.4`",
            "coincides with the first",
            "help: leave the last point out",
        ],
    );
}

#[test]
fn an_edge_without_delay_and_one_that_is_not_there() {
    let text = fig1() + "\n[schedule.latency]\n\"rc/frame -> estimator\" = 0.0\n";
    refused_on_line(
        &text,
        line_of(&text, "\"rc/frame -> estimator\""),
        &[
            "wait for each other within one tick",
            "help: give this edge a latency",
        ],
    );
    let text = fig1() + "\n[schedule.latency]\n\"rc.frame -> plant\" = 0.005\n";
    refused_on_line(
        &text,
        line_of(&text, "\"rc.frame -> plant\""),
        &[
            "there is no edge `rc.frame -> plant`",
            "help: did you mean `rc/frame -> plant`?",
        ],
    );
}

/// Every number of the scenario is checked: none takes NaN or infinity, and each refusal names the number.
#[test]
fn a_number_that_is_none_anywhere() {
    let text = fig1();
    let lines: Vec<&str> = text.lines().collect();
    let mut checked = 0;
    for (index, line) in lines.iter().enumerate() {
        let code = line.split('#').next().unwrap();
        let Some((key, value)) = code.split_once(" = ") else {
            continue;
        };
        if value.contains('"') || key == "seed" {
            continue;
        }
        for number in value.split([' ', ',', '[', ']']).filter(|part| !part.is_empty()) {
            for none in ["nan", "-inf"] {
                let mut lines: Vec<String> = lines.iter().map(|&line| line.to_owned()).collect();
                lines[index] = format!("{key} = {}", value.replacen(number, none, 1));
                let shown = refusal(&lines.join("\n"), &[]);
                assert!(
                    shown.contains(&format!("line {}, column", index + 1)),
                    "{key}:\n{shown}"
                );
                checked += 1;
            }
        }
    }
    assert!(checked > 80, "only {checked}");
}

/// A wrong value that the file does not state is shown at the deepest table on the way to it.
#[test]
fn a_default_that_does_not_fit_is_shown_at_its_table() {
    let text = with(&fig1(), "mass = 0.2                      # 1/η̂(0), kg\n", "");
    let text = with(&text, "mass = 0.2                      # m, kg", "mass = 0.23");
    let text = with(&text, "mass_min = 0.1", "mass_min = 0.22");
    refused_on_line(
        &text,
        line_of(&text, "[controller.initial]"),
        &[
            "`controller.initial.mass` cannot be flown",
            "the initial estimate of the mass of 0.2 kg lies outside",
        ],
    );
}
