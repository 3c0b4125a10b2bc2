"""Flights have the bytes of the command, and their samples are arrays."""

import copy
import json
import multiprocessing
import operator
import pickle
import subprocess
import threading

import numpy as np
import pytest
from conftest import REPOSITORY, SHORT, ctrl_c

import gerono


def run(command, scenario, out, *more):
    settings = [word for key, value in SHORT.items() for word in ("--set", f"{key}={json.dumps(value)}")]
    subprocess.run([command, "run", scenario.path, *settings, "--quiet", "--out", out, *more], check=True)


def test_a_flight_has_the_bytes_of_the_command(fig1, command, tmp_path):
    run(command, fig1, tmp_path / "command", "--seed", "7", "--set", "controller.k1=5.0")
    flight = fig1.fly(seed=7, set=SHORT | {"controller.k1": 5.0})
    assert flight.save(tmp_path / "module").read_bytes() == (tmp_path / "command" / "run.mcap").read_bytes()
    ours = json.loads((tmp_path / "module" / "summary.json").read_text())
    theirs = json.loads((tmp_path / "command" / "summary.json").read_text())
    assert ours["metrics"] == theirs["metrics"]
    assert ours["phases"] == theirs["phases"]


def test_ctrl_c_ends_a_flight(fig1):
    with ctrl_c(after=0.5):
        fig1.fly(set={"duration": 3000.0}, topics=["vehicle/truth"])
    # And the next one flies.
    assert fig1.fly(set=SHORT).summary.outcome == "completed"


def test_nobody_writes_into_a_flight(fig1, tmp_path):
    flight = fig1.fly(set=SHORT)
    truth = flight["vehicle/truth"]
    with pytest.raises(ValueError, match="read-only"):
        truth["position_world"][:] = 77.0
    with pytest.raises(ValueError, match="read-only"):
        flight["control/errors"]["tick"][0] = 9
    copy = truth["position_world"].copy()
    copy[:] = 77.0
    flight.save(tmp_path)
    assert gerono.Log(tmp_path).scenario is not None


def test_a_scenario_of_any_length_is_set():
    fig1 = (REPOSITORY / "scenarios" / "fig1.toml").read_text()
    comment = "# a long comment\n" * 10_000
    scenario = gerono.Scenario(REPOSITORY / "scenarios" / "fig1.toml", comment + fig1)
    assert scenario.fly(set=SHORT | {"controller.k1": 5.0}).summary.outcome == "completed"


def test_noise_depends_on_the_seed_alone():
    scenario = gerono.Scenario(REPOSITORY / "scenarios" / "fig3_6.toml")
    flights = [scenario.fly(seed=seed, set=SHORT, topics=["mocap/pose"]) for seed in (1, 1, 2)]
    poses = [flight["mocap/pose"]["position_world"] for flight in flights]
    assert np.array_equal(poses[0], poses[1])
    assert not np.array_equal(poses[0], poses[2])


def test_samples_are_views_of_one_memory(fig1):
    flight = fig1.fly(set=SHORT)
    errors = flight["control/errors"]
    assert errors["z1"].shape == (2001, 3)
    assert np.shares_memory(errors, flight["control/errors"])
    assert flight["vehicle/truth"]["world_from_body"].shape == (2001, 3, 3)
    assert np.array_equal(errors["tick"], np.arange(2001))
    rotation = flight["vehicle/truth"]["world_from_body"][-1]
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    # z1 is what state and reference say, so that frames and rows are where they belong.
    distance = flight["vehicle/state"]["position_world"] - flight["path/reference"]["position_world"]
    assert np.array_equal(distance, errors["z1"])


def test_velocity_is_the_derivative_of_position(fig1):
    truth = fig1.fly(set=SHORT)["vehicle/truth"]
    velocity = np.einsum("nij,nj->ni", truth["world_from_body"], truth["velocity_body"])
    difference = (truth["position_world"][2:] - truth["position_world"][:-2]) / 2e-3
    assert np.abs(velocity[1:-1] - difference).max() < 1e-3


def test_tables_have_a_column_for_each_element_named_as_in_exports(fig1):
    flight = fig1.fly(set=SHORT)
    pandas, polars = flight.to_pandas("control/errors"), flight.to_polars("control/errors")
    assert list(pandas.columns) == polars.columns
    assert np.array_equal(pandas["z1.1"].to_numpy(), flight["control/errors"]["z1"][:, 1])
    assert pandas["time"].iloc[-1] == 2.0
    assert "world_from_body.2" in flight.to_pandas("vehicle/truth").columns


def test_a_topic_without_samples_is_an_empty_table(fig1):
    flight = fig1.fly(set=SHORT, topics=[])
    for topic in ("control/telemetry", "control/errors", "vehicle/truth"):
        columns = list(flight.to_pandas(topic).columns)
        assert columns == flight.to_polars(topic).columns
        assert len(flight.to_pandas(topic)) == len(flight.to_xarray(topic)["time"]) == 0
    assert "world_from_body.8" in columns


