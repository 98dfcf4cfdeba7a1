"""Fit the capsules of ``motm_twin/model/arm_kernels.py`` to the collision hulls; prints the table.

Each hull is cut by the plane that makes the two capsules round its halves smallest. A capsule is convex, so capsules
that contain the corners of both halves contain the whole hull. Run it from the
repository: ``PYTHONPATH=. python tools/fit_capsules.py``.
"""

import numpy as np
import trimesh
from scipy.optimize import minimize

from motm_twin.model.assets import collision_hull
from motm_twin.model.geometry import Array

MARGIN = 0.0005  # [m] added to every radius before rounding to 0.1 mm
PARTS = {**{f"panda_link{i}": 2 for i in range(1, 7)}, "panda_link7": 1, "panda_hand": 2}


def capsule(points: Array, tries: int = 3) -> tuple[float, Array, float]:
    """Volume [m^3], end points (6,) and radius [m] of a small capsule round points (n, 3)."""

    def radius(x: Array) -> float:
        axis = x[3:] - x[:3]
        along = np.clip((points - x[:3]) @ axis / (axis @ axis + 1e-12), 0.0, 1.0)
        return float(np.linalg.norm(points - x[:3] - along[:, None] * axis, axis=1).max())

    def volume(x: Array) -> float:
        r = radius(x)
        return float(np.pi * r * r * np.linalg.norm(x[3:] - x[:3]) + 4.0 / 3.0 * np.pi * r**3)

    centre, axes = points.mean(axis=0), np.linalg.svd(points - points.mean(axis=0))[2]
    best = None
    for k in range(tries):
        x = np.concatenate([centre - 0.05 * axes[k % 3], centre + 0.05 * axes[k % 3]])
        for _ in range(3 if tries > 1 else 1):
            x = minimize(lambda x: 1e3 * volume(x), x, method="Nelder-Mead", options={"adaptive": True}).x
        if best is None or volume(x) < best[0]:
            best = volume(x), x, radius(x)
    assert best is not None
    return best


def halves(hull: trimesh.Trimesh) -> list[Array]:
    """Corners of the two parts of a hull, cut where their capsules together are smallest."""
    best: tuple[float, list[Array]] = (np.inf, [])
    for normal in (*np.eye(3), *np.linalg.svd(hull.vertices - hull.vertices.mean(axis=0))[2]):
        heights = hull.vertices @ normal
        for share in np.linspace(0.15, 0.85, 8):
            origin = normal * (heights.min() + share * np.ptp(heights))
            parts = [hull.slice_plane(origin, side * normal).convex_hull.vertices for side in (1.0, -1.0)]
            total = sum(capsule(part, tries=1)[0] for part in parts)
            if total < best[0]:
                best = total, parts
    return best[1]


def main() -> None:
    """Print one row per capsule: link, end points [m], radius [m]."""
    for link, count in PARTS.items():
        hull = trimesh.Trimesh(*collision_hull(link)).convex_hull
        for part in [hull.vertices] if count == 1 else halves(hull):
            _, x, r = capsule(part, tries=6)
            ends = ", ".join(f"{value + 0.0:.4f}" for value in x)
            print(f'    ("{link}", {ends}, {r + MARGIN:.4f}),')


if __name__ == "__main__":
    main()
