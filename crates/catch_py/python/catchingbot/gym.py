"""The Gymnasium environment ``catchingbot/Catch-v0``: one throw is an episode, one depth image a step.

>>> import gymnasium
>>> import catchingbot.gym
>>> env = gymnasium.make("catchingbot/Catch-v0", obs="state", action="acceleration")
>>> batch = gymnasium.make_vec("catchingbot/Catch-v0", num_envs=8)

An action has a number from -1 to 1 for each joint (an acceleration, or with ``action="delta"`` a change of its position) and one for the
gripper, which closes above 0.
No action breaks a limit of the arm. The reward is 1 for a catch, at the end.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from catchingbot import Setup, SteeredArena

ID = "catchingbot/Catch-v0"
Arrays = dict[str, np.ndarray]


def register() -> None:
    """Registers the environment with Gymnasium; importing this module calls it."""
    if ID not in gymnasium.registry:
        gymnasium.register(ID, entry_point="catchingbot.gym:CatchEnv", vector_entry_point="catchingbot.gym:CatchVectorEnv")


class _Throws:
    """Successive throws: in a batch of n, each environment takes every n-th."""

    def __init__(self, setup: Setup, step: int, first: int, **kinds: str) -> None:
        self.setup, self.step, self.first, self.kinds = setup, step, first, kinds
        self.seed, self.index = 1, first
        self.arena: SteeredArena | None = None
        self.bounds: dict[str, spaces.Box] = {}
        self.is_done = True

    def begin(self, seed: int | None = None, first: int | None = None) -> Arrays:
        """Begins the next throw; ``seed`` and ``first`` restart the sequence there."""
        if seed is not None:
            self.seed, self.index = seed, self.first
        if first is not None:
            self.index = first + self.first
        self.close()
        self.arena = self.setup.steered_arena(self.seed, self.index, **self.kinds)
        self.bounds = self.bounds or {name: _box(self.setup, name, it.shape) for name, it in self.arena.observation.items()}
        self.scene = {"seed": self.seed, "index": self.index}
        self.index += self.step
        self.is_done = False
        return self.observation()

    def observation(self) -> Arrays:
        """What the arena shows, within its bounds."""
        assert self.arena is not None
        return {name: np.clip(it, self.bounds[name].low, self.bounds[name].high) for name, it in self.arena.observation.items()}

    def picture(self) -> np.ndarray:
        if self.arena is None:
            raise RuntimeError("render: reset() comes first")
        return self.arena.picture

    def act(self, action: np.ndarray) -> tuple[Arrays, float, dict[str, Any]]:
        if self.arena is None or self.is_done:
            raise RuntimeError("step: the throw is done; reset() comes first")
        self.is_done = self.arena.step(action)
        row = self.arena.row if self.is_done else {}
        return self.observation(), float(row.get("caught", False)), self.info(row)

    def info(self, row: Mapping[str, Any] = {}) -> dict[str, Any]:
        return {"is_success": bool(row.get("caught", False)), "reason": row.get("reason") or "", "scene": dict(self.scene)}

    def close(self) -> None:
        if self.arena is not None:
            self.arena.close()
            self.arena = None


# Widest position in metres, speed, turning speed and depth of what is observed; what goes beyond is cut off.
_REACH_M, _SPEED, _TURNING, _DEPTH_M, _TIME_S = 20.0, 50.0, 500.0, 20.0, 60.0


def _box(setup: Setup, name: str, shape: tuple[int, ...]) -> spaces.Box:
    """Bounds of an observation: of the arm its limits with room for impacts, of the rest what a throw can hold."""
    if name == "arm":
        lower, upper, velocity = setup.limits[:3]
        room = 0.1 * (upper - lower)
        low = np.concatenate([lower - room, -3.0 * velocity, [0.0, 0.0]])
        high = np.concatenate([upper + room, 3.0 * velocity, [1.0, _TIME_S]])
    elif name == "object":
        high = np.repeat([_REACH_M, 1.0, _SPEED, _TURNING, 1.0], [3, 4, 3, 3, 1])
        low = np.append(-high[:-1], 0.0)
    else:
        most = _DEPTH_M if name == "depth" else _REACH_M
        low, high = np.full(shape, 0.0 if name == "depth" else -most), np.full(shape, most)
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), shape, np.float32)


def _spaces(setup: Setup, kinds: Mapping[str, str]) -> tuple[spaces.Dict, spaces.Box]:
    arena = setup.steered_arena(**kinds)
    seen = spaces.Dict({name: _box(setup, name, array.shape) for name, array in arena.observation.items()})
    arena.close()
    return seen, spaces.Box(-1.0, 1.0, (setup.dof + 1,), np.float32)


def _checked_mode(mode: str | None, known: Sequence[str]) -> str | None:
    if mode is not None and mode not in known:
        raise ValueError(f"render_mode: found {mode!r}, expected None or one of {', '.join(known)}")
    return mode


class _Window:
    """A window of the desktop that shows pictures."""

    def __init__(self) -> None:
        import tkinter

        try:
            self._root = tkinter.Tk()
        except tkinter.TclError as fault:
            raise RuntimeError(f"render_mode='human': {fault}; without a display take 'rgb_array'") from fault
        self._root.title("CatchingBot")
        self._label = tkinter.Label(self._root)
        self._label.pack()
        self._image = tkinter.PhotoImage()

    def show(self, picture: np.ndarray) -> None:
        import tkinter

        head = f"P6 {picture.shape[1]} {picture.shape[0]} 255 ".encode()
        self._image = tkinter.PhotoImage(data=head + picture.tobytes(), format="PPM")
        self._label.configure(image=self._image)
        self._root.update()

    def close(self) -> None:
        self._root.destroy()


def _checked_options(options: Mapping[str, Any] | None, known: Sequence[str]) -> Mapping[str, Any]:
    options = options or {}
    unknown = [name for name in options if name not in known]
    if unknown:
        raise ValueError(f"options: found {unknown}, expected {' or '.join(known)}")
    return options


class CatchEnv(gymnasium.Env):
    """One arm, successive throws. Keywords besides ``obs`` and ``action`` are those of ``Setup``."""

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}

    def __init__(self, obs: str = "state", action: str = "acceleration", render_mode: str | None = None, **setup: Any) -> None:
        self._throws = _Throws(Setup(**setup), 1, 0, obs=obs, action=action)
        self.observation_space, self.action_space = _spaces(self._throws.setup, self._throws.kinds)
        self.render_mode = _checked_mode(render_mode, self.metadata["render_modes"])
        self._window: _Window | None = None

    def render(self) -> np.ndarray | None:
        """A picture of arm and object, 480 × 360 pixels; in the mode ``human``, in a window, which ``step`` does by itself."""
        if self.render_mode is None:
            return None
        picture = self._throws.picture()
        if self.render_mode == "rgb_array":
            return picture
        self._window = self._window or _Window()
        self._window.show(picture)
        return None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Arrays, dict[str, Any]]:
        """Begins the next throw: with ``seed`` throw 0 of that seed, with ``options={"index": i}`` throw i."""
        super().reset(seed=seed)
        seen = self._throws.begin(seed, _checked_options(options, ["index"]).get("index"))
        if self.render_mode == "human":
            self.render()
        return seen, self._throws.info()

    def step(self, action: np.ndarray) -> tuple[Arrays, float, bool, bool, dict[str, Any]]:
        seen, reward, info = self._throws.act(action)
        if self.render_mode == "human":
            self.render()
        return seen, reward, self._throws.is_done, False, info

    def close(self) -> None:
        self._throws.close()
        if self._window is not None:
            self._window.close()
            self._window = None


class CatchVectorEnv(VectorEnv):
    """A batch of arms on the threads of one pool. With one seed for all environments, environment i modulo n takes throw i."""

    metadata = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        obs: str = "state",
        action: str = "acceleration",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        render_mode: str | None = None,
        **setup: Any,
    ) -> None:
        if not isinstance(num_envs, int) or num_envs < 1:
            raise ValueError(f"num_envs: found {num_envs}, expected a whole number from 1")
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        shared = Setup(**setup)
        self._throws = [_Throws(shared, num_envs, i, obs=obs, action=action) for i in range(num_envs)]
        self.num_envs, self.render_mode = num_envs, _checked_mode(render_mode, self.metadata["render_modes"])
        self.single_observation_space, self.single_action_space = _spaces(shared, self._throws[0].kinds)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._threads = threads or os.cpu_count() or 1
        self._pool: ThreadPoolExecutor | None = None
        self._seen: list[Arrays] = []

    def _all(self, work: Callable[[int], Any], which: Sequence[int]) -> list[Any]:
        if self.closed:
            raise RuntimeError("the environment is closed")
        if self._pool is None:
            self._pool = ThreadPoolExecutor(min(self._threads, self.num_envs))
        return list(self._pool.map(work, which))

    def _batch(self) -> Arrays:
        return {name: np.stack([seen[name] for seen in self._seen]) for name in self.single_observation_space}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """As ``CatchEnv.reset``; ``options={"reset_mask": mask}`` resets only the environments where the mask is true."""
        options = _checked_options(options, ["index", "reset_mask"])
        mask = np.asarray(options.get("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(f"reset_mask: found {mask}, expected {self.num_envs} bools, one of which is true")
        if not self._seen and not mask.all():
            raise ValueError("reset_mask: the first reset is of all environments")
        seeds = [seed] * self.num_envs if seed is None or np.isscalar(seed) else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: found {len(seeds)} seeds, expected {self.num_envs}")
        which = [int(i) for i in np.flatnonzero(mask)]
        seen = self._all(lambda i: self._throws[i].begin(seeds[i], options.get("index")), which)
        self._seen = self._seen or [{}] * self.num_envs
        infos: dict[str, Any] = {}
        for i, arrays in zip(which, seen, strict=True):
            self._seen[i] = arrays
            infos = self._add_info(infos, self._throws[i].info(), i)
        return self._batch(), infos

    def step(self, actions: np.ndarray) -> tuple[Arrays, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise ValueError(f"actions: found shape {actions.shape}, expected {self.action_space.shape}")
        if not self._seen:
            raise RuntimeError("step: reset() comes first")

        def one(i: int) -> tuple[Arrays, float, dict[str, Any], bool, dict[str, Any]]:
            throws = self._throws[i]
            if throws.is_done and self._mode is AutoresetMode.NEXT_STEP:
                return throws.begin(), 0.0, throws.info(), False, {}
            seen, reward, info = throws.act(actions[i])
            if throws.is_done and self._mode is AutoresetMode.SAME_STEP:
                final = {"final_obs": seen, "final_info": info}
                return throws.begin(), reward, throws.info(), True, final
            return seen, reward, info, throws.is_done, {}

        done = self._all(one, range(self.num_envs))
        infos: dict[str, Any] = {}
        for i, (seen, _, info, _, final) in enumerate(done):
            self._seen[i] = seen
            infos = self._add_info(infos, {**info, **final}, i)
        rewards = np.array([it[1] for it in done], dtype=np.float64)
        terminations = np.array([it[3] for it in done], dtype=np.bool_)
        return self._batch(), rewards, terminations, np.zeros(self.num_envs, np.bool_), infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each arm."""
        return None if self.render_mode is None else tuple(self._all(lambda i: self._throws[i].picture(), range(self.num_envs)))

    def close_extras(self, **_: Any) -> None:
        if self._pool is not None:
            self._pool.shutdown()
        for throws in self._throws:
            throws.close()


register()
