"""Models as MuJoCo compiles them against the URDF that is made of them, and what the program imports of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")
from catchingbot.mujoco import CannotExpress, convert  # noqa: E402

MASSES = {f"link_{i}": mass for i, mass in enumerate([4.1, 5.2, 3.3, 1.7, 1.1, 0.4], 1)}
# An arm of six joints; what is in braces differs from model to model.
ARM = """<mujoco model="testarm"><compiler angle="radian" {compiler}/>{default}{asset}
<worldbody><light pos="0 0 3"/><geom type="plane" size="2 2 .1"/><body name="link_0"><geom type="box" size=".05 .05 .05"/>
<body name="link_1" pos="0 0 0.21" quat="0.98877 0 0 0.14944">{m1}<joint name="joint_1" axis="0 0 1" range="-2.9 2.8"/>{g}
<body name="link_2" pos="0.03 0 0.12" quat="0.995 0.0998 0 0">{m2}<joint name="joint_2" axis="0 1 0" range="-1.9 2.1" {joint}/>{g}
<body name="link_3" pos="0 0.02 0.42" quat="0.99875 0 0.05 0">{m3}<joint name="joint_3" axis="0 1 0" range="-2.4 2.3"/>{geom}
{open}<body name="link_4" pos="0.02 0 0.11" quat="0.98 0 0 0.1987">{m4}<joint name="joint_4" axis="1 0 0" {range4}/>{g}
<body name="link_5" pos="0.33 0 0" quat="0.99376 0.0497 0.0997 -0.005">{m5}<joint name="joint_5" axis="0 1 0" range="-2 2"/>{g}
<body name="link_6" pos="0.08 0 0">{m6}<joint name="joint_6" axis="1 0 0" range="-3.1 3.1"/>{g}{hand}<site name="tool" pos="0.06 0 0"/>
</body></body></body>{close}</body></body></body></body></worldbody>{actuator}</mujoco>"""
CAPSULE = '<geom type="capsule" size="0.04" fromto="0 0 0 0 0 0.1"/>'
BOX = " ".join(f"{x} {y} {z}" for x in (-0.03, 0.03) for y in (-0.025, 0.025) for z in (-0.045, 0.045))
MESH = f'<asset><mesh name="m" vertex="{BOX}" refpos="0.5 0 0" refquat="0.7071068 0 0.7071068 0"/></asset>'


def arm(**parts: str) -> str:
    given = {f"m{i}": f'<inertial pos="0.01 {0.004 * i} 0.03" mass="{mass}" diaginertia="{mass * 0.011} {mass * 0.009} {mass * 0.007}"/>' for i, mass in enumerate(MASSES.values(), 1)}
    empty = dict.fromkeys(["compiler", "default", "asset", "joint", "open", "close", "hand", "actuator"], "")
    whole = {**given, **empty, "g": CAPSULE, "geom": CAPSULE, "range4": 'range="-3 3"', **parts}
    return ARM.format(**whole)


ARMS = {
    "plain": arm(),
    "two default sections": arm(default='<default><joint armature="0.2"/></default><default class="main"><joint range="-1.1 1.1" damping="3"/></default>', range4=""),
    "frame": arm(open='<frame pos="0.05 0 0.1" euler="0 0.2 0.5">', close="</frame>"),
    "masses of geoms": arm(**{f"m{i}": "" for i in range(1, 7)}, g='<geom type="box" size="0.04 0.04 0.08" mass="1.7"/>'),
    "density of a class": arm(m3="", default='<default><geom density="800"/></default>'),
    "reference": arm(joint='ref="0.7" pos="0.01 -0.02 0.03"'),
    "order of Euler's angles": arm(compiler='eulerseq="zyx"', open='<frame euler="0.3 0.2 0.5">', close="</frame>"),
    "class of actuators": arm(
        default='<default><default class="a"><general forcerange="-30 40"/></default></default>',
        actuator="<actuator>" + "".join(f'<position class="a" joint="joint_{i}" kp="100" gear="2"/>' for i in range(1, 7)) + "</actuator>",
    ),
    "from to": arm(geom='<geom type="box" size="0.05" fromto="0 0 0 0 0 0.4"/><geom type="ellipsoid" size="0.03" fromto="0 0 0 0 0 0.3"/>'),
    "inertia from geoms": arm(compiler='inertiafromgeom="true" settotalmass="30"'),
    "replicated fingers": arm(hand='<replicate count="2" offset="0 0.05 0"><body name="f"><joint name="fj" type="slide" range="0 0.04"/><geom size="0.01"/></body></replicate>'),
    "mesh with a reference pose": arm(asset=MESH, geom='<geom type="mesh" mesh="m" pos="0.1 0 0"/>'),
}


def random_chain(seed: int) -> str:
    """A chain of hinges and a slide, each anchored, turned and referenced at random, with a branch and geoms of all kinds."""
    rng = np.random.default_rng(seed)
    numbers = lambda n, width=1.0: " ".join(f"{it:.6f}" for it in rng.uniform(-width, width, n))
    body = ""
    for i in reversed(range(int(rng.integers(3, 8)))):
        kind, sizes = [("box", 3), ("sphere", 1), ("cylinder", 2), ("capsule", 2), ("ellipsoid", 3)][int(rng.integers(5))]
        size = " ".join(f"{it:.4f}" for it in rng.uniform(0.02, 0.06, sizes))
        type_ = "slide" if rng.random() < 0.15 else "hinge"
        shown = 'contype="0" conaffinity="0"' if rng.random() < 0.3 else ""
        branch = f'<body name="branch_{i}" pos="{numbers(3, 0.1)}" euler="{numbers(3)}"><geom size="0.02" mass="0.2"/></body>'
        body = (
            f'<body name="body_{i}_" pos="{numbers(3, 0.3)}" euler="{numbers(3, 3)}">'
            f'<joint name="j{i}" type="{type_}" axis="{numbers(3)}" pos="{numbers(3, 0.1)}" ref="{numbers(1)}" range="-{1 + i / 9} 2"/>'
            f'<geom type="{kind}" size="{size}" pos="{numbers(3, 0.1)}" euler="{numbers(3, 3)}" density="{500 + 100 * i}" {shown}/>'
            f'{branch if rng.random() < 0.5 else ""}<site name="s{i}" pos="{numbers(3, 0.1)}" euler="{numbers(3)}"/>{body}</body>'
        )
    return f'<mujoco><compiler angle="radian"/><worldbody>{body}</worldbody></mujoco>'


class Urdf:
    """A URDF file as its specification reads it."""

    def __init__(self, path: Path) -> None:
        self.root = ElementTree.parse(path).getroot()
        self.folder = path.parent
        self.links = {it.get("name"): it for it in self.root.iter("link")}
        self.joints = {it.find("child").get("link"): it for it in self.root.findall("joint")}

    def pose(self, link: str, q: dict[str, float]) -> np.ndarray:
        if (joint := self.joints.get(link)) is None:
            return np.eye(4)
        X = self.pose(joint.find("parent").get("link"), q) @ origin(joint)
        moved = np.eye(4)
        if joint.get("name") in q and joint.get("type") != "fixed":
            axis, at = numbers(joint.find("axis"), "xyz"), q[joint.get("name")]
            if joint.get("type") == "prismatic":
                moved[:3, 3] = axis * at
            else:
                moved[:3, :3] = turned(axis, at)
        return X @ moved

    def mass(self, link: str) -> float:
        inertial = self.links[link].find("inertial")
        return 0.0 if inertial is None else float(inertial.find("mass").get("value"))

    def limit(self, joint: str, name: str) -> float | None:
        limit = next(it for it in self.joints.values() if it.get("name") == joint).find("limit")
        return None if limit is None or limit.get(name) is None else float(limit.get(name))


def numbers(element: ElementTree.Element | None, name: str) -> np.ndarray:
    return np.array([float(it) for it in element.get(name, "0 0 0").split()])


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def origin(element: ElementTree.Element) -> np.ndarray:
    X = np.eye(4)
    if (of := element.find("origin")) is not None:
        roll, pitch, yaw = numbers(of, "rpy")
        x, y, z = np.eye(3)
        X[:3, :3] = turned(z, yaw) @ turned(y, pitch) @ turned(x, roll)
        X[:3, 3] = numbers(of, "xyz")
    return X


def whole_inertia(urdf: Urdf, link: str, q: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass in the world, and moments about it along its axes."""
    inertial = urdf.links[link].find("inertial")
    X = urdf.pose(link, q) @ origin(inertial)
    get = lambda name: float(inertial.find("inertia").get(name))
    I = np.array([[get("ixx"), get("ixy"), get("ixz")], [get("ixy"), get("iyy"), get("iyz")], [get("ixz"), get("iyz"), get("izz")]])
    return X[:3, 3], X[:3, :3] @ I @ X[:3, :3].T


