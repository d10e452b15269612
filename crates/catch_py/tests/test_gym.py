"""The Gymnasium environment: its interface, its scenes, and limits that no action breaks."""

from __future__ import annotations

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

import catchingbot as cb  # noqa: E402
from catchingbot.gym import ID, CatchVectorEnv  # noqa: E402


@pytest.mark.parametrize("obs", ["state", "pose", "cloud"])
def test_the_environment_is_one(obs):
    env = gymnasium.make(ID, scenario="paper", obs=obs, object="banana", throw="near_sampled")
    check_env(env.unwrapped, skip_render_check=True)
    assert all(np.isfinite(it.low).all() and np.isfinite(it.high).all() for it in env.observation_space.values())
    env.close()
    env.close()


def test_pictures_show_what_moves():
    env = gymnasium.make(ID, scenario="paper", render_mode="rgb_array", disable_env_checker=True)
    env.reset(seed=1)
    first = env.render()
    assert first.shape == (360, 480, 3) and first.dtype == np.uint8
    for _ in range(30):
        env.step(np.ones(env.action_space.shape, np.float32))
    changed = (np.abs(env.render().astype(int) - first).max(axis=2) > 30).sum()
    assert 200 < changed < first.size / 10
    env.close()
    batch = CatchVectorEnv(2, scenario="paper", render_mode="rgb_array")
    batch.reset(seed=1)
    assert [it.shape for it in batch.render()] == [(360, 480, 3)] * 2
    batch.close()
    with pytest.raises(ValueError, match="render_mode: found 'ansi', expected None or one of rgb_array, human"):
        gymnasium.make(ID, scenario="paper", render_mode="ansi", disable_env_checker=True)


def test_images_have_zeros_where_there_is_no_depth():
    env = gymnasium.make(ID, scenario="paper", obs="depth", disable_env_checker=True)
    seen, _ = env.reset(seed=1)
    depth = seen["depth"]
    assert depth.shape[0] == len(cb.Setup("paper").cameras) and np.isfinite(depth).all()
    assert (depth == 0).any() and (depth > 0.2).any()
    env.close()


def played(env, seed: int, throws: int, rng) -> list[dict]:
    rows = []
    for throw in range(throws):
        env.reset(seed=seed if throw == 0 else None)
        ended = False
        while not ended:
            _, reward, ended, truncated, info = env.step(env.action_space.sample() if rng is None else rng(env))
            assert not truncated and reward in [0.0, 1.0] and info["is_success"] == (reward == 1.0)
        assert bool(info["reason"]) != info["is_success"] and info["scene"] == {"seed": seed, "index": throw}
        rows.append(env.unwrapped._throws.arena.row)
    return rows


@pytest.mark.parametrize(
    ("scenario", "action"), [("paper", "acceleration"), ("paper", "delta"), ("honest", "acceleration")]
)
def test_no_action_breaks_a_limit(scenario, action):
    env = gymnasium.make(ID, obs="state", action=action, scenario=scenario, disable_env_checker=True)
    env.action_space.seed(1)
    held = {}

    def rough(env):
        # The same action for a while, at its extremes: the arm gets fast.
        count = held["count"] = held.get("count", -1) + 1
        if count % 25 == 0:
            held["action"] = np.sign(env.action_space.sample())
        return held["action"]

    for row in played(env, 1, 1, None) + played(env, 3, 2, rough):
        assert row["limit_violations"] == 0, row
        assert row["discontinuous_trajectories"] == 0
        assert row["min_self_clearance_m"] > 0 and row["min_floor_clearance_m"] > 0
    assert max(row["peak_velocity_ratio"] for row in played(env, 4, 1, rough)) > 0.3
    env.close()


