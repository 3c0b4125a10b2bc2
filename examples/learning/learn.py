"""Learns to hover with the PPO of Stable-Baselines3, on flights side by side, and saves the policy for fly_policy.py.

    learn.py [--steps N] [--envs N] [--threads N] [--seed N] [--out FILE]
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

import fly_policy
import gerono.gym

SCENARIO = fly_policy.LEARNED


def vary(generator):
    """Return settings of an episode: it starts up to 0.7 m beside the point, along each axis."""
    return {"vehicle.initial.position": generator.uniform(-0.7, 0.7, 3) - (0.0, 0.0, 1.0)}


def reward(observation, action):
    """Return 1 at the point, at rest, and less for distance, speed and turning."""
    state, reference = observation
    distance = np.linalg.norm(state["position_world"] - reference["position_world"])
    speed = np.linalg.norm(state["velocity_body"])
    return float(np.exp(-2.0 * distance) - 0.05 * speed - 0.02 * np.sum(np.square(action)))


class Flights(VecEnv):
    """A vector of environments as Stable-Baselines3 names it."""

    def __init__(self, environments):
        self.environments = environments
        self.render_mode = None
        super().__init__(
            environments.num_envs, environments.single_observation_space, environments.single_action_space
        )

    def reset(self):
        return self.environments.reset(seed=self._seeds if self._seeds[0] is not None else None)[0]

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        observations, rewards, terminations, truncations, infos = self.environments.step(self.actions)
        ended = terminations | truncations
        each = [{} for _ in ended]
        for index in np.flatnonzero(ended):
            each[index] = {
                "terminal_observation": infos["final_obs"][index],
                "TimeLimit.truncated": bool(truncations[index]),
            }
        return observations, rewards.astype(np.float32), ended, each

    def close(self):
        self.environments.close()

    def get_attr(self, name, indices=None):
        return [getattr(self.environments, name, None)] * len(list(self._get_indices(indices)))

    def set_attr(self, name, value, indices=None):
        raise NotImplementedError

    def env_method(self, name, *arguments, indices=None, **named):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper, indices=None):
        return [False] * len(list(self._get_indices(indices)))


def fly(act, episodes=20):
    """Fly episodes; return mean return, distance in the last second, m, losses, and the largest excess over the box, m."""
    environment = gerono.gym.Env(SCENARIO, reward=reward, vary=vary)
    envelope = environment.scenario.values()["envelope"]
    returns, distances, losses, beyond = [], [], {}, 0.0
    for episode in range(episodes):
        seen, _ = environment.reset(seed=1000 + episode)
        total, near, over = 0.0, [], False
        while not over:
            seen, gained, terminated, truncated, info = environment.step(act(seen))
            total += gained
            position = environment.simulation["vehicle/truth"]["position_world"]
            beyond = max(beyond, *(position - envelope["box"]["max"]), *(envelope["box"]["min"] - position))
            if info["time"] > 5.0:
                near.append(np.linalg.norm(position - (0.0, 0.0, -1.0)))
            over = terminated or truncated
        returns.append(total)
        if terminated:
            reason = info["lost"].rsplit(", at ", 1)[0]
            losses[reason] = losses.get(reason, 0) + 1
        else:
            distances.append(np.mean(near))
    middle = np.median(distances) if distances else np.nan
    print(f"  return {np.mean(returns):.1f}; last second {middle:.3f} m; beyond the box {beyond:.2f} m; lost {losses}")


def save(ppo, path):
    """Save the layers from an observation to the mean of the action, so that a flight needs neither torch nor its start."""
    network = [*ppo.policy.mlp_extractor.policy_net, ppo.policy.action_net]
    layers = [layer for layer in network if isinstance(layer, torch.nn.Linear)]
    numbers = {}
    for index, layer in enumerate(layers):
        numbers |= {f"weight{index}": layer.weight.detach().numpy(), f"bias{index}": layer.bias.detach().numpy()}
    np.savez(path, **numbers)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--envs", type=int, default=32)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=SCENARIO.parent / "policy.npz")
    given = parser.parse_args()
    # Networks of this size are slower on several threads.
    torch.set_num_threads(1)
    environments = gerono.gym.VectorEnv(
        SCENARIO, given.envs, reward=reward, vary=vary, threads=given.threads, autoreset_mode="SameStep"
    )
    flights = VecMonitor(Flights(environments))
    policy = {"net_arch": [64, 64], "log_std_init": -1.0}
    ppo = PPO(
        "MlpPolicy", flights, n_steps=128, batch_size=1024, n_epochs=8, gamma=0.98, learning_rate=1e-3,
        policy_kwargs=policy, seed=given.seed, device="cpu",
    )
    generator = np.random.default_rng(given.seed)
    print("random:")
    fly(lambda seen: generator.uniform(-1.0, 1.0, 4))
    print("untrained:")
    fly(lambda seen: ppo.predict(seen, deterministic=True)[0])
    began = time.monotonic()

    def show(known, _):
        if known["self"].num_timesteps % (given.envs * 128 * 8) == 0 and known["self"].ep_info_buffer:
            mean = np.mean([episode["r"] for episode in known["self"].ep_info_buffer])
            print(f"  {known['self'].num_timesteps} steps, {time.monotonic() - began:.0f} s: return {mean:.1f}", flush=True)
        return True

    ppo.learn(given.steps, callback=show)
    print(f"trained for {time.monotonic() - began:.0f} s:")
    save(ppo, given.out)
    fly(fly_policy.load(given.out))


if __name__ == "__main__":
    main()
