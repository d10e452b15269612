"""The server of franka-sim in lock-step with its client: each answered state is one step of physics.

    python server.py ROBOT_FOLDER PORT --q=q1,...,q7 [--lose N] [--together R] [--late L]

It prints "ready" once it listens. With --lose every N-th answer is lost, R answers together; with --late, too, the link holds L answers, once, after the
N-th. Connections count anew. Motion limits and communication constraints are enforced.
"""

import argparse
import os
import pathlib
import tempfile
import tomllib
import xml.etree.ElementTree as xml

# Reflected inertia of the rotors in kg m2: the position servo of franka-sim oscillates on joints 1 and 3 with
# the 0.1 of robot.toml.
ARMATURE_KGM2 = "0.195"


def mjcf(folder):
    """The arm of a robot's folder as MuJoCo's XML: links, capsules, and pairs of links that do not meet."""
    urdf = xml.parse(folder / "robot.urdf").getroot()
    settings = tomllib.loads((folder / "robot.toml").read_text())
    capsules = {it["link"]: it for it in settings["collision"]["capsules"]}
    joints = {it.find("parent").get("link"): it for it in urdf.iter("joint") if it.get("type") == "revolute"}
    links = {it.get("name"): it for it in urdf.iter("link")}
    root = xml.Element("mujoco", model="arm")
    xml.SubElement(root, "compiler", angle="radian", eulerseq="XYZ")
    body, chain = xml.SubElement(root, "worldbody"), [next(iter(capsules))]
    pose = {}
    while True:
        name = chain[-1]
        body = xml.SubElement(body, "body", name=name, **pose)
        if len(chain) > 1:
            limit, axis = joint.find("limit"), joint.find("axis").get("xyz")
            xml.SubElement(body, "joint", name=joint.get("name"), axis=axis, armature=ARMATURE_KGM2, damping="1",
                           range=f"{limit.get('lower')} {limit.get('upper')}", limited="true")
        if (inertial := links[name].find("inertial")) is not None:
            origin, i = inertial.find("origin"), inertial.find("inertia")
            full = " ".join(i.get(k) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
            xml.SubElement(body, "inertial", pos=origin.get("xyz"), mass=inertial.find("mass").get("value"),
                           fullinertia=full)
        if (capsule := capsules.get(name)) is not None:
            ends = " ".join(str(it) for it in capsule["from_m"] + capsule["to_m"])
            xml.SubElement(body, "geom", name=f"{name}_collision", type="capsule", fromto=ends,
                           size=str(capsule["radius_m"]), mass="0")
        if (joint := joints.get(name)) is None:
            break
        origin = joint.find("origin")
        pose = {"pos": origin.get("xyz"), "euler": origin.get("rpy", "0 0 0")}
        chain.append(joint.find("child").get("link"))
    contact = xml.SubElement(root, "contact")
    for i, one in enumerate(chain):
        for other in chain[i + 1:i + 1 + settings["collision"]["ignored_neighbours"]]:
            xml.SubElement(contact, "exclude", body1=one, body2=other)
    return xml.tostring(root, encoding="unicode")


arguments = argparse.ArgumentParser()
arguments.add_argument("robot", type=pathlib.Path)
arguments.add_argument("port", type=int)
arguments.add_argument("--q", required=True)
arguments.add_argument("--lose", type=int, default=0)
arguments.add_argument("--together", type=int, default=1)
arguments.add_argument("--late", type=int, default=0)
arguments = arguments.parse_args()
model = pathlib.Path(tempfile.mkdtemp()) / "arm.xml"
model.write_text(mjcf(arguments.robot))
os.environ["FR3_MJCF"] = str(model)

import franka_sim.mujoco_franka_sim as simulation
from protocol import Arm, Server

simulation.ARM_INITIAL_Q = simulation.np.array([float(it) for it in arguments.q.split(",")])
Server(Arm(), arguments.port, lose=arguments.lose, together=arguments.together, late=arguments.late).start()
