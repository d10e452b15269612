"""Brains that are written in Python, refereed by the lab."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import catchingbot as cb


class Wrapper:
    """Passes on what the scenario's brain wants."""

    def __init__(self, setup: cb.Setup, seed: int, index: int) -> None:
        self.ours = setup.brain(seed=seed, index=index)

    def tick(self, observation: cb.Observation) -> cb.Command:
        return self.ours.tick(observation)


class Waiting:
    def __init__(self, setup: cb.Setup, seed: int, index: int) -> None:
        pass

    def tick(self, observation: cb.Observation) -> None:
        assert observation.arm.q.shape == (7,) and observation.arm.commanded.shape == (3, 7)
        for frame in observation.frames:
            assert frame.depth_m.dtype == np.float32 and frame.mask.shape == frame.depth_m.shape


def test_a_wrapper_of_our_brain_gives_our_rows(setup):
    ours = setup.evaluate(trials=2)
    assert setup.evaluate(trials=2, brain=Wrapper, threads=2).jsonl == ours.jsonl


def test_a_brain_that_waits_catches_nothing(setup):
    told = []
    table = setup.evaluate(trials=2, brain=Waiting, threads=2, progress=lambda done, trials: told.append((done, trials)))
    assert not table["caught"].any() and told == [(1, 2), (2, 2)]


class Failing(Wrapper):
    def tick(self, observation: cb.Observation) -> cb.Command:
        if observation.time_s > 0.1:
            raise ZeroDivisionError("of the brain")
        return super().tick(observation)


def test_an_exception_of_the_brain_comes_out(setup):
    threads = threading.active_count()
    with pytest.raises(ZeroDivisionError, match="of the brain"):
        setup.evaluate(trials=50, brain=Failing)
    assert threading.active_count() == threads
    with pytest.raises(ZeroDivisionError):
        setup.evaluate(trials=50, brain=lambda *_: 1 / 0)
    with pytest.raises(TypeError, match="tick"):
        setup.evaluate(trials=50, brain=lambda *_: 3)

    class Babbling(Waiting):
        def tick(self, observation):
            return "go"

    with pytest.raises(TypeError, match="^brain: tick returned go"):
        setup.evaluate(trials=50, brain=Babbling)
    with pytest.raises(KeyError):
        setup.evaluate(trials=50, progress=lambda done, trials: {}[done])
    assert setup.evaluate(trials=1)["caught"].all()


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_an_interrupt_ends_an_evaluation():
    # Jobs in the background of a shell ignore interrupts, and so would the child.
    begin = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{begin}; import catchingbot as cb; print('go', flush=True); cb.Setup('paper').evaluate(trials=100_000)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        try:
            assert child.stdout.readline() == "go\n"
            time.sleep(3)
            os.kill(child.pid, signal.SIGINT)
            _, errors = child.communicate(timeout=60)
        finally:
            child.kill()
    assert "KeyboardInterrupt" in errors and child.returncode != 0


def test_other_threads_go_on(setup):
    counted, ended = 0, threading.Event()

    def count():
        nonlocal counted
        while not ended.wait(0.001):
            counted += 1

    thread = threading.Thread(target=count)
    thread.start()
    setup.evaluate(trials=2)
    ended.set()
    thread.join()
    assert counted > 10
