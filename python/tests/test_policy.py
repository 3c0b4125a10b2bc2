"""A saved policy flies as a process of its own, by the observations and the commands of its environment."""

import json
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from conftest import REPOSITORY

import gerono
import gerono.gym

FOLDER = REPOSITORY / "examples" / "learning"
BESIDE = {"vehicle.initial.position": [0.4, -0.3, -0.8]}


@pytest.fixture
def policy(tmp_path):
    """Write a linear policy, and return its file: proportional and derivative, of the limits in hover.toml."""

    def write(bias=(0.0, 0.0, 0.0, 0.0)):
        path = tmp_path / "policy.npz"
        weight = np.zeros((4, 18))
        # Accelerations in multiples of the gravity, per position error and per velocity error as an observation has them.
        position, velocity = 4.0 * 2.0 / 9.81, 4.0 * 5.0 / 9.81
        weight[0, [2, 5]] = position, velocity
        weight[1, [1, 4, 11]] = np.array((-position, -velocity, 1.0)) * 8.0 / 6.0
        weight[2, [0, 3, 8]] = np.array((position, velocity, -1.0)) * 8.0 / 6.0
        weight[3, 9] = -2.0 / 3.0
        np.savez(path, weight0=weight, bias0=np.array(bias))
        return path

    return write


@pytest.fixture
def fly(command, tmp_path):
    """Fly a scenario with a policy as the controller's process; return exit code, log and summary."""

    def run(scenario, path, *more):
        program = f'programs.controller=["{sys.executable}", "{FOLDER / "fly_policy.py"}", "{path}"]'
        out = tmp_path / "flight"
        flown = subprocess.run([command, "run", FOLDER / scenario, "--set", program, "--quiet", "--out", out, *more])
        return flown.returncode, gerono.Log(out), json.loads((out / "summary.json").read_text())

    return run


def saved(path, monkeypatch):
    """Return the policy as the example reads it."""
    monkeypatch.syspath_prepend(FOLDER)
    import fly_policy

    return fly_policy.load(path)


def test_the_process_commands_what_the_environment_flies(policy, fly, monkeypatch):
    path = policy()
    environment = gerono.gym.Env(FOLDER / "hover.toml", set=BESIDE)
    act, commands, is_over = saved(path, monkeypatch), [], False
    seen, _ = environment.reset(seed=1)
    while not is_over:
        seen, _, terminated, is_over, _ = environment.step(act(seen))
        assert not terminated
        commands.append(environment.simulation["control/command"].tobytes())
    code, log, _ = fly("hover.toml", path, "--set", f"vehicle.initial.position={BESIDE['vehicle.initial.position']}")
    assert code == 0
    flown = log["control/command"]
    assert len(flown) == 301
    assert np.ptp(flown["rates_body"][:, 1]) > 1.0
    assert [command.tobytes() for command in flown] == commands


def test_an_observation_of_ones_own_is_that_of_the_environment_too():
    def observe(inputs):
        return inputs.state["velocity_body"] / 10.0

    space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
    own = {"observe": observe, "observation_space": space}

    def act(seen):
        assert seen.dtype == np.float32
        return [0.0, *seen]

    scenario = gerono.Scenario(FOLDER / "hover.toml")
    flight = scenario.fly(controller=gerono.Policy(scenario, act, **own), set=BESIDE, seed=1)
    environment = gerono.gym.Env(scenario, set=BESIDE, **own)
    seen, _ = environment.reset(seed=1)
    for command in flight["control/command"][:20]:
        seen, *_ = environment.step(np.array(act(seen)))
        assert environment.simulation["control/command"].tobytes() == command.tobytes()


@pytest.mark.parametrize("host", ["lockstep", "realtime"])
def test_a_policy_flies_from_the_ground_to_the_ground(policy, fly, host):
    code, log, summary = fly("fly_policy.toml", policy(), "--host", host)
    assert (code, summary["outcome"]) == (0, "completed")
    references, commands = log["path/reference"], log["control/command"]
    phases = references["phase"]
    assert [phases[0], *phases[1:][np.diff(phases) != 0]] == [0, 1, 2, 3, 4, 0]
    assert summary["steady"]["rmse"] < 0.01
    if host == "lockstep":
        assert np.array_equal(commands["mode"] == gerono.FAILSAFE, phases == 0)
        assert not commands["thrust"][phases == 1].any()


def test_a_policy_that_turns_over_is_stopped_by_the_transmitter(policy, fly):
    code, log, summary = fly("hover.toml", policy(bias=(0.0, 3.0, 0.0, 0.0)))
    assert (code, summary["killed"]["by"]) == (9, "`envelope.tilt` was exceeded")
    frames = log["rc/frame"]
    is_killed = frames["action"] == 3
    assert is_killed.any()
    assert frames["failsafe"][is_killed].all()


@pytest.mark.parametrize("action", [np.full(4, np.nan), np.zeros(3)])
def test_what_is_no_action_is_refused_as_by_the_environment(action):
    scenario = gerono.Scenario(FOLDER / "hover.toml")
    with pytest.raises(ValueError, match=r"the action is not finite|has the shape \(4,\), not \(3,\)"):
        scenario.fly(controller=gerono.Policy(scenario, lambda seen: action))
