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
from catchingbot.table import Table


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
    "Table",
    "Trajectory",
    "Trial",
    "__version__",
    "judge",
    "predict",
    "register",
]
