"""An arm, a gripper and an object as a model of MuJoCo, from the numbers that `catchingbot` gives of them."""

from __future__ import annotations

from functools import cache
from xml.etree.ElementTree import Element, SubElement, tostring

import mujoco
import numpy as np

STEP_S = 0.0005
# What cameras see, and what only collides: groups of geoms.
SEEN, HIDDEN = "1", "3"
# Inertia of motor and gear of a real gripper at each finger, in kg: chosen, as in docs/explanation/physics.md.
DRIVE_KG = 0.5


def text(*values) -> str:
    return " ".join(f"{it:.12g}" for value in values for it in np.ravel(value))


def frame(X) -> dict[str, str]:
    """Position and orientation of a frame, from a 4×4 matrix."""
    X, quat = np.asarray(X), np.zeros(4)
    mujoco.mju_mat2Quat(quat, X[:3, :3].flatten())
    return {"pos": text(X[:3, 3]), "quat": text(quat)}


def matrix(position, xyzw) -> np.ndarray:
    X, R = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(R, np.roll(xyzw, 1))
    X[:3, :3], X[:3, 3] = R.reshape(3, 3), position
    return X


def inertial(body: Element, mass: float, com, I) -> None:
    I = np.asarray(I)
    moments = text(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    SubElement(body, "inertial", mass=text(mass), pos=text(com), fullinertia=moments)


def box_inertia(mass: float, size) -> np.ndarray:
    x, y, z = np.square(size)
    return mass / 12 * np.diag([y + z, x + z, x + y])


def add_capsules(body: Element, capsules: list[dict], name: str) -> None:
    for i, it in enumerate(capsules):
        # A capsule without a length is a ball.
        shape = {"type": "capsule", "fromto": text(it["from"], it["to"])} if it["from"] != it["to"] else {"type": "sphere", "pos": text(it["from"])}
        SubElement(body, "geom", name=f"{name}:{i}", size=text(it["radius"]), group=SEEN, **shape)


def add_arm(world: Element, arm: dict, gripper: dict, *, drive_kg: float, mass_ratios=None, X_MG=np.eye(4)) -> None:
    body = SubElement(world, "body", name="base", **frame(arm["X_WB"]))
    for link in range(len(arm["joints"]) + 1):
        if link > 0:
            joint = arm["joints"][link - 1]
            ratio = 1.0 if mass_ratios is None else mass_ratios[link - 1]
            body = SubElement(body, "body", name=joint["link"], **frame(joint["X_PL"]))
            damping = {"damping": text(joint["damping"]), "armature": text(joint["rotor_inertia"])}
            SubElement(body, "joint", name=joint["name"], axis=text(joint["axis"]), **damping)
            inertial(body, ratio * joint["mass"], joint["com"], ratio * np.asarray(joint["inertia"]))
        add_capsules(body, [it for it in arm["capsules"] if it["link"] == link], f"arm:{link}")
    # Axes of G: the fingers close along x, y is the approach.
    hand = SubElement(body, "body", name="gripper", **frame(np.asarray(arm["X_LG"]) @ X_MG))
    inertial(hand, gripper["body_mass_kg"], np.zeros(3), box_inertia(gripper["body_mass_kg"], gripper["body_size_m"]))
    SubElement(hand, "geom", name="palm:0", type="box", size=text(np.array(gripper["body_size_m"]) / 2), group=SEEN)
    for name, side in [("left", -1), ("right", 1)]:
        finger = SubElement(hand, "body", name=name)
        reach = {"range": text(0, gripper["max_width_m"] / 2), "limited": "true"}
        SubElement(finger, "joint", name=name, type="slide", axis=text(side, 0, 0), armature=text(drive_kg), **reach)
        size = np.array(gripper["finger_size_m"])
        centre = np.array([side * size[0] / 2, gripper["finger_centre_y_m"], 0])
        inertial(finger, gripper["finger_mass_kg"], centre, box_inertia(gripper["finger_mass_kg"], size))
        SubElement(finger, "geom", name=f"{name}:0", type="box", size=text(size / 2), pos=text(centre), group=SEEN)


def add_object(asset: Element, world: Element, thing: dict) -> None:
    body = SubElement(world, "body", name="object")
    SubElement(body, "freejoint", name="object")
    inertial(body, thing["mass"], thing["com"], thing["inertia"])
    SubElement(asset, "mesh", name="surface", vertex=text(thing["vertices"]), face=text(thing["faces"]), inertia="shell")
    SubElement(body, "geom", name="surface", type="mesh", mesh="surface", group=SEEN)
    for i, part in enumerate(thing["parts"]):
        if "hull" in part:
            SubElement(asset, "mesh", name=f"part{i}", vertex=text(part["hull"]))
            SubElement(body, "geom", name=f"object:{i}", type="mesh", mesh=f"part{i}", group=HIDDEN)
        else:
            SubElement(body, "geom", name=f"object:{i}", size=text(part["ball"]["radius_m"]), pos=text(part["ball"]["centre"]), group=HIDDEN)


def add_pairs(root: Element, friction: float, torsion_m: float, solref: tuple[float, float]) -> None:
    """What touches what: the object everything else. Explicit pairs, as restitution by `solref` must not weaken the friction."""
    names = [it.get("name") for it in root.iter("geom") if it.get("name")]
    contact = SubElement(root, "contact")
    coefficients = text(friction, friction, torsion_m, 1e-4, 1e-4)
    for part in [it for it in names if it.startswith("object:")]:
        for other in [it for it in names if not it.startswith(("object:", "surface"))]:
            SubElement(contact, "pair", geom1=part, geom2=other, condim="4", friction=coefficients, solref=text(solref), solreffriction="0.0035 1", solimp="0.95 0.99 0.001 0.5 2")


def empty() -> tuple[Element, Element, Element]:
    root = Element("mujoco")
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", timestep=text(STEP_S), cone="elliptic", gravity="0 0 -9.81")
    default = SubElement(root, "default")
    SubElement(default, "geom", contype="0", conaffinity="0")
    return root, SubElement(root, "asset"), SubElement(root, "worldbody")


def nominal(setup) -> mujoco.MjModel:
    """The arm as its controller believes it to be, with its gripper half open."""
    root, _, world = empty()
    add_arm(world, setup.robot.numbers, setup.gripper.numbers, drive_kg=0.0)
    return mujoco.MjModel.from_xml_string(tostring(root, "unicode"))


def scene(setup, drawn: dict, drive_kg: float) -> str:
    """Everything, under the conditions that were drawn for a throw: an MJCF."""
    arm, gripper, thing = setup.robot.numbers, setup.gripper.numbers, setup.object
    root, asset, world = empty()
    SubElement(world, "geom", name="floor:0", type="plane", size="20 20 1", group=HIDDEN)
    for i, box in enumerate(arm["boxes"]):
        SubElement(world, "geom", name=f"obstacle:box{i}", type="box", size=text(np.array(box["size"]) / 2), group=SEEN, **frame(box["X_WS"]))
    add_capsules(world, arm["obstacle_capsules"], "obstacle")
    mount = drawn["gripper_mount"]
    X_MG = matrix(mount["position_m"], mount["orientation_xyzw"])
    add_arm(world, arm, gripper, drive_kg=drive_kg, mass_ratios=drawn["link_mass_ratios"], X_MG=X_MG)
    add_object(asset, world, thing)
    # As stiff as the object's surface, at most 160 Hz; a soft one has a patch that resists rotation (2/3 of its radius).
    finger_kg = gripper["finger_mass_kg"] + drive_kg
    reduced_kg = thing["mass"] * finger_kg / (thing["mass"] + finger_kg)
    stiffness, radius = thing["stiffness_npm"], np.ptp(thing["vertices"], axis=0).min() / 2
    rate = 1000.0 if stiffness is None else min(np.sqrt(stiffness / reduced_kg), 1000.0)
    torsion_m = 5e-4 if stiffness is None else 2 / 3 * np.sqrt(radius * gripper["max_force_n"] / stiffness)
    ratio = damping_ratio(round(drawn["restitution"], 2), rate)
    add_pairs(root, max(drawn["friction"], 1e-5), torsion_m, (1 / (rate * ratio), ratio))
    for i, (it, stands) in enumerate(zip(setup.cameras, drawn["cameras"], strict=True)):
        # MuJoCo's cameras look along -z, with y up.
        X_WC = matrix(stands["position_m"], stands["orientation_xyzw"]) @ np.diag([1, -1, -1, 1])
        SubElement(world, "camera", name=f"camera:{i}", fovy=text(np.degrees(2 * np.arctan(it.size_px[1] / 2 / it.K[0, 0]))), **frame(X_WC))
    return tostring(root, "unicode")


def bounce(ratio: float, rate: float) -> float:
    """How fast a ball that meets the floor at 3 m/s leaves it, as a fraction."""
    root, _, world = empty()
    SubElement(world, "geom", name="floor:0", type="plane", size="1 1 1")
    ball = SubElement(world, "body", name="object", pos="0 0 0.0301")
    SubElement(ball, "freejoint")
    SubElement(ball, "geom", name="object:0", size="0.03", mass="0.1")
    add_pairs(root, 0.5, 5e-4, (1 / (rate * ratio), ratio))
    model = mujoco.MjModel.from_xml_string(tostring(root, "unicode"))
    data = mujoco.MjData(model)
    data.qvel[2] = -3.0
    mujoco.mj_step(model, data, 60)
    return data.qvel[2] / 3.0


@cache
def damping_ratio(restitution: float, rate: float) -> float:
    """The damping ratio of contacts with this restitution, by bisection."""
    low, high = 0.02, 1.0
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if bounce(middle, rate) > restitution else (low, middle)
    return high
