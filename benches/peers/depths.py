"""Depth images: MuJoCo's rays through the same pixels of the same scenes."""

import mujoco
import numpy as np
from measure import measured, problems, write

# Geoms that cameras see.
SEEN = np.array([0, 1, 0, 0, 0, 0], np.uint8)
FARTHEST_M = 100.0


def rays_of(camera: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origin of the rays, unit vectors in the world, and their parts along the optical axis."""
    X_WC, (width, height) = np.array(camera["X_WC"]), camera["size_px"]
    v, u = np.mgrid[:height, :width] + 0.5
    x, y = ((of - middle).ravel() / camera["focal_px"] for of, middle in zip([u, v], camera["principal_px"], strict=True))
    rays = np.stack([x, y, np.ones_like(x)])
    rays /= np.linalg.norm(rays, axis=0)
    return X_WC[:3, 3].copy(), np.ascontiguousarray((X_WC[:3, :3] @ rays).T), rays[2].copy()


def cast(scene: str, cameras: list[dict]) -> tuple[np.ndarray, float]:
    """Depths of all pixels, and the time that the rays took."""
    model = mujoco.MjModel.from_xml_path(scene)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    of_camera = [(*rays_of(it), *(np.zeros(np.prod(it["size_px"]), kind) for kind in (np.int32, np.float64))) for it in cameras]

    def all_rays() -> None:
        for origin, rays, along, geom, far in of_camera:
            mujoco.mj_multiRay(model, data, origin, rays.ravel(), SEEN, 1, -1, geom, far, None, len(along), FARTHEST_M)

    _, time_s = measured(all_rays)
    return np.concatenate([np.where(geom >= 0, far * along, np.nan) for *_, along, geom, far in of_camera]), time_s


def row(renderer: str, cameras: list[dict], depths: np.ndarray, time_s: float, compared: list) -> list:
    seen, size = int(np.isfinite(depths).sum()), "×".join(map(str, cameras[0]["size_px"]))
    return [f"{len(cameras)} of {size}", renderer, len(depths), seen, *compared, 1e-6 * len(depths) / time_s, 1e-6 * seen / time_s]


rows = []
for it in problems():
    cameras, ours, (theirs, time_s) = it["cameras"], np.fromfile(it["depths"], np.float32), cast(it["scene"], it["cameras"])
    both = np.isfinite(ours) & np.isfinite(theirs)
    one = int((np.isfinite(ours) | np.isfinite(theirs)).sum() - both.sum())
    median_mm, most_mm = (float(np.quantile(1e3 * np.abs(ours - theirs)[both], at)) for at in (0.5, 0.99))
    rows.append(row("ours", cameras, ours, it["time_s"], [None] * 3))
    rows.append(row("MuJoCo, mj_multiRay", cameras, theirs, time_s, [median_mm, most_mm, one]))
columns = ["cameras", "renderer", "pixels", "pixels with a depth", "median difference, mm", "99 %, mm", "pixels with a depth in one alone"]
write(("Depth images: the first instant of a throw of `paper`", [*columns, "10⁶ pixels/s", "10⁶ pixels with a depth/s"], rows))
