"""A scenario as an environment of Gymnasium; needs `pip install gerono[gym]`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np

from gerono.scenario import Observation, Scenario, Settings, Simulation, refuse_seed, settings_of

# The largest action if the scenario states no limits of its actuators: multiples of the weight, N m, rad/s.
_THRUST_IN_WEIGHTS, _TORQUE, _RATE = 3.0, 0.1, 10.0


def observe_errors(observation: Observation) -> np.ndarray:
    """Return 18 numbers: position error z1, m, and velocity error, m/s, in {I}; R by rows; Ω in {B}, rad/s.

    The velocity error is relative to the velocity of the reference along the path.
    """
    state, reference = observation.state, observation.reference
    if state is None or reference is None:
        return np.zeros(18)
    rotation = state["world_from_body"]
    reference_velocity = reference["derivative1_world"] * reference["gamma_dot"]
    return np.concatenate(
        (
            state["position_world"] - reference["position_world"],
            rotation @ state["velocity_body"] - reference_velocity,
            rotation.ravel(),
            state["angular_velocity_body"],
        )
    )


def reward_distance(observation: Observation, action: np.ndarray) -> float:
    """Return minus the distance from the path, m."""
    if observation.state is None or observation.reference is None:
        return 0.0
    return -float(np.linalg.norm(observation.state["position_world"] - observation.reference["position_world"]))


class Env(gymnasium.Env[np.ndarray, np.ndarray]):
    """A flight of a scenario; a step is one period of the controller.

    An action is four numbers from −1 to 1: the thrust from zero to the largest, and the torque or, if the scenario has
    `[controller.rates]`, the body rates; `largest` has the values at 1, N and N m or rad/s. The episode terminates when
    the vehicle is lost, and is truncated at the end of the flight. `reset(seed)` seeds the flight; without a seed each
    episode draws another one.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scenario: Scenario,
        observe: Callable[[Observation], np.ndarray] = observe_errors,
        reward: Callable[[Observation, np.ndarray], float] = reward_distance,
        set: Settings = None,  # noqa: A002
    ) -> None:
        if not isinstance(scenario, Scenario):
            raise TypeError(f"an environment is made of a gerono.Scenario, not of a {type(scenario).__name__}")
        self._scenario, self._observe, self._reward = scenario, observe, reward
        self._set = settings_of(set)
        refuse_seed(self._set, "`reset(seed=…)` seeds the flights of an environment")
        values = scenario.values(self._set)
        self._has_rates = bool(values["controller"].get("rates"))
        self.largest = _largest(values, self._has_rates)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float64)
        self._simulation: Simulation = scenario.start(set=self._set)
        shape = np.shape(observe(self._simulation.observe()))
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float64)

    @property
    def simulation(self) -> Simulation:
        """The flight of the episode."""
        return self._simulation

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a flight; `options={"set": …}` changes further keys of its scenario."""
        super().reset(seed=seed)
        flight_seed = int(self.np_random.integers(1 << 62)) if seed is None else seed
        settings = self._set + settings_of((options or {}).get("set"))
        self._simulation = self._scenario.start(flight_seed, settings)
        return self._observe(self._simulation.observe()), {"seed": flight_seed}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly one period of the controller."""
        commanded = "rates_body" if self._has_rates else "torque_body"
        turn = self.largest[1:] * action[1:]
        samples = self._simulation.step(self.largest[0] * (action[0] + 1.0) / 2.0, **{commanded: turn})
        lost = self._simulation.lost
        info = {"time": self._simulation.time} | ({"lost": lost} if lost else {})
        observation = self._observe(samples)
        return observation, self._reward(samples, action), lost is not None, self._simulation.done, info


def _largest(values: Mapping[str, Any], has_rates: bool) -> np.ndarray:
    actuators = values["vehicle"].get("actuators") or {}
    thrust = actuators.get("thrust_max", _THRUST_IN_WEIGHTS * 9.81 * values["vehicle"]["mass"])
    turn = actuators.get("rate_max", (_RATE,) * 3) if has_rates else (_TORQUE,) * 3
    return np.array((thrust, *turn))