def test_topics_that_were_not_recorded_are_not_there(fig1, tmp_path):
    flight = fig1.fly(set=SHORT, topics=["control/errors"])
    assert flight.topics == ["control/errors"]
    with pytest.raises(ValueError, match="not all topics"):
        flight.save(tmp_path)
    with pytest.raises(KeyError, match="control/error"):
        flight["control/error"]


def test_a_wrong_scenario_says_where_and_what_to_do(fig1, tmp_path):
    with pytest.raises(gerono.ScenarioError, match=r"did you mean `k1`\?"):
        fig1.fly(set={"controller.k11": 3.0})
    with pytest.raises(gerono.ScenarioError, match="cannot"):
        gerono.Scenario(tmp_path / "missing.toml")
    with pytest.raises(gerono.ScenarioError):
        gerono.Scenario(tmp_path / "text.toml", text="duration = 'long'")


@pytest.mark.parametrize("wrong", ["duration=1.0", b"duration=1.0", 1.0, [("duration", 1.0)]])
def test_settings_are_a_mapping(fig1, wrong):
    for use in (fig1.fly, fig1.start, fig1.values):
        with pytest.raises(TypeError, match=r"settings are a mapping, such as \{'duration': 1\.0\}"):
            use(set=wrong)


def test_any_text_is_set(fig1):
    text = "🚁 \U0001d4d7 é \"quoted\" \\ \x00\x01\b\t\n\x1f\x7f\x80\u2028"
    assert fig1.values(set={"description": text})["description"] == text
    with pytest.raises(ValueError, match="half of a surrogate pair"):
        fig1.values(set={"description": "\ud83d"})


def test_scenarios_are_pickled_and_copied(fig1, tmp_path):
    changed = gerono.Scenario(fig1.path, fig1.text.replace("k1 = 4.0", "k1 = 4.5"))
    for make in (lambda scenario: pickle.loads(pickle.dumps(scenario)), copy.copy, copy.deepcopy):
        made = make(changed)
        assert (made.path, made.text) == (changed.path, changed.text)
        assert made.values()["controller"]["k1"] == 4.5
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(operator.methodcaller("values"), [changed]) == [changed.values()]


def test_flights_are_saved_and_logs_are_pickled(fig1, tmp_path):
    flight = fig1.fly(set=SHORT)
    with pytest.raises(TypeError, match=r"save it with `Flight\.save`, and open it with `gerono\.Log`"):
        pickle.dumps(flight)
    assert copy.copy(flight) is copy.deepcopy(flight) is flight
    log = pickle.loads(pickle.dumps(gerono.Log(flight.save(tmp_path))))
    assert np.array_equal(log["control/errors"], flight["control/errors"])


def test_flights_release_the_lock(fig1):
    """Another thread counts while a flight is flown: it could not if the flight held the lock."""
    counted, flown = [0], threading.Event()

    def count():
        while not flown.is_set():
            counted[0] += 1

    counter = threading.Thread(target=count)
    counter.start()
    before = counted[0]
    fig1.fly(topics=[])
    during = counted[0] - before
    flown.set()
    counter.join()
    assert during > 1000


def test_a_log_is_what_the_flight_was(fig1, tmp_path):
    flight = fig1.fly(set=SHORT)
    path = flight.save(tmp_path)
    for meant in (path, tmp_path):
        log = gerono.Log(meant)
        for topic in flight.topics:
            assert np.array_equal(log[topic], flight[topic])
        assert log.damage is None
        assert log.scenario.controller.k1 == 4.0
        assert log.summary.metrics.rmse == flight.summary.metrics.rmse


def test_a_log_in_several_files_is_one(fig1, command, tmp_path):
    run(command, fig1, tmp_path / "whole")
    run(command, fig1, tmp_path / "split", "--set", "record.split.after_seconds=1")
    assert (tmp_path / "split" / "run.1.mcap").exists()
    whole, split = (gerono.Log(tmp_path / name) for name in ("whole", "split"))
    assert np.array_equal(whole["control/errors"], split["control/errors"])


def test_of_a_log_that_is_cut_off_the_rest_is_read(fig1, tmp_path):
    whole = fig1.fly(set=SHORT)
    path = whole.save(tmp_path)
    content = path.read_bytes()
    half = len(content) // 2
    # Overwritten in the middle, cut off.
    for damaged in (content[:half] + bytes(100) + content[half + 100 :], content[:half]):
        path.write_bytes(damaged)
        log = gerono.Log(path)
        assert log.damage
        assert repr(log) == f"<Log {path}: {log.damage}>"
        for topic in ("control/errors", "vehicle/truth"):
            assert len(log[topic]) > 0
            assert log.damage == gerono.Log(path).damage
    log = gerono.Log(path)
    errors = log["control/errors"]
    assert 0 < len(errors) < 2001
    assert np.array_equal(errors, whole["control/errors"][: len(errors)])
    assert log.damage
    with pytest.raises(OSError, match="absent"):
        gerono.Log(tmp_path / "absent.mcap")
