"""MuJoCo models (MJCF) as files that ``catchingbot robot import`` and ``catchingbot object import`` read.

    python -m catchingbot.mujoco arm.xml --out arm

MuJoCo compiles the model, so defaults, frames, attached models, replicates and masses of geoms agree with MuJoCo. The folder receives
``model.urdf`` and its meshes.

>>> import catchingbot.mujoco
>>> print(catchingbot.mujoco.convert("arm.xml", "arm"))
arm/model.urdf
"""

from __future__ import annotations

import argparse
import shlex
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

# MuJoCo's default: no friction stated by the author.
_FRICTION = 1.0
# An ellipsoid's mesh: segments from pole to pole, and the factor by which it is wider to contain the ellipsoid.
_SEGMENTS = 32
_WIDER = 1.0025


class CannotExpress(ValueError):
    """Raised for a model that URDF cannot express."""


def convert(model: str | Path | mujoco.MjModel, out: str | Path) -> Path:
    """Writes a model to the new folder ``out`` and returns the path of its URDF file.

    Each body and each named site becomes a link. Bodies welded to a body with a free joint are part of its link.

    Warns of springs and gravity compensation, for which URDF has no word. Raises ``CannotExpress`` for ball joints, several joints in
    one body and deformable bodies, ``FileExistsError`` if ``out`` exists, ``ValueError`` for a model that MuJoCo does not compile.
    """
    if not isinstance(model, mujoco.MjModel):
        model = mujoco.MjModel.from_xml_path(str(model))
    if left_out := _left_out(model):
        warnings.warn(f"URDF has no word for {left_out}: left out", stacklevel=2)
    robot, meshes = _Urdf(model).robot()
    out = Path(out)
    out.mkdir(parents=True)
    for name, text in meshes.items():
        (out / name).write_text(text)
    ElementTree.indent(robot)
    path = out / "model.urdf"
    path.write_text(ElementTree.tostring(robot, encoding="unicode") + "\n")
    return path