def compare(text: str, folder: Path) -> None:
    model = mujoco.MjModel.from_xml_string(text)
    urdf = Urdf(convert(model, folder / "model"))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(1)
    for _ in range(5):
        data.qpos = rng.uniform(-2, 2, model.nq)
        mujoco.mj_forward(model, data)
        q = {model.joint(i).name: data.qpos[model.jnt_qposadr[i]] for i in range(model.njnt)}
        shapes = {link: [] for link in urdf.links}
        for i in range(1, model.nbody):
            link = model.body(i).name
            assert urdf.mass(link) == pytest.approx(model.body_mass[i], rel=1e-12)
            com, moments = whole_inertia(urdf, link, q)
            R = data.ximat[i].reshape(3, 3)
            np.testing.assert_allclose(com, data.xipos[i], atol=1e-9)
            np.testing.assert_allclose(moments, R @ np.diag(model.body_inertia[i]) @ R.T, atol=1e-9)
            np.testing.assert_allclose(urdf.pose(link, q)[:3, :3], data.xmat[i].reshape(3, 3), atol=1e-9)
        for i in range(model.nsite):
            X = urdf.pose(model.site(i).name, q)
            np.testing.assert_allclose(X[:3, 3], data.site_xpos[i], atol=1e-9)
            np.testing.assert_allclose(X[:3, :3], data.site_xmat[i].reshape(3, 3), atol=1e-9)
        for link, element in urdf.links.items():
            shapes[link] = [urdf.pose(link, q) @ origin(it) for it in [*element.findall("collision"), *element.findall("visual")]]
        for i in range(model.ngeom):
            if model.geom_type[i] != mujoco.mjtGeom.mjGEOM_PLANE:
                of_link = shapes[model.body(model.geom_bodyid[i]).name]
                assert min(np.abs(X[:3, 3] - data.geom_xpos[i]).max() for X in of_link) < 1e-9
    for i in range(model.njnt):
        name = model.joint(i).name
        assert [urdf.limit(name, "lower"), urdf.limit(name, "upper")] == pytest.approx(list(model.jnt_range[i]))


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_is_as_mujoco_has_it(name, tmp_path):
    compare(ARMS[name], tmp_path)


