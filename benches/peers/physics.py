"""Physics: MuJoCo steps the same scene, its arm held against gravity."""


import mujoco
import numpy as np
from measure import measured, problems, write

it = problems()
dof, q = it["dof"], np.array(it["q"])
model = mujoco.MjModel.from_xml_path(it["scene"])
data = mujoco.MjData(model)
substeps = round(it["step_ms"] * 1e-3 / model.opt.timestep)


def thrown(until_s: float, integrator: mujoco.mjtIntegrator) -> np.ndarray:
    """Where the object is after a throw."""
    model.opt.integrator = integrator
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(round(until_s * 1e3 / it["step_ms"])):
        # Held where it is: gravity is balanced, and springs keep the posture.
        data.qfrc_applied[:dof] = data.qfrc_bias[:dof] + 400 * (q - data.qpos[:dof]) - 40 * data.qvel[:dof]
        mujoco.mj_step(model, data, substeps)
    return data.body("object").xpos.copy()


rows = [["ours", it["step_ms"], it["contact_s"], None, it["until_s"] / it["time_s"]]]
for name, integrator in [("MuJoCo, Euler", mujoco.mjtIntegrator.mjINT_EULER), ("MuJoCo, Runge–Kutta", mujoco.mjtIntegrator.mjINT_RK4)]:
    _, time_s = measured(lambda integrator=integrator: thrown(it["until_s"], integrator))
    off_mm = 1e3 * np.linalg.norm(thrown(it["compared_s"], integrator) - it["p_WO"])
    rows.append([name, 1e3 * model.opt.timestep, None, f"{off_mm:.1e}", it["until_s"] / time_s])
columns = ["engine", "step, ms", "first contact, s", f"object after {it['compared_s']} s, mm from ours", "simulated s per CPU s"]
write((f"Physics: a throw of `paper` for {it['until_s']} s, no images, no brain", columns, rows))
