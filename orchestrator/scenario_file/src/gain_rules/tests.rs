use super::*;

fn scenario(name: &str, sets: &[&str]) -> Scenario {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../scenarios/{name}.toml"));
    let sets: Vec<_> = sets.iter().map(ToString::to_string).collect();
    crate::load(&path, &sets, None).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The one rule that a scenario breaks.
fn assert_broken(name: &str, sets: &[&str], key: &str, reason: &str, fix: &str) {
    let found = warnings(&scenario(name, sets));
    let [warning] = &found[..] else {
        panic!("{found:?}")
    };
    assert_eq!(warning.key.to_string(), key);
    assert!(warning.reason.contains(reason), "{}", warning.reason);
    assert!(warning.fix.contains(fix), "{}", warning.fix);
}

#[test]
fn the_committed_scenarios_keep_all_rules() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let name = path.file_stem().unwrap().to_str().unwrap();
            assert_eq!(warnings(&scenario(name, &[])), [], "{name}");
            count += 1;
        }
    }
    assert!(count >= 10);
}

#[test]
fn gains_that_follow_keep_the_rules_for_vehicles_of_any_size() {
    for inertia in ["[6.5e-5, 6.5e-5, 1.3e-4]", "[6.5e-3, 6.5e-3, 1.3e-2]"] {
        let vehicle = format!("vehicle.inertia={inertia}");
        let told = format!("controller.initial.inertia={inertia}");
        let scaled = scenario(
            "hover",
            &[
                &vehicle,
                &told,
                "controller.beta=1.0",
                "controller.lambda_inertia=0.0",
            ],
        );
        let mut scaled = scaled;
        (scaled.controller.beta, scaled.controller.lambda_inertia) = (None, None);
        assert_eq!(warnings(&scaled), [], "{inertia}");
    }
}

#[test]
fn a_vehicle_too_light_or_too_heavy_for_beta_is_named_with_the_gain_that_follows() {
    assert_broken(
        "fig1",
        &["vehicle.change=[]", "vehicle.inertia=[1.5e-4, 1.5e-4, 1.5e-4]"],
        "vehicle.inertia",
        "a step removes is 1.3, and should be at most 1",
        "set `controller.beta` to 433.0",
    );
    assert_broken(
        "fig1",
        &["vehicle.change=[]", "vehicle.inertia=[1e-2, 1e-2, 1e-2]"],
        "vehicle.inertia",
        "the rate of the angular velocity loop is 19.5 1/s, and should be at least 24.5",
        "set `controller.beta` to 6.5",
    );
}

#[test]
fn an_adaptation_gain_above_its_limit_is_named_with_the_one_that_follows() {
    assert_broken(
        "fig1",
        &["controller.lambda_inertia=1e-8"],
        "controller.lambda_inertia",
        "Λw is 1e-8, and should be at most 2.14e-10",
        "1.07e-10 follows from the other gains",
    );
}

#[test]
fn with_body_rates_the_model_s_inertia_counts_and_the_vehicle_s_does_not() {
    let unmodelled = scenario("fig3_6", &["vehicle.inertia=[1e-5, 1e-5, 1e-5]"]);
    assert_eq!(warnings(&unmodelled), []);
    assert_broken(
        "fig3_6",
        &["model.size=[0.05, 0.05, 0.05]"],
        "model.size",
        "a step removes is",
        "set `controller.beta` to ",
    );
}

#[test]
fn an_attitude_loop_slower_than_twice_the_position_loop_is_named() {
    assert_broken(
        "fig3_6",
        &["controller.delta=0.9"],
        "controller.delta",
        "the rate of the attitude loop is 10.9 1/s, and should be at least 12",
        "set it to 0.801 or less",
    );
}

#[test]
fn what_is_learned_is_damped_and_the_mass_of_the_vehicle_counts() {
    assert_broken(
        "fig3_6",
        &["controller.lambda_disturbance=[150.0, 150.0, 150.0]"],
        "controller.lambda_disturbance",
        "the damping of the learning loop is 0.244",
        "at most 18",
    );
    assert_broken(
        "another_vehicle",
        &["controller.lambda_mass=0.6"],
        "controller.lambda_mass",
        "the damping of the learning loop is 0.2",
        "set it to ",
    );
    // At the base tick and without delays it may be less.
    assert_eq!(
        warnings(&scenario(
            "fig1",
            &["controller.lambda_disturbance=[400.0, 400.0, 400.0]"]
        )),
        []
    );
}

#[test]
fn a_hold_does_not_learn_more_than_the_prediction_error() {
    assert_broken(
        "fig3_6",
        &[
            "controller.lambda_disturbance=[8.0, 8.0, 8.0]",
            "controller.prediction_gain=8.0",
        ],
        "controller.prediction_gain",
        "the share of ε that a hold removes is 1.",
        "set it to at most 4.",
    );
}

#[test]
fn motors_that_hardly_lift_the_load_are_named() {
    assert_broken(
        "fig3_6",
        &["vehicle.actuators.thrust_max=2.3"],
        "vehicle.actuators.thrust_max",
        "thrust over weight is 1.02",
        "at least 2.48 N",
    );
}

#[test]
fn a_radio_link_that_hardly_lifts_the_believed_mass_is_named() {
    assert_broken(
        "laboratory_simulated",
        &["model.mass=0.6"],
        "rc_output.thrust_slope",
        "thrust over weight is ",
        "measure the calibration again (`gerono rc identify`), or fly a lighter load",
    );
}

#[test]
fn a_laboratory_has_no_other_mass_than_the_believed_one() {
    let reserve = |name, heavier: fn(&mut Scenario)| {
        let mut scenario = scenario(name, &[]);
        heavier(&mut scenario);
        let found = findings(&scenario).into_iter();
        let key = "rc_output.thrust_slope";
        let mut of_link = found.filter(|finding| finding.key.to_string() == key);
        of_link.next().unwrap().value
    };
    let simulated: fn(&mut Scenario) = |scenario| scenario.vehicle.mass = 5.0;
    let believed: fn(&mut Scenario) = |scenario| scenario.model.as_mut().unwrap().mass = 5.0;
    for (name, counts) in [("laboratory_simulated", false), ("outdoor_rtk", true)] {
        let stated = reserve(name, |_| ());
        assert_eq!(reserve(name, simulated) < stated, counts, "{name}");
        assert!(reserve(name, believed) < stated, "{name}");
    }
}

#[test]
fn the_gains_of_an_external_controller_are_not_judged() {
    let sets = [
        "controller.lambda_inertia=1e-8",
        "programs.controller=[\"/bin/true\"]",
    ];
    assert_eq!(findings(&scenario("fig1", &sets)), []);
}

#[test]
fn numbers_are_shown_with_three_digits() {
    assert_eq!(digits(2.140_2e-10), "2.14e-10");
    assert_eq!(digits(0.816_66), "0.817");
    assert_eq!(digits(433.333), "433");
}