class _Urdf:
    """A model with the name and the origin of each link."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.meshes: dict[str, str] = {}
        self.named: set[str] = set()
        _refuse_what_urdf_lacks(model)
        bodies = range(model.nbody)
        self.links = [self._unused(model.body(i).name or f"body_{i}") for i in bodies]
        self.joints = [model.joint(i).name or f"joint_{i}" for i in range(model.njnt)]
        # MuJoCo rotates a body about a joint's anchor, URDF about the link's origin: positions of the link's frame L in the body's frame B.
        self.p_BL = [model.jnt_pos[model.body_jntadr[i]] if model.body_jntnum[i] else np.zeros(3) for i in bodies]
        self.drivers = _drivers(model)
        self.efforts, self.speeds = _limits_of_actuators(model)
        self.part_of = [self._whole(i) for i in bodies]

    def _unused(self, name: str) -> str:
        while name in self.named:
            name += "_"
        self.named.add(name)
        return name

    def _whole(self, body: int) -> int:
        """The free body of which this one is a rigid part; otherwise itself."""
        root = self.model.body_weldid[body]
        below = np.flatnonzero(self.model.body_rootid == root)
        moves = any(self.model.body_jntnum[it] for it in below if it != root)
        is_free = root and self.model.body_jntnum[root] and _kind(self.model, self.model.body_jntadr[root]) == "free"
        return int(root) if is_free and not moves else body

    def robot(self) -> tuple[Element, dict[str, str]]:
        model = self.model
        name = model.names[: model.names.index(0)].decode()
        robot = Element("robot", name=name or "model")
        for body in range(model.nbody):
            if self.part_of[body] == body:
                self._link(robot, body)
        for body in range(1, model.nbody):
            if self.part_of[body] == body:
                self._joint(robot, body)
        for site in range(model.nsite):
            if model.site(site).name:
                self._site(robot, site)
        return robot, self.meshes

    def _in_link(self, body: int, p_B: np.ndarray, quat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transforms a pose from a body's frame to the frame of its link."""
        p, R = np.array(p_B), _matrix(quat)
        while body != self.part_of[body]:
            R_PB = _matrix(self.model.body_quat[body])
            p, R = self.model.body_pos[body] + R_PB @ p, R_PB @ R
            body = self.model.body_parentid[body]
        return p - self.p_BL[body], R

    def _link(self, robot: Element, link: int) -> None:
        model = self.model
        element = SubElement(robot, "link", name=self.links[link])
        parts = [it for it in range(model.nbody) if self.part_of[it] == link]
        mass, com, moments = self._inertia(parts)
        if mass > 0:
            inertial = SubElement(element, "inertial")
            SubElement(inertial, "origin", xyz=_text(com))
            SubElement(inertial, "mass", value=_text([mass]))
            entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
            SubElement(inertial, "inertia", {name: _text([moments[at]]) for name, at in entries.items()})
        geoms = [it for it in range(model.ngeom) if model.geom_bodyid[it] in parts]
        frictions = [model.geom_friction[it, 0] for it in geoms if _collides(model, it)]
        if any(it != _FRICTION for it in frictions):
            contact = SubElement(element, "contact")
            SubElement(contact, "lateral_friction", value=_text([max(frictions)]))
        for geom in geoms:
            if (shape := self._shape(geom)) is not None:
                holder = SubElement(element, "collision" if _collides(model, geom) else "visual")
                p, R = self._in_link(model.geom_bodyid[geom], model.geom_pos[geom], model.geom_quat[geom])
                _origin(holder, p, R)
                SubElement(holder, "geometry").append(shape)

    def _inertia(self, parts: list[int]) -> tuple[float, np.ndarray, np.ndarray]:
        """Mass, centre of mass in the link's frame, and moments of inertia about it, of all parts of a link."""
        model = self.model
        placed = [(self._in_link(it, model.body_ipos[it], model.body_iquat[it]), it) for it in parts]
        mass = float(sum(model.body_mass[it] for it in parts))
        com = sum(model.body_mass[it] * p for (p, _), it in placed) / (mass or 1.0)
        moments = np.zeros((3, 3))
        for (p, R), it in placed:
            d = p - com
            moments += R @ np.diag(model.body_inertia[it]) @ R.T + model.body_mass[it] * (d @ d * np.eye(3) - np.outer(d, d))
        return mass, com, moments

    def _shape(self, geom: int) -> Element | None:
        size = self.model.geom_size[geom]
        match mujoco.mjtGeom(self.model.geom_type[geom]):
            case mujoco.mjtGeom.mjGEOM_BOX:
                return Element("box", size=_text(2 * size))
            case mujoco.mjtGeom.mjGEOM_SPHERE:
                return Element("sphere", radius=_text(size[:1]))
            case mujoco.mjtGeom.mjGEOM_CYLINDER:
                return Element("cylinder", radius=_text(size[:1]), length=_text(2 * size[1:2]))
            case mujoco.mjtGeom.mjGEOM_CAPSULE:
                return Element("capsule", radius=_text(size[:1]), length=_text(2 * size[1:2]))
            case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
                self.meshes["ellipsoid.obj"] = _obj(*_ball())
                return Element("mesh", filename="ellipsoid.obj", scale=_text(_WIDER * size))
            case mujoco.mjtGeom.mjGEOM_MESH | mujoco.mjtGeom.mjGEOM_SDF:
                return Element("mesh", filename=self._mesh(self.model.geom_dataid[geom]))
        # A plane or a height field is the floor, not part of an arm or a thrown object.
        return None

    def _mesh(self, mesh: int) -> str:
        model = self.model
        file = f"mesh_{mesh}.obj"
        if file not in self.meshes:
            vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
            faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
            self.meshes[file] = _obj(vertices, faces)
        return file

    def _joint(self, robot: Element, body: int) -> None:
        model = self.model
        parent = model.body_parentid[body]
        moves = bool(model.body_jntnum[body])
        index = int(model.body_jntadr[body])
        kind = _kind(model, index) if moves else "fixed"
        limited = moves and bool(model.jnt_limited[index])
        types = {"hinge": "revolute" if limited else "continuous", "slide": "prismatic", "free": "floating"}
        name = self.joints[index] if moves else f"{self.links[body]}_fixed"
        joint = SubElement(robot, "joint", name=name, type=types.get(kind, "fixed"))
        SubElement(joint, "parent", link=self.links[self.part_of[parent]])
        SubElement(joint, "child", link=self.links[body])
        R = _matrix(model.body_quat[body])
        p = model.body_pos[body] + R @ self.p_BL[body] - self.p_BL[parent]
        if kind in ("hinge", "slide"):
            # The model has the pose at the reference position; URDF requires the pose at zero.
            axis, reference = model.jnt_axis[index], model.qpos0[model.jnt_qposadr[index]]
            if kind == "hinge":
                R = R @ _rotation(axis, -reference)
            else:
                p = p - R @ axis * reference
            SubElement(joint, "axis", xyz=_text(axis))
            self._limits(joint, robot, index)
        _origin(joint, p, R)

    def _limits(self, joint: Element, robot: Element, index: int) -> None:
        model = self.model
        limit = {}
        if model.jnt_limited[index]:
            limit["lower"], limit["upper"] = (_text([it]) for it in model.jnt_range[index])
        if index in self.efforts:
            limit["effort"] = _text([self.efforts[index]])
        if index in self.speeds:
            limit["velocity"] = _text([self.speeds[index]])
        if limit:
            SubElement(joint, "limit", limit)
        dof = model.jnt_dofadr[index]
        dynamics = SubElement(joint, "dynamics", damping=_text([model.dof_damping[dof]]))
        if model.dof_frictionloss[dof] > 0:
            dynamics.set("friction", _text([model.dof_frictionloss[dof]]))
        if (driver := self.drivers.get(index)) is not None:
            SubElement(joint, "mimic", joint=driver if isinstance(driver, str) else self.joints[driver])
        if model.dof_armature[dof] > 0:
            # Drake's element; the model's inertia is already reflected to the joint.
            transmission = SubElement(robot, "transmission")
            SubElement(transmission, "joint", name=self.joints[index])
            actuator = SubElement(transmission, "actuator", name=self.joints[index])
            SubElement(actuator, "drake:rotor_inertia", value=_text([model.dof_armature[dof]]))
            SubElement(actuator, "drake:gear_ratio", value="1")
            robot.set("xmlns:drake", "http://drake.mit.edu")

    def _site(self, robot: Element, site: int) -> None:
        model = self.model
        body = model.site_bodyid[site]
        link = self._unused(model.site(site).name)
        SubElement(robot, "link", name=link)
        joint = SubElement(robot, "joint", name=f"{link}_fixed", type="fixed")
        SubElement(joint, "parent", link=self.links[self.part_of[body]])
        SubElement(joint, "child", link=link)
        _origin(joint, *self._in_link(body, model.site_pos[site], model.site_quat[site]))