@pytest.mark.parametrize("seed", range(40))
def test_a_random_chain_is_as_mujoco_has_it(seed, tmp_path):
    compare(random_chain(seed), tmp_path)


def test_actuators_state_limits(tmp_path):
    text = arm(
        joint='actuatorfrcrange="-12 14"',
        actuator='<actuator><motor joint="joint_1" ctrlrange="-2 3" gear="50"/><position joint="joint_2" kp="9" forcerange="-20 20"/>'
        '<velocity joint="joint_3" kv="5" ctrlrange="-1.5 1.5" gear="0.5"/><general joint="joint_4" ctrlrange="-3 3" gainprm="7"/>'
        '<position joint="joint_5" kp="5" ctrlrange="-1 1"/></actuator>',
    )
    (tmp_path / "arm.xml").write_text(text)
    urdf = Urdf(convert(tmp_path / "arm.xml", tmp_path / "out"))
    efforts = [urdf.limit(f"joint_{i}", "effort") for i in range(1, 7)]
    assert efforts == [100, 12, None, 21, None, None]
    assert [urdf.limit(f"joint_{i}", "velocity") for i in range(1, 7)] == [None, None, 3, None, None, None]


def test_what_urdf_has_no_word_for_is_warned_of(tmp_path):
    text = arm(joint='frictionloss="0.7" stiffness="3"').replace('name="link_4"', 'name="link_4" gravcomp="1"')
    with pytest.warns(UserWarning, match="stiffness of joint_2; gravcomp of link_4: left out"):
        urdf = Urdf(convert(mujoco.MjModel.from_xml_string(text), tmp_path / "model"))
    assert [it.find("dynamics").get("friction") for it in urdf.joints.values() if it.find("dynamics") is not None].count("0.7") == 1


