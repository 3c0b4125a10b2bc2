"""The environments keep the rules of Gymnasium, and a vector of them returns what single ones do, to the bit."""

import warnings

import gymnasium
import numpy as np
import pytest
from conftest import REPOSITORY
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import gerono
import gerono.gym

SCENARIOS = REPOSITORY / "scenarios"
HOVER = REPOSITORY / "examples" / "learning" / "hover.toml"


def beside(generator):
    return {"vehicle.initial.position": generator.uniform(-0.7, 0.7, 3) - (0.0, 0.0, 1.0)}


@pytest.mark.parametrize("path", [SCENARIOS / "fig1.toml", SCENARIOS / "fig3_6.toml", HOVER], ids=lambda path: path.stem)
def test_gymnasium_finds_nothing_wrong(path):
    with warnings.catch_warnings(action="error"):
        check_env(gerono.gym.Env(gerono.Scenario(path)), skip_render_check=True)
        check_env(gerono.gym.Env(path, time_limit=0.5, vary=None), skip_render_check=True)


def test_the_file_of_a_scenario_makes_an_environment():
    paths = [str(HOVER), HOVER, gerono.Scenario(HOVER)]
    seen = [gerono.gym.Env(path).reset(seed=1)[0] for path in paths]
    assert np.array_equal(seen[0], seen[1])
    assert np.array_equal(seen[0], seen[2])


def test_seeds_count():
    environment = gerono.gym.Env(SCENARIOS / "fig3_6.toml")

    def fly(seed):
        environment.reset(seed=seed)
        return np.array([environment.step(np.zeros(4))[0] for _ in range(20)])

    assert np.array_equal(fly(3), fly(3))
    assert not np.array_equal(fly(3), fly(4))


def rollout(environments, steps, seed=5):
    """Return all that an agent gets, by actions that lose some vehicles and keep others."""
    generator = np.random.default_rng(1)
    seen = [environments.reset(seed=seed)]
    biases = np.linspace(0.0, 1.0, environments.num_envs)[:, np.newaxis] * (0.1, 0.6, -0.4, 0.2)
    for _ in range(steps):
        noise = 0.3 * generator.standard_normal((environments.num_envs, 4))
        seen.append(environments.step((noise + biases).clip(-1.0, 1.0)))
    return seen