def _refuse_what_urdf_lacks(model: mujoco.MjModel) -> None:
    for body in range(model.nbody):
        name = model.body(body).name or f"body_{body}"
        if model.body_jntnum[body] > 1:
            raise CannotExpress(f"body {name}: found {model.body_jntnum[body]} joints, expected one: give each joint a body of its own")
        if model.body_jntnum[body] and _kind(model, model.body_jntadr[body]) == "ball":
            raise CannotExpress(f"body {name}: found a ball joint, expected hinges and slides: URDF has no ball joint")
    if model.nflex:
        raise CannotExpress(f"found {model.nflex} deformable bodies, expected rigid ones: URDF has no flex")


def _left_out(model: mujoco.MjModel) -> str:
    """Springs and gravity compensation, by the names of their joints and bodies."""
    joints, bodies = np.flatnonzero(model.jnt_stiffness), np.flatnonzero(model.body_gravcomp)
    named = {"stiffness": [model.joint(it).name or f"joint_{it}" for it in joints], "gravcomp": [model.body(it).name or f"body_{it}" for it in bodies]}
    return "; ".join(f"{what} of {', '.join(names)}" for what, names in named.items() if names)


def _drivers(model: mujoco.MjModel) -> dict[int, int | str]:
    """Dependent joints, each with the joint, or the name of the constraint, that drives it."""
    drivers: dict[int, int | str] = {}
    for equality in np.flatnonzero(model.eq_active0):
        one, other = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        kind = mujoco.mjtEq(model.eq_type[equality])
        name = model.equality(equality).name or f"equality_{equality}"
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            drivers[one] = other if other >= 0 else name
        elif kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
                one, other = (int(model.site_bodyid[it]) for it in (one, other))
            for joint in _between(model, one, other):
                drivers.setdefault(joint, name)
    for tendon in range(model.ntendon):
        wraps = range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        first, *others = [int(model.wrap_objid[it]) for it in wraps if model.wrap_type[it] == mujoco.mjtWrap.mjWRAP_JOINT] or [-1]
        for joint in others:
            drivers.setdefault(joint, first)
    return drivers


def _between(model: mujoco.MjModel, one: int, other: int) -> Iterator[int]:
    """Joints between two bodies: those of a loop that a constraint closes."""
    above = [_ancestors(model, it) for it in (one, other)]
    for body in set(above[0]) ^ set(above[1]):
        if model.body_jntnum[body]:
            yield int(model.body_jntadr[body])


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    bodies = [body]
    while bodies[-1]:
        bodies.append(int(model.body_parentid[bodies[-1]]))
    return bodies


