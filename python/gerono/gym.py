"""A scenario as an environment of Gymnasium, one flight or many side by side; needs `pip install gerono[gym]`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from gerono import _gerono
from gerono.policy import SCALE, Observe, Scale, checked_actions, checked_scale, commands, largest_action, scenario_of
from gerono.scenario import Observation, Scenario, Settings, Simulation, refuse_seed, settings_of

# Ticks of a step that are worth a thread: a tick takes 1 µs or more, the start of a thread some tens of them.
_TICKS_OF_A_THREAD = 200

Reward = Callable[[Observation, np.ndarray], float]
Vary = Callable[[np.random.Generator], Settings]


class _Flights:
    """Flights of a scenario side by side, and their episodes: one for `Env`, many for `VectorEnv`."""

    def __init__(
        self,
        number: int,
        scenario: Scenario | str | os.PathLike[str],
        *,
        observe: Observe | None,
        reward: Reward | None,
        observation_space: gymnasium.spaces.Box | None,
        set: Settings,  # noqa: A002
        vary: Vary | None,
        time_limit: float | None,
        scale: Scale,
        threads: int | None,
    ) -> None:
        self.scenario = scenario_of(scenario)
        if time_limit is not None and not time_limit > 0.0:
            raise ValueError(f"`time_limit` is a time above 0 s, not {time_limit}")
        self.observe, self.reward, self.vary, self.time_limit = observe, reward, vary, time_limit
        self.scale = checked_scale(scale)
        self.settings = settings_of(set)
        refuse_seed(self.settings, "`reset(seed=…)` seeds the flights of an environment")
        values = self.scenario.values(self.settings)
        self.has_rates = bool(values["controller"].get("rates"))
        self.threads = threads or _worthwhile_threads(values["schedule"], number)
        self.largest = largest_action(values, self.has_rates)
        self.prepared = self.scenario._scenario._prepare(self.settings)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float64)
        started = _gerono.start_side_by_side([self.prepared], [0], 1)[0]
        self.observation_space: gymnasium.spaces.Box = gymnasium.spaces.Box(-1.0, 1.0, (18,), np.float64)
        if observe is not None:
            shape = np.shape(observe(Simulation(started, self.has_rates).observe()))
            self.observation_space = observation_space or gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float64)
        if self.observation_space.shape != (shape := np.shape(self._view([started])[0][0])):
            raise ValueError(f"`observation_space` has the shape {self.observation_space.shape}, an observation {shape}")
        self.simulations = [started] * number
        self.has_ended: np.ndarray = np.ones(number, dtype=bool)

    def begin(self, index: int, seed: int, generator: np.random.Generator, options: Mapping[str, Any] | None) -> None:
        """Begin a flight of the environment `index`."""
        self.begin_all([index], [seed], [generator], options)

    def begin_all(
        self,
        indices: Sequence[int],
        seeds: list[int],
        generators: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None,
    ) -> None:
        """Begin flights with these seeds; the generators are those of their environments."""
        prepared = [self._prepared(generator, options) for generator in generators]
        started = _gerono.start_side_by_side(prepared, seeds, self.threads)
        for index, simulation in zip(indices, started, strict=True):
            self.simulations[index] = simulation
            self.has_ended[index] = False

    def _prepared(
        self, generator: np.random.Generator, options: Mapping[str, Any] | None
    ) -> _gerono.PreparedScenario:
        further = settings_of(self.vary(generator)) if self.vary else []
        further += settings_of((options or {}).get("set"))
        if not further:
            return self.prepared
        refuse_seed(further, "`reset(seed=…)` seeds the flights of an environment")
        return self.scenario._scenario._prepare(self.settings + further)

    def fly(self, actions: np.ndarray, flies: np.ndarray) -> None:
        """Fly one period of the controller in the environments that fly."""
        _gerono.step_side_by_side(self.simulations, commands(actions, self.largest), flies, self.has_rates, self.threads)

    def view(
        self, actions: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return observations, rewards, times, terminations and truncations."""
        observations, rewards, times, done, lost = self._view(self.simulations)
        if self.reward is not None and actions is not None:
            seen = [Simulation(flown, self.has_rates).observe() for flown in self.simulations]
            rewards = np.array([self.reward(*pair) for pair in zip(seen, actions, strict=True)], dtype=np.float64)
            if not np.isfinite(rewards).all():
                wrong = int(np.argmin(np.isfinite(rewards)))
                raise ValueError(f"`reward` returned no finite number for environment {wrong}: does it end with `return`?")
        if self.time_limit is not None:
            # Half of a microsecond: a time is a multiple of the period, rounded.
            done |= times >= self.time_limit - 0.5e-6
        return observations, rewards, times, lost, done & ~lost

    def _view(
        self, simulations: list[_gerono.Simulation]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        observations, *others = _gerono.view_side_by_side(simulations, self.scale)
        if self.observe is not None:
            seen = [self.observe(Simulation(flown, self.has_rates).observe()) for flown in simulations]
            observations = np.stack(seen).astype(self.observation_space.dtype, copy=False)
        return observations, *others  # type: ignore[return-value]


class Env(gymnasium.Env[np.ndarray, np.ndarray]):
    """A flight of a scenario, or of the file of one; a step is one period of the controller.

    An action is four numbers from −1 to 1, and is cut to them: the thrust from zero to the largest, and the torque or, if
    the scenario has `[controller.rates]`, the body rates; `largest` has the values at 1, N and N m or rad/s.

    An observation is 18 numbers from −1 to 1: position error and velocity error in {I}, R by rows, Ω in {B}. `scale` are
    the distance, m, the speed, m/s, and the rate, rad/s, at which they are 1; beyond them they are cut. The velocity error is
    relative to the velocity of the reference along the path. The reward of a step is 1 on the path and falls to 0 at the
    distance in `scale`. `observe(observation)`, with `observation_space`, and `reward(observation, action)` replace them.

    The episode terminates when the vehicle is lost, which includes a kill by the scenario's envelope, and is truncated at
    `time_limit`, s, or at the end of the flight. `reset(seed)` seeds the flight; without a seed each episode draws another
    one. `vary(generator)` returns further settings of an episode, such as an initial position.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scenario: Scenario | str | os.PathLike[str],
        observe: Observe | None = None,
        reward: Reward | None = None,
        set: Settings = None,  # noqa: A002
        *,
        observation_space: gymnasium.spaces.Box | None = None,
        vary: Vary | None = None,
        time_limit: float | None = None,
        scale: Scale = SCALE,
    ) -> None:
        self._flights = _Flights(
            1,
            scenario,
            observe=observe,
            reward=reward,
            observation_space=observation_space,
            set=set,
            vary=vary,
            time_limit=time_limit,
            scale=scale,
            threads=1,
        )
        self.largest, self.scale = self._flights.largest, self._flights.scale
        self.action_space, self.observation_space = self._flights.action_space, self._flights.observation_space

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        return self._flights.scenario

    @property
    def simulation(self) -> Simulation:
        """The flight of the episode."""
        return Simulation(self._flights.simulations[0], self._flights.has_rates)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a flight; `options={"set": …}` changes further keys of its scenario."""
        super().reset(seed=seed)
        flight_seed = _seed_of_flight(seed, self.np_random)
        self._flights.begin(0, flight_seed, self.np_random, options)
        return self._flights.view()[0][0], {"seed": flight_seed}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly one period of the controller."""
        flights = self._flights
        checked = checked_actions(action, (4,))[np.newaxis]
        if flights.has_ended[0]:
            raise RuntimeError("the episode has ended, or none has begun: `reset` the environment")
        flights.fly(checked, np.ones(1, dtype=bool))
        observations, rewards, times, terminations, truncations = flights.view(checked)
        flights.has_ended = terminations | truncations
        info: dict[str, Any] = {"time": float(times[0])}
        if terminations[0]:
            info["lost"] = flights.simulations[0].lost
        return observations[0], float(rewards[0]), bool(terminations[0]), bool(truncations[0]), info


class VectorEnv(gymnasium.vector.VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many flights of a scenario side by side, on `threads` and without Python's lock [default: one for each
    core, fewer where a step is short].

    Actions, observations, rewards and arguments are those of `Env`, and every number is that of as many single
    environments, whatever the number of threads. `metadata["autoreset_mode"]` states how an episode is followed by the next
    one, as in Gymnasium: in the next step, in the same one, or by `reset(options={"reset_mask": …})` alone. `reset(seed)`
    takes one seed for each environment, or an integer: environment i then has the seed `seed + i`.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scenario: Scenario | str | os.PathLike[str],
        num_envs: int,
        observe: Observe | None = None,
        reward: Reward | None = None,
        set: Settings = None,  # noqa: A002
        *,
        observation_space: gymnasium.spaces.Box | None = None,
        vary: Vary | None = None,
        time_limit: float | None = None,
        scale: Scale = SCALE,
        threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        if num_envs < 1 or (threads is not None and threads < 1):
            raise ValueError(f"`num_envs` and `threads` are 1 or more, not {num_envs} and {threads}")
        self._flights = _Flights(
            num_envs,
            scenario,
            observe=observe,
            reward=reward,
            observation_space=observation_space,
            set=set,
            vary=vary,
            time_limit=time_limit,
            scale=scale,
            threads=threads,
        )
        self.num_envs = num_envs
        self.largest, self.scale = self._flights.largest, self._flights.scale
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = type(self).metadata | {"autoreset_mode": self.autoreset_mode}
        self.single_action_space = self._flights.action_space
        self.single_observation_space = self._flights.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._generators: list[np.random.Generator | None] = [None] * num_envs

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        return self._flights.scenario

    @property
    def simulations(self) -> list[Simulation]:
        """The flights of the present episodes."""
        return [Simulation(flown, self._flights.has_rates) for flown in self._flights.simulations]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin flights in all environments, or in those of `options["reset_mask"]`; `options["set"]` is that of `Env`."""
        self._refuse_closed()
        number = self.num_envs
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + index for index in range(number)]
        else:
            seeds = list(seed)
        if len(seeds) != number:
            raise ValueError(f"one seed for each of the {number} environments, not {len(seeds)}")
        mask = (options or {}).get("reset_mask", np.ones(number, dtype=bool))
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (number,) or not mask.any():
            raise ValueError(f"`reset_mask` is an array of {number} bool, of which at least one is true")
        infos = self._begin(np.flatnonzero(mask).tolist(), seeds, options, {})
        return self._flights.view()[0], infos

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Fly one period of the controller in every environment."""
        self._refuse_closed()
        flights = self._flights
        checked = checked_actions(actions, (self.num_envs, 4))
        ended = flights.has_ended.copy()
        if ended.any() and (self.autoreset_mode != AutoresetMode.NEXT_STEP or None in self._generators):
            index = int(np.flatnonzero(ended)[0])
            raise RuntimeError(f"the episode of environment {index} has ended, or none has begun: `reset` it")
        flights.fly(checked, ~ended)
        infos: dict[str, Any] = {}
        if ended.any():
            self._begin(np.flatnonzero(ended).tolist(), [None] * self.num_envs, None, infos)
        observations, rewards, times, terminations, truncations = flights.view(checked)
        rewards[ended] = 0.0
        flights.has_ended = terminations | truncations
        stays = ~ended
        lost = np.flatnonzero(terminations).tolist()
        if self.autoreset_mode == AutoresetMode.SAME_STEP and flights.has_ended.any():
            over = np.flatnonzero(flights.has_ended).tolist()
            for index in over:
                info: dict[str, Any] = {"time": float(times[index])}
                if index in lost:
                    info["lost"] = flights.simulations[index].lost
                self._add_info(infos, {"final_obs": observations[index].copy(), "final_info": info}, index)
            stays[over], lost = False, []
            self._begin(over, [None] * self.num_envs, None, infos)
            observations = flights.view()[0]
        if stays.any():
            infos |= {"time": np.where(stays, times, 0.0), "_time": stays}
        for index in lost:
            self._add_info(infos, {"lost": flights.simulations[index].lost}, index)
        return observations, rewards, terminations, truncations, infos

    def _begin(
        self, indices: list[int], seeds: Sequence[int | None], options: Mapping[str, Any] | None, infos: dict[str, Any]
    ) -> dict[str, Any]:
        flight_seeds, generators = [], []
        for index in indices:
            seed = seeds[index]
            generator = self._generators[index]
            if seed is not None or generator is None:
                generator = self._generators[index] = gymnasium.utils.seeding.np_random(seed)[0]
            flight_seeds.append(_seed_of_flight(seed, generator))
            generators.append(generator)
        self._flights.begin_all(indices, flight_seeds, generators, options)
        for index, flight_seed in zip(indices, flight_seeds, strict=True):
            self._add_info(infos, {"seed": flight_seed}, index)
        return infos

    def _refuse_closed(self) -> None:
        if self.closed:
            raise RuntimeError("the environments are closed")

    def close_extras(self, **_: Any) -> None:
        """Drop the flights."""
        self._flights.simulations = []


def _seed_of_flight(seed: int | None, generator: np.random.Generator) -> int:
    return int(generator.integers(1 << 62)) if seed is None else int(seed)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _worthwhile_threads(schedule: Mapping[str, Any], number: int) -> int:
    """Return a thread for each core, but none with less work than the start of a thread costs."""
    tick = float(schedule["tick"])
    ticks = number * float((schedule.get("period") or {}).get("controller", tick)) / tick
    return max(1, min(_cores(), int(ticks) // _TICKS_OF_A_THREAD))