def batch_rows(mode: AutoresetMode, count: int) -> dict[int, tuple[float, str]]:
    """Outcomes by the numbers of the throws, for arms that wait with open grippers."""
    env = gymnasium.make_vec(ID, num_envs=count, autoreset_mode=mode)
    assert env.metadata["autoreset_mode"] is mode
    still = np.full(env.action_space.shape, -1.0, np.float32)
    still[:, :-1] = 0.0
    seen, infos = env.reset(seed=5)
    assert env.observation_space.contains(seen)
    outcomes, resets = {}, 0
    while len(outcomes) < 4:
        scenes = infos["scene"]["index"].copy()
        seen, rewards, ended, truncated, infos = env.step(still)
        assert env.observation_space.contains(seen) and not truncated.any()
        for i in np.flatnonzero(ended):
            final = infos["final_info"] if mode is AutoresetMode.SAME_STEP else infos
            outcomes[int(scenes[i])] = (float(rewards[i]), str(final["reason"][i]))
            if mode is AutoresetMode.SAME_STEP:
                assert infos["scene"]["index"][i] == scenes[i] + count
                assert infos["final_obs"][i]["arm"][-1] > 0.5 > seen["arm"][i][-1]
            else:
                assert infos["scene"]["index"][i] == scenes[i]
        if mode is AutoresetMode.DISABLED and ended.any():
            seen, infos = env.reset(options={"reset_mask": ended})
            assert (seen["arm"][ended, -1] == 0).all()
            resets += 1
            # Those that go on keep their scenes.
            infos["scene"]["index"][~ended] = scenes[~ended]
    env.close()
    env.close()
    with pytest.raises(RuntimeError, match="closed"):
        env.reset()
    return {index: outcomes[index] for index in sorted(outcomes)}


def test_a_batch_sees_the_scenes_of_a_single_arm():
    env = gymnasium.make(ID, scenario="paper", disable_env_checker=True)
    alone = {}
    for index in range(4):
        env.reset(seed=5, options={"index": index})
        still, ended = np.array([0.0] * 7 + [-1.0], np.float32), False
        while not ended:
            _, reward, ended, _, info = env.step(still)
        alone[index] = (reward, info["reason"])
    for mode in AutoresetMode:
        assert batch_rows(mode, 2) == alone, mode


def test_a_batch_gives_the_bytes_of_single_arms():
    setup = cb.Setup(object="banana", throw="near_sampled")
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1, 1, (400, 8)).astype(np.float32)

    def alone(index: int) -> bytes:
        arena = setup.steered_arena(seed=1, index=index)
        for action in actions:
            if arena.step(action):
                return arena.jsonl
        raise AssertionError("the throw did not end")

    env = CatchVectorEnv(8, autoreset_mode="Disabled", object="banana", throw="near_sampled")
    env.reset(seed=1)
    lines: dict[int, bytes] = {}
    for action in actions:
        going = [i for i in range(8) if i not in lines]
        for i, is_done in zip(going, env._all(lambda i: env._throws[i].act(action) and env._throws[i].is_done, going), strict=True):
            if is_done:
                lines[i] = env._throws[i].arena.jsonl
        if len(lines) == 8:
            break
    assert [lines[i] for i in range(8)] == [alone(i) for i in range(8)]
    env.close()


def test_arguments_are_named():
    def raises(argument, call, *arguments, **keywords):
        with pytest.raises((TypeError, ValueError), match=rf"^{argument}\b"):
            call(*arguments, **keywords)

    setup = cb.Setup("paper")
    raises("obs", setup.steered_arena, obs="smell")
    raises("action", setup.steered_arena, action="hope")
    arena = setup.steered_arena()
    for action in [np.zeros(7), np.full(8, np.nan), ["a"] * 8, np.zeros((1, 8)), None]:
        raises("action", arena.step, action)
    raises("num_envs", CatchVectorEnv, 0)
    env = CatchVectorEnv(2)
    with pytest.raises(RuntimeError, match="reset"):
        env.step(np.zeros((2, 8)))
    raises("options", env.reset, options={"nonsense": 1})
    raises("reset_mask", env.reset, options={"reset_mask": np.array([True])})
    env.reset()
    raises("actions", env.step, np.zeros(8))
    arena.close()
    arena.close()
    with pytest.raises(RuntimeError, match="closed"):
        arena.step(np.zeros(8))
