"""Observations and commands of a policy, for the environments of `gerono.gym` and for flights without Gymnasium."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gerono import _gerono
from gerono._samples import PHASES
from gerono.controller import FAILSAFE, Controller, Now
from gerono.scenario import Observation, Scenario, Settings

Observe = Callable[[Observation], np.ndarray]
Scale = tuple[float, float, float]

# The largest action if the scenario states no limits of its actuators: multiples of the weight, N m, rad/s.
_THRUST_IN_WEIGHTS, _TORQUE, _RATE = 3.0, 0.1, 10.0

#: Values at which the parts of an observation are 1: position error, m; velocity error, m/s; angular velocity, rad/s.
SCALE: Scale = (2.0, 5.0, 20.0)


class Policy(Controller):
    """A policy as the controller of a flight: `act(observation)` returns an action.

    `scenario`, `set`, `observe`, `observation_space` and `scale` are those of the environment in which it has learned, whose
    observations and commands are computed by the same functions. Without a known state, and while the flight is disarmed,
    the motors stop; while it is armed they idle; from take-off to landing the policy flies.
    """

    def __init__(
        self,
        scenario: Scenario | str | os.PathLike[str],
        act: Callable[[np.ndarray], Any],
        set: Settings = None,  # noqa: A002
        *,
        observe: Observe | None = None,
        observation_space: Any = None,
        scale: Scale = SCALE,
    ) -> None:
        values = scenario_of(scenario).values(set)
        has_rates = bool(values["controller"].get("rates"))
        largest, scale = largest_action(values, has_rates), checked_scale(scale)
        dtype = np.float64 if observation_space is None else observation_space.dtype

        # A function, because a controller saves its arrays and refuses other objects.
        def command_of(state: Any, reference: Any) -> np.ndarray:
            if observe is None:
                seen = _gerono.observe_samples(state.tobytes(), reference.tobytes(), scale)
            else:
                seen = np.asarray(observe(Observation(state, reference))).astype(dtype, copy=False)
            return commands(checked_actions(act(seen), (4,)), largest)

        self._command_of = command_of
        self._turn = "rates_body" if has_rates else "torque_body"

    def step(self, now: Now, state: Any, reference: Any, command: Any, errors: Any) -> None:
        """Command what the policy does, as the phase of the flight permits."""
        if state is None or reference is None or reference["phase"] == PHASES["DISARMED"]:
            command["mode"] = FAILSAFE
        elif reference["phase"] != PHASES["ARMED"]:
            thrust, *turn = self._command_of(state, reference)
            command["thrust"], command[self._turn] = thrust, turn
            errors["z1"] = state["position_world"] - reference["position_world"]


def scenario_of(scenario: Scenario | str | os.PathLike[str]) -> Scenario:
    """Return a scenario, or that of a file."""
    return scenario if isinstance(scenario, Scenario) else Scenario(scenario)


def checked_scale(scale: Scale) -> Scale:
    """Return the scale of observations; refuse one that is not above zero."""
    if len(scale) != 3 or not all(0.0 < value < np.inf for value in scale):
        raise ValueError(f"`scale` is a distance, m, a speed, m/s, and a rate, rad/s, all above 0, not {scale}")
    return (float(scale[0]), float(scale[1]), float(scale[2]))


def checked_actions(actions: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return actions as numbers; refuse another shape, and what is not finite."""
    numbers = np.array(actions, dtype=np.float64)
    if numbers.shape != shape:
        raise ValueError(f"an action has the shape {shape}, not {numbers.shape}")
    if not np.isfinite(numbers).all():
        rows = numbers.reshape(-1, 4)
        index = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
        of = f" of environment {index}" if len(shape) > 1 else ""
        raise ValueError(f"the action{of} is not finite: {rows[index].tolist()}")
    return numbers


def commands(actions: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """Return thrust, N, and torque, N m, or body rates, rad/s, of actions."""
    limited: np.ndarray = np.clip(actions, -1.0, 1.0)
    limited[..., 0] = (limited[..., 0] + 1.0) / 2.0
    limited *= largest
    return limited


def largest_action(values: Mapping[str, Any], has_rates: bool) -> np.ndarray:
    """Return the command of an action of ones."""
    actuators = values["vehicle"].get("actuators") or {}
    thrust = actuators.get("thrust_max", _THRUST_IN_WEIGHTS * 9.81 * values["vehicle"]["mass"])
    turn = actuators.get("rate_max", (_RATE,) * 3) if has_rates else (_TORQUE,) * 3
    return np.array((thrust, *turn))