def assert_same(one, other):
    """Both are equal to the bit, types included."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for pair in zip(one, other, strict=True):
            assert_same(*pair)
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        if one.dtype == object:
            assert_same(one.tolist(), other.tolist())
        else:
            assert one.tobytes() == other.tobytes()
    else:
        assert one == other


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_vector_is_equal_to_single_environments_of_gymnasium(mode):
    given = {"vary": beside, "time_limit": 1.2}
    theirs = SyncVectorEnv([lambda: gerono.gym.Env(HOVER, **given)] * 6, autoreset_mode=mode)
    expected = rollout(theirs, 150)
    for threads in (1, 8):
        ours = gerono.gym.VectorEnv(HOVER, 6, threads=threads, autoreset_mode=mode, **given)
        assert ours.metadata == theirs.metadata
        assert_same([ours.observation_space, ours.action_space], [theirs.observation_space, theirs.action_space])
        assert_same(rollout(ours, 150), expected)
    ended = [(np.any(terminations), np.any(truncations)) for _, _, terminations, truncations, _ in expected[1:]]
    assert (True, False) in ended
    assert any(truncated for _, truncated in ended)


def test_own_observations_and_rewards_are_those_of_single_environments():
    given = {
        "observe": lambda observation: observation.state["velocity_body"] / 10.0,
        "reward": lambda observation, action: float(observation.state["position_world"][2] + action[0]),
        "observation_space": gymnasium.spaces.Box(-5.0, 5.0, (3,)),
    }
    theirs = SyncVectorEnv([lambda: gerono.gym.Env(HOVER, **given)] * 3)
    assert_same(rollout(gerono.gym.VectorEnv(HOVER, 3, threads=2, **given), 30), rollout(theirs, 30))
    with pytest.raises(ValueError, match=r"`observation_space` has the shape \(4,\), an observation \(3,\)"):
        gerono.gym.Env(HOVER, **given | {"observation_space": gymnasium.spaces.Box(-5.0, 5.0, (4,))})


def test_only_the_environments_of_a_mask_begin_again():
    environments = gerono.gym.VectorEnv(HOVER, 2, autoreset_mode="Disabled", time_limit=0.1)
    environments.reset(seed=1)
    while not environments.step(np.zeros((2, 4)))[3].any():
        pass
    with pytest.raises(RuntimeError, match="episode of environment 0 has ended"):
        environments.step(np.zeros((2, 4)))
    environments.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(RuntimeError, match="episode of environment 1 has ended"):
        environments.step(np.zeros((2, 4)))


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_bad_actions_are_refused(number):
    environments = gerono.gym.VectorEnv(HOVER, 3)
    environments.reset(seed=1)
    bad = np.zeros((3, 4))
    bad[2, 1] = number
    with pytest.raises(ValueError, match="action of environment 2 is not finite"):
        environments.step(bad)
    with pytest.raises(ValueError, match=r"has the shape \(3, 4\), not \(2, 4\)"):
        environments.step(np.zeros((2, 4)))
    environment = gerono.gym.Env(HOVER)
    environment.reset(seed=1)
    with pytest.raises(ValueError, match="the action is not finite"):
        environment.step(bad[2])
    with pytest.raises(ValueError, match=r"has the shape \(4,\), not \(3,\)"):
        environment.step(np.zeros(3))
    # A refused action has flown nothing.
    assert environment.simulation.time == 0.0


def test_closed_or_ended_environments_are_not_flown():
    environments = gerono.gym.VectorEnv(HOVER, 2)
    with pytest.raises(RuntimeError, match="none has begun"):
        environments.step(np.zeros((2, 4)))
    environments.reset(seed=1)
    environments.close()
    environments.close()
    for refused in (lambda: environments.step(np.zeros((2, 4))), environments.reset):
        with pytest.raises(RuntimeError, match="the environments are closed"):
            refused()
    with pytest.raises(RuntimeError, match="none has begun"):
        gerono.gym.Env(HOVER).step(np.zeros(4))


def test_an_episode_ends_with_the_flight_the_time_limit_or_the_loss(fig1):
    hovers = np.array([2 * 1.962 / gerono.gym.Env(fig1).largest[0] - 1, 0.0, 0.0, 0.0])

    def fly(action, **given):
        environment = gerono.gym.Env(fig1, set={"duration": 3.0, "vehicle.change": []}, **given)
        environment.reset(seed=1)
        while True:
            *_, terminated, truncated, info = environment.step(action)
            if terminated or truncated:
                return terminated, truncated, info

    terminated, truncated, info = fly(hovers)
    assert (terminated, truncated) == (False, True)
    assert info["time"] >= 3.0
    terminated, truncated, info = fly(hovers, time_limit=0.5)
    assert (terminated, truncated, info) == (False, True, {"time": 0.5})
    terminated, truncated, info = fly(hovers + np.array([0.0, 1.0, 0.0, 0.0]))
    assert (terminated, truncated) == (True, False)
    assert info["lost"]


def test_the_envelope_ends_the_episode_of_a_bad_policy():
    """However a policy acts, the episode is over within `after` and three periods of the first moment beyond a limit."""
    environment = gerono.gym.Env(HOVER, vary=beside)
    envelope = environment.scenario.values()["envelope"]
    lowest, highest = np.array(envelope["box"]["min"]), np.array(envelope["box"]["max"])
    generator = np.random.default_rng(1)
    reasons = set()
    for episode in range(30):
        environment.reset(seed=episode)
        constant, beyond_since, over = generator.uniform(-1.0, 1.0, 4) * (1.0, 0.3, 0.3, 1.0), None, False
        while not over:
            *_, terminated, truncated, info = environment.step(constant + 0.3 * generator.standard_normal(4))
            over = terminated or truncated
            truth = environment.simulation["vehicle/truth"]
            position, upright = truth["position_world"], truth["world_from_body"][2, 2]
            beyond = (position < lowest).any() or (position > highest).any() or upright < np.cos(envelope["tilt"]["max"])
            beyond_since = (beyond_since or info["time"]) if beyond else None
            assert over or beyond_since is None or info["time"] - beyond_since <= envelope["after"] + 0.061
        if terminated:
            reasons.add(info["lost"].rsplit(", at ", 1)[0])
            assert environment.simulation["rc/frame"]["failsafe"] == 1
            assert environment.simulation["rc/frame"]["thrust"] == 0.0
    assert any("envelope.box" in reason for reason in reasons), reasons
    assert any("envelope.tilt" in reason for reason in reasons), reasons
    assert all("killed: `envelope." in reason for reason in reasons), reasons


def test_settings_without_an_effect_are_refused(fig1):
    with pytest.raises(gerono.ScenarioError, match="has no effect"):
        gerono.gym.Env(fig1, set={"controller.k1": 5.0})
    with pytest.raises(ValueError, match=r"`reset\(seed=…\)` seeds"):
        gerono.gym.Env(fig1, set={"seed": 5})
    environment = gerono.gym.Env(fig1)
    with pytest.raises(ValueError, match="`seed` in the settings has no effect"):
        environment.reset(options={"set": {"seed": 5}})