def _limits_of_actuators(model: mujoco.MjModel) -> tuple[dict[int, float], dict[int, float]]:
    """Highest efforts and speeds in the model, by joint; the least of several."""
    efforts: dict[int, list[float]] = {}
    speeds: dict[int, list[float]] = {}
    for joint in np.flatnonzero(model.jnt_actfrclimited):
        efforts.setdefault(int(joint), []).append(_least(model.jnt_actfrcrange[joint]))
    of_joints = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    for actuator in range(model.nu):
        if mujoco.mjtTrn(model.actuator_trntype[actuator]) not in of_joints:
            continue
        joint, gear = int(model.actuator_trnid[actuator, 0]), abs(float(model.actuator_gear[actuator, 0]))
        gain, (_, stiffness, damping) = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator, :3]
        is_limited = bool(model.actuator_ctrllimited[actuator])
        is_direct = model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
        has_bias = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
        if model.actuator_forcelimited[actuator]:
            efforts.setdefault(joint, []).append(_least(model.actuator_forcerange[actuator]) * gear)
        if is_limited and is_direct and not has_bias:
            efforts.setdefault(joint, []).append(_least(model.actuator_ctrlrange[actuator]) * gear * abs(gain))
        # A velocity servo: its control is a speed.
        if is_limited and is_direct and has_bias and stiffness == 0 and damping == -gain and gear:
            speeds.setdefault(joint, []).append(_least(model.actuator_ctrlrange[actuator]) / gear)
    least = lambda stated: {joint: min(values) for joint, values in stated.items() if min(values) > 0}
    return least(efforts), least(speeds)


def _least(bounds: np.ndarray) -> float:
    """The magnitude allowed in both directions."""
    return float(np.abs(bounds).min())


def _kind(model: mujoco.MjModel, joint: int) -> str:
    return mujoco.mjtJoint(model.jnt_type[joint]).name.removeprefix("mjJNT_").lower()


def _collides(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def _matrix(quat: np.ndarray) -> np.ndarray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, dtype=float))
    return matrix.reshape(3, 3)


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    quat = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quat, axis, angle)
    return _matrix(quat)


def _origin(parent: Element, p: np.ndarray, R: np.ndarray) -> None:
    yaw = np.arctan2(R[1, 0], R[0, 0])
    # The rest is Ry(pitch) Rx(roll), exact also where roll and yaw rotate about one axis.
    left = _rotation(np.array([0.0, 0.0, 1.0]), -yaw) @ R
    pitch, roll = np.arctan2(-left[2, 0], left[0, 0]), np.arctan2(-left[1, 2], left[1, 1])
    parent.insert(0, Element("origin", xyz=_text(p), rpy=_text([roll, pitch, yaw])))


def _text(values: np.ndarray | list[float]) -> str:
    return " ".join(repr(float(it) + 0.0) for it in values)


def _obj(vertices: np.ndarray, faces: np.ndarray) -> str:
    lines = [f"v {_text(it)}" for it in vertices]
    return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in np.asarray(faces) + 1)]) + "\n"


def _ball() -> tuple[np.ndarray, np.ndarray]:
    """A ball of radius 1: its poles and circles of latitude."""
    n, around = _SEGMENTS, 2 * _SEGMENTS
    latitude, longitude = np.meshgrid(np.pi * np.arange(1, n) / n, np.pi * np.arange(around) / n, indexing="ij")
    circles = np.stack([np.sin(latitude) * np.cos(longitude), np.sin(latitude) * np.sin(longitude), np.cos(latitude)], -1)
    vertices = np.vstack([circles.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    top, bottom = len(vertices) - 2, len(vertices) - 1
    faces = []
    for i in range(around):
        j = (i + 1) % around
        faces += [(top, i, j), (bottom, (n - 2) * around + j, (n - 2) * around + i)]
        for row in range(0, (n - 2) * around, around):
            faces += [(row + i, row + around + i, row + around + j), (row + i, row + around + j, row + j)]
    return vertices, np.array(faces)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m catchingbot.mujoco", description="Writes a MuJoCo model as URDF, for imports.")
    parser.add_argument("file", metavar="FILE", type=Path, help="a model (MJCF) of an arm or an object")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder for model.urdf and meshes; it must not exist yet")
    arguments = parser.parse_args()
    if arguments.out.exists():
        parser.error(f"--out: found `{arguments.out}`, expected a folder that does not exist yet")
    try:
        model = mujoco.MjModel.from_xml_path(str(arguments.file))
        with warnings.catch_warnings(record=True) as notes:
            warnings.simplefilter("always")
            path = convert(model, arguments.out)
    except ValueError as fault:
        print(f"error: {arguments.file}: {fault}", file=sys.stderr)
        return 2
    for note in notes:
        print(f"warning: {arguments.file}: {note.message}", file=sys.stderr)
    is_arm = any(_kind(model, it) == "hinge" for it in range(model.njnt))
    name = "my_arm" if is_arm else "my_object"
    print(f"{path}\nnext: catchingbot {'robot' if is_arm else 'object'} import {shlex.quote(str(path))} --out {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
