"""Trains a residual policy with stable-baselines3 and measures it against the brain alone, on throws that it has not seen.

    pip install "./crates/catch_py[gym]" stable-baselines3
    python crates/catch_py/examples/residual.py --minutes 60 --page docs/results/residual-policy.md

The brain acts; the policy shifts its motions until the catch by at most 0.1 rad per joint. It decides twenty times a second and is rewarded for
catches alone.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import SubprocVecEnv

import catchingbot as cb
from catchingbot.gym import ID

# The policy sees one image of five.
IMAGES = 5


class UntilCatch(gymnasium.Wrapper):
    """One action for some images, and none once the catch is over: the brain goes on alone until the throw is judged."""

    def reset(self, **keywords):
        self.still = np.zeros(self.action_space.shape, np.float32)
        return self.env.reset(**keywords)

    def step(self, action):
        for _ in range(IMAGES):
            seen, reward, ended, truncated, info = self.env.step(action)
            if ended:
                break
        is_over = seen["plan"][-1] > 0 and seen["plan"][-2] < 0
        # Where nothing was planned within a second, nothing will be.
        while not ended and (is_over or seen["arm"][-1] > 1.0):
            seen, reward, ended, truncated, info = self.env.step(self.still)
        return seen, reward, ended, truncated, info


class Limit(BaseCallback):
    """Ends the training after some minutes, and counts throws and catches."""

    def __init__(self, minutes: float) -> None:
        super().__init__()
        self.until, self.throws, self.caught = time.monotonic() + 60 * minutes, 0, 0

    def _on_step(self) -> bool:
        for done, info in zip(self.locals["dones"], self.locals["infos"], strict=True):
            self.throws += int(done)
            self.caught += int(done and info["is_success"])
        return time.monotonic() < self.until


def maker(arguments: argparse.Namespace, seed: int) -> Callable[[], gymnasium.Env]:
    def make() -> gymnasium.Env:
        keywords = {name: getattr(arguments, name) for name in ["obs", "scenario", "object", "throw"]}
        env = UntilCatch(gymnasium.make(ID, action="residual", disable_env_checker=True, **keywords))
        env.reset(seed=seed)
        return env

    return make


def outcomes(env: gymnasium.Env, act: Callable[[dict], np.ndarray], seed: int, throws: int) -> np.ndarray:
    """Which throws were caught."""
    caught = []
    for index in range(throws):
        seen, _ = env.reset(seed=seed, options={"index": index})
        ended = False
        while not ended:
            seen, reward, ended, _, _ = env.step(act(seen))
        caught.append(reward > 0)
    return np.array(caught)


def wilson(caught: np.ndarray) -> str:
    """A rate with its 95 % interval (Wilson)."""
    n, p, z = len(caught), caught.mean(), 1.96
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)
    return f"{100 * p:.1f} ({100 * low:.1f} – {100 * high:.1f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0, help="of training")
    parser.add_argument("--envs", type=int, default=2, help="arms that throw at the same time")
    parser.add_argument("--obs", default="state", choices=["state", "pose"])
    parser.add_argument("--scenario", default="honest")
    parser.add_argument("--object", default="banana")
    parser.add_argument("--throw", default="random")
    parser.add_argument("--throws", type=int, default=400, help="of the comparison")
    parser.add_argument("--page", type=Path, help="a page of results to write")
    arguments = parser.parse_args()

    # Training throws with the seeds 1000, 1001, …; the comparison with the seed 1.
    envs = SubprocVecEnv([maker(arguments, 1000 + i) for i in range(arguments.envs)], start_method="spawn")
    # Small actions at first: the brain is good already.
    policy = {"log_std_init": -2.0, "net_arch": [64, 64]}
    model = PPO("MultiInputPolicy", envs, n_steps=256, batch_size=128, gamma=1.0, seed=1, device="cpu", policy_kwargs=policy)
    limit = Limit(arguments.minutes)
    model.learn(total_timesteps=10**9, callback=limit)
    envs.close()

    env = maker(arguments, 1)()
    alone = outcomes(env, lambda _: env.unwrapped.action_space.low * 0, 1, arguments.throws)
    shifted = outcomes(env, lambda seen: model.predict(seen, deterministic=True)[0], 1, arguments.throws)
    env.close()

    what = f"`{arguments.scenario}`, {arguments.object}, {arguments.throw} throws, `obs=\"{arguments.obs}\"`"
    command = f"python crates/catch_py/examples/residual.py --minutes {arguments.minutes:g} --envs {arguments.envs} --throws {arguments.throws}"
    page = f"""# Results: residual policy

This page is written by a command; changes by hand get lost.

What is measured: what a policy that shifts the brain's motions adds to what the brain catches alone ({what}).

| | |
|---|---|
| command | `{command}` |
| version | {cb.__version__}, stable-baselines3 PPO |
| machine | {platform.machine()}, {arguments.envs} arms at the same time |
| training | {arguments.minutes:g} min, {model.num_timesteps} decisions in {limit.throws} throws, of which {100 * limit.caught / max(limit.throws, 1):.1f} % were caught |

The policy is rewarded for catches alone and sees the object {"as it truly is" if arguments.obs == "state" else "as the brain sees it"}. Both catch the same {arguments.throws} throws of a seed that no training saw.
Figures are percent, in brackets the 95 % interval (Wilson).

| | caught, % |
| --- | --- |
| the brain alone | {wilson(alone)} |
| with the policy | {wilson(shifted)} |

Of the {arguments.throws} throws, {int((shifted & ~alone).sum())} were caught with the policy only and {int((alone & ~shifted).sum())} by the brain alone only.
"""
    print(page)
    if arguments.page:
        arguments.page.write_text(page)


if __name__ == "__main__":
    main()
