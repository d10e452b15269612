"""Dynamics and kinematics: Pinocchio and Drake at the same states."""

import numpy as np
import pinocchio as pin
from measure import measured, problems, write
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, MultibodyForces

it = problems()
states, torques = [[np.array(part) for part in state] for state in it["states"]], [np.array(row) for row in it["torques_nm"]]
X_LG, inertias = np.array(it["X_LG"]), np.array(it["rotor_inertia_kgm2"])
Q, DQ, DDQ, TAU = (np.asfortranarray(np.transpose(rows)) for rows in [*zip(*states, strict=True), torques])


def pinocchio() -> list[tuple]:
    """Torques and accelerations in batches, poses one by one; each with the time of all in seconds."""
    model = pin.buildModelFromUrdf(it["urdf"])
    model.armature, damping = inertias, model.damping[:, None] * DQ
    model.damping[:] = 0
    frame = model.addFrame(pin.Frame("grip", model.njoints - 1, 0, pin.SE3(X_LG), pin.FrameType.OP_FRAME))
    pool, result = pin.ModelPool(model, 1), np.zeros_like(Q)
    _, inverse_s = measured(lambda: pin.rneaInParallel(1, pool, Q, DQ, DDQ, result))
    inverse, driving = (result + damping).T, TAU - damping
    _, forward_s = measured(lambda: pin.abaInParallel(1, pool, Q, DQ, driving, result))

    def poses(model: pin.Model, frame: int) -> list:
        data, size = model.createData(), model.nq
        return [pin.updateFramePlacement(model, data, frame).homogeneous for q, *_ in states if pin.forwardKinematics(model, data, q[:size]) is None]

    (found, kinematics_s), (_, calls_s) = measured(lambda: poses(model, frame)), measured(lambda: poses(pin.Model(), 0))
    return [(inverse, inverse_s), (result.T, forward_s), (found, kinematics_s - calls_s)]


def plant_of(urdf: str | None) -> tuple:
    """A plant with an arm or without, and the gripper's frame."""
    plant, gripper = MultibodyPlant(0.0), None
    if urdf:
        (arm,) = Parser(plant).AddModels(urdf)
        plant.WeldFrames(plant.world_frame(), plant.get_body(plant.GetBodyIndices(arm)[0]).body_frame())
        joints = [plant.get_joint(i) for i in plant.GetJointIndices(arm) if plant.get_joint(i).num_positions() == 1]
        for joint, inertia in zip(joints, inertias, strict=True):
            actuator = plant.AddJointActuator(joint.name(), joint)
            actuator.set_default_rotor_inertia(inertia)
            actuator.set_default_gear_ratio(1.0)
        gripper = plant.AddFrame(FixedOffsetFrame("grip", joints[-1].child_body().body_frame(), RigidTransform(X_LG)))
    plant.Finalize()
    return plant, gripper or plant.world_frame()


def drake(urdf: str | None) -> list[tuple]:
    """Torques, accelerations and poses one by one; each with the time of all in seconds."""
    plant, gripper = plant_of(urdf)
    context, forces, size = plant.CreateDefaultContext(), MultibodyForces(plant), plant.num_positions()
    applied, accelerations = plant.get_applied_generalized_force_input_port(), plant.get_generalized_acceleration_output_port()

    def inverse(q, dq, ddq, _):
        plant.SetPositionsAndVelocities(context, np.r_[q, dq][: 2 * size])
        plant.CalcForceElementsContribution(context, forces)
        return plant.CalcInverseDynamics(context, ddq[:size], forces)

    def forward(q, dq, _, tau):
        plant.SetPositionsAndVelocities(context, np.r_[q, dq][: 2 * size])
        applied.FixValue(context, tau[:size])
        return accelerations.Eval(context)

    def pose(q, *_):
        plant.SetPositions(context, q[:size])
        return gripper.CalcPoseInWorld(context).GetAsMatrix4()

    return [measured(lambda work=work: [work(*state, tau) for state, tau in zip(states, torques, strict=True)]) for work in [inverse, forward, pose]]


ours = [it["torques_nm"], it["accelerations_radps2"], it["X_WG"]]
of_drake = [(found, s - calls_s) for (found, s), (_, calls_s) in zip(drake(it["urdf"]), drake(None), strict=True)]
solvers = {"ours": [(found, us * 1e-6 * len(states)) for found, us in zip(ours, it["time_us"], strict=True)], "Pinocchio": pinocchio(), "Drake": of_drake}
rows = []
for k, (work, unit) in enumerate([("inverse dynamics", "N·m"), ("forward dynamics", "rad/s²"), ("forward kinematics", "m, 1")]):
    for name, results in solvers.items():
        found, s = results[k]
        how = "library" if name == "ours" else "batch" if name == "Pinocchio" and k < 2 else "calls"
        rows.append([work, name, how, f"{np.abs(np.array(found) - ours[k]).max():.0e}" if name != "ours" else None, unit, 1e6 * s / len(states)])
write(("Dynamics and kinematics of the iiwa 14 at 1,000 random states", ["work", "library", "measured as", "largest difference from ours", "unit", "µs a call"], rows))
