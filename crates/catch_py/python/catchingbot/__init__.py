"""CatchingBot: a robot arm that catches thrown objects, in simulation.

>>> import catchingbot as cb
>>> trial = cb.Setup("paper", object="banana").run(seed=1)
>>> trial.caught
True
"""

from catchingbot._catchingbot import (
    Arena,
    ArmState,
    Brain,
    Camera,
    Command,
    DepthFrame,
    Executor,
    Flight,
    Gripper,
    GripperMove,
    GripperQueue,
    GripperState,
    NoFlight,
    ObjectPose,
    Observation,
    Plan,
    Recorder,
    Recording,
    RegisteredPose,
    Rejection,
    Robot,
    Setup,
    Situation,
    SteeredArena,
    Trajectory,
    Trial,
    __version__,
    judge,
    predict,
    register,
)
from catchingbot.benchmark import Suite, SuiteResult
from catchingbot.table import Table


def suite(name: str) -> Suite:
    """The frozen benchmark of this name."""
    return Suite(name)


__all__ = [
    "Arena",
    "ArmState",
    "Brain",
    "Camera",
    "Command",
    "DepthFrame",
    "Executor",
    "Flight",
    "Gripper",
    "GripperMove",
    "GripperQueue",
    "GripperState",
    "NoFlight",
    "ObjectPose",
    "Observation",
    "Plan",
    "Recorder",
    "Recording",
    "RegisteredPose",
    "Rejection",
    "Robot",
    "Setup",
    "Situation",
    "SteeredArena",
    "Suite",
    "SuiteResult",
    "Table",
    "Trajectory",
    "Trial",
    "__version__",
    "judge",
    "predict",
    "register",
    "suite",
]