def imported(program: Path, kind: str, model: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """The command that the program names, then the program."""
    refused = subprocess.run([program, kind, "import", model, "--out", folder / "out"], capture_output=True, text=True, check=False)
    assert refused.returncode == 2 and "`python -m catchingbot.mujoco " in refused.stderr, refused.stderr
    subprocess.run([sys.executable, "-m", "catchingbot.mujoco", model, "--out", folder / "model"], check=True)
    more = ["--no-ready"] if kind == "robot" else []
    return subprocess.run([program, kind, "import", folder / "model/model.urdf", "--out", folder / "out", *more], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["two default sections", "frame", "reference", "class of actuators", "inertia from geoms", "replicated fingers"])
def test_the_program_imports_the_arm(name, program, tmp_path):
    model_file = tmp_path / "arm.xml"
    model_file.write_text(ARMS[name])
    run = imported(program, "robot", model_file, tmp_path)
    assert run.returncode == 0, run.stderr
    model = mujoco.MjModel.from_xml_path(str(model_file))
    data = mujoco.MjData(model)
    arm_, robot_toml = Urdf(tmp_path / "out/robot.urdf"), (tmp_path / "out/robot.toml").read_text()
    q = dict(zip([f"joint_{i}" for i in range(1, 7)], [0.3, -0.4, 0.5, -0.6, 0.7, -0.8], strict=True))
    for joint, at in q.items():
        data.joint(joint).qpos = at
    mujoco.mj_forward(model, data)
    for link in MASSES:
        body = data.body(link)
        assert arm_.mass(link) == pytest.approx(model.body(link).mass[0])
        np.testing.assert_allclose(whole_inertia(arm_, link, q)[0], body.xipos, atol=1e-9)
    for joint in q:
        assert [arm_.limit(joint, "lower"), arm_.limit(joint, "upper")] == pytest.approx(list(model.joint(joint).range))
    if name == "two default sections":
        assert robot_toml.count("rotor_inertia_kgm2 = 0.2") == 6
    if name == "class of actuators":
        assert [arm_.limit(joint, "effort") for joint in q] == [60] * 6
    assert ("taken off               f0, f1" in run.stdout) == (name == "replicated fingers")


OBJECTS = {
    "ellipsoid": ('<geom type="ellipsoid" size="0.02 0.03 0.06" mass="0.2"/>', 0.2, [0.04, 0.06, 0.12]),
    "density": ('<geom type="box" size="0.03 0.02 0.05" density="250"/>', 0.06, [0.06, 0.04, 0.1]),
    "two boxes": ('<geom type="box" size="0.02 0.02 0.015" mass="0.1"/><frame pos="0.04 0 0"><geom type="box" size="0.02 0.01 0.01" mass="0.05"/></frame>', 0.15, [0.08, 0.04, 0.03]),
    "vertices": ('<geom type="mesh" mesh="m" mass="0.1"/>', 0.1, [0.09, 0.05, 0.06]),
    "welded parts": ('<geom type="box" size="0.02 0.02 0.02" mass="0.1"/><body pos="0.04 0 0" euler="0 0 90"><geom type="box" size="0.02 0.02 0.02" mass="0.05"/></body>', 0.15, [0.08, 0.04, 0.04]),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_the_program_imports_the_object(name, program, tmp_path):
    geoms, mass, size = OBJECTS[name]
    model_file = tmp_path / "thing.xml"
    model_file.write_text(f'<mujoco>{MESH}<worldbody><body name="thing" pos="1 2 3"><freejoint/>{geoms}</body></worldbody></mujoco>')
    run = imported(program, "object", model_file, tmp_path)
    assert run.returncode == 0, run.stderr
    data = mujoco.MjData(model := mujoco.MjModel.from_xml_path(str(model_file)))
    mujoco.mj_forward(model, data)
    vertices = np.array([line.split()[1:] for line in (tmp_path / "out/out.obj").read_text().splitlines() if line.startswith("v ")], float)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), size, atol=4e-4)
    truth = dict(line.split(" = ", 1) for line in (tmp_path / "out/truth.toml").read_text().splitlines() if " = " in line)
    assert float(truth["mass_kg"]) == pytest.approx(mass)
    com = np.array([float(it) for it in truth["com_m"].strip("[]").split(",")])
    np.testing.assert_allclose(com, data.subtree_com[1] - data.xpos[1], atol=1e-6)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (arm(joint='type="ball"').replace('axis="0 1 0" range="-1.9 2.1" ', ""), "body link_2: found a ball joint"),
        (arm(geom=CAPSULE + '<joint name="more"/>'), "body link_3: found 2 joints"),
    ],
)
def test_what_an_arm_file_cannot_say_is_refused(text, expected, tmp_path):
    (tmp_path / "arm.xml").write_text(text)
    command = [sys.executable, "-m", "catchingbot.mujoco", tmp_path / "arm.xml", "--out", tmp_path / "out"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr.count("\n")) == (2, 1) and expected in run.stderr, run.stderr
    assert not (tmp_path / "out").exists()
    with pytest.raises(CannotExpress, match=expected):
        convert(tmp_path / "arm.xml", tmp_path / "out")


@pytest.mark.parametrize(
    "coupling",
    [
        '<equality><joint joint1="joint_4" joint2="joint_3" polycoef="0 1 0 0 0"/></equality>',
        '<tendon><fixed><joint joint="joint_3" coef="1"/><joint joint="joint_4" coef="-1"/></fixed></tendon>',
        '<equality><connect body1="link_4" body2="link_2" anchor="0 0 0"/></equality>',
    ],
)
def test_joints_that_others_drive_are_no_arm(coupling, program, tmp_path):
    model_file = tmp_path / "arm.xml"
    model_file.write_text(arm(actuator=coupling))
    run = imported(program, "robot", model_file, tmp_path)
    assert run.returncode == 2 and "found a joint that another drives" in run.stderr, run.stderr
