"""The environment keeps the rules of Gymnasium, and its seeds count."""

import numpy as np
import pytest
from conftest import REPOSITORY
from gymnasium.utils.env_checker import check_env

import gerono
import gerono.gym


@pytest.mark.parametrize("name", ["fig1", "fig3_6"])
@pytest.mark.filterwarnings("ignore:.*A Box observation space m.*imum value is -?infinity")
@pytest.mark.filterwarnings("error")
def test_gymnasium_finds_nothing_wrong(name):
    check_env(gerono.gym.Env(gerono.Scenario(REPOSITORY / "scenarios" / f"{name}.toml")), skip_render_check=True)


def test_only_a_scenario_makes_an_environment():
    with pytest.raises(TypeError, match=r"made of a gerono\.Scenario, not of a str"):
        gerono.gym.Env("fig1.toml")


def test_seeds_count():
    environment = gerono.gym.Env(gerono.Scenario(REPOSITORY / "scenarios" / "fig3_6.toml"))

    def fly(seed):
        environment.reset(seed=seed)
        return np.array([environment.step(np.zeros(4))[0] for _ in range(20)])

    assert np.array_equal(fly(3), fly(3))
    assert not np.array_equal(fly(3), fly(4))


def test_an_episode_ends_with_the_flight_or_the_loss(fig1):
    environment = gerono.gym.Env(fig1, set={"duration": 3.0, "vehicle.change": []})
    environment.reset(seed=1)
    hovers = np.array([2 * 1.962 / environment.largest[0] - 1, 0.0, 0.0, 0.0])
    while True:
        *_, terminated, truncated, info = environment.step(hovers)
        if terminated or truncated:
            break
    assert (terminated, truncated) == (False, True)
    assert info["time"] >= 3.0
    environment.reset(seed=1)
    turns = hovers + np.array([0.0, 1.0, 0.0, 0.0])
    while True:
        *_, terminated, truncated, info = environment.step(turns)
        if terminated or truncated:
            break
    assert terminated
    assert info["lost"]


def test_settings_without_an_effect_are_refused(fig1):
    with pytest.raises(gerono.ScenarioError, match="has no effect"):
        gerono.gym.Env(fig1, set={"controller.k1": 5.0})
    with pytest.raises(ValueError, match=r"`reset\(seed=…\)` seeds"):
        gerono.gym.Env(fig1, set={"seed": 5})
    environment = gerono.gym.Env(fig1)
    with pytest.raises(ValueError, match="`seed` in the settings has no effect"):
        environment.reset(options={"set": {"seed": 5}})
