"""CatchingBot: a robot arm that catches thrown objects, in simulation.

>>> import catchingbot as cb
>>> trial = cb.Setup(object="banana").run(seed=1)
>>> trial.caught
True
"""

from catchingbot._catchingbot import (
    Arena,
    Brain,
    Camera,
    Command,
    DepthFrame,
    Flight,
    GripperMove,
    NoFlight,
    Observation,
    Plan,
    RegisteredPose,
    Setup,
    SteeredArena,
    Trajectory,
    Trial,
    __version__,
    predict,
    register,
)
from catchingbot.table import Table

__all__ = [
    "Arena",
    "Brain",
    "Camera",
    "Command",
    "DepthFrame",
    "Flight",
    "GripperMove",
    "NoFlight",
    "Observation",
    "Plan",
    "RegisteredPose",
    "Setup",
    "SteeredArena",
    "Table",
    "Trajectory",
    "Trial",
    "__version__",
    "predict",
    "register",
]
