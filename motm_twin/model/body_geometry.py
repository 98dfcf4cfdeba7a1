"""The arm's body as control sees it: capsules round its links, each a little larger than the solid inside.

Fitted by ``tools/fit_capsules.py``: every capsule row contains its half of the link's collision hull, so control keeps
its distance from more than the referee judges. The base is no capsule: its footprint is in the profile, and ``link0``
stands within it. Fingers are regions of the hand that contain them at every gripper width.
"""

import numpy as np

from motm_twin.model.arm_kernels import ARM_FRAMES
from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array, frozen

_TABLE = (  # link, end points x, y, z, x, y, z and radius [m] in the link's frame
    ("panda_link1", 0.0002, -0.0488, 0.0000, -0.0010, -0.0043, -0.1486, 0.0742),
    ("panda_link1", 0.0000, -0.1017, 0.0001, -0.0002, -0.1017, -0.0309, 0.0482),
    ("panda_link2", 0.0000, 0.0001, 0.1017, 0.0014, -0.0312, 0.1014, 0.0482),
    ("panda_link2", 0.0004, -0.1453, 0.0010, 0.0001, 0.0001, 0.0502, 0.0749),
    ("panda_link3", -0.0035, -0.0446, -0.0933, -0.0477, 0.0114, -0.0904, 0.0400),
    ("panda_link3", 0.0832, 0.0427, 0.0008, 0.0033, 0.0027, -0.0800, 0.0697),
    ("panda_link4", -0.1259, 0.0938, 0.0103, -0.0852, 0.0948, -0.0446, 0.0407),
    ("panda_link4", -0.0001, 0.0003, 0.0422, -0.0792, 0.0827, 0.0024, 0.0701),
    ("panda_link5", 0.0002, 0.0187, -0.1998, 0.0000, 0.0641, 0.0005, 0.0685),
    ("panda_link5", 0.0003, -0.0051, -0.2400, 0.0001, 0.0023, -0.2444, 0.0579),
    ("panda_link6", 0.0965, -0.0292, -0.0012, 0.0290, -0.0391, 0.0077, 0.0494),
    ("panda_link6", 0.0773, 0.0277, 0.0022, 0.0024, -0.0011, 0.0167, 0.0603),
    ("panda_link7", -0.0051, -0.0051, 0.0733, 0.0329, 0.0330, 0.0807, 0.0498),
    ("panda_hand", 0.0000, -0.0835, 0.0447, 0.0000, 0.0836, 0.0446, 0.0274),
    ("panda_hand", 0.0000, -0.0811, 0.0079, -0.0001, 0.0779, 0.0129, 0.0354),
    ("panda_leftfinger", 0.0000, 0.0063, 0.0734, 0.0000, 0.0629, 0.0734, 0.0194),
    ("panda_leftfinger", 0.0000, 0.0032, 0.1004, 0.0000, 0.0536, 0.1004, 0.0168),
    ("panda_rightfinger", 0.0000, -0.0063, 0.0734, 0.0000, -0.0629, 0.0734, 0.0194),
    ("panda_rightfinger", 0.0000, -0.0032, 0.1004, 0.0000, -0.0536, 0.1004, 0.0168),
)


def _frame(link: str) -> int:
    return ARM_FRAMES.index("panda_hand" if link.endswith("finger") else link)


CAPSULE_LINKS = tuple(row[0] for row in _TABLE)  # name of the body each capsule stands for
CAPSULE_FRAMES = np.array([_frame(row[0]) for row in _TABLE])  # index into ARM_FRAMES, shape (n,)
CAPSULE_FRAMES.setflags(write=False)
CAPSULE_P0 = frozen([row[1:4] for row in _TABLE])  # [m] in the frame, shape (n, 3)
CAPSULE_P1 = frozen([row[4:7] for row in _TABLE])  # [m] in the frame, shape (n, 3)
CAPSULE_RADII = frozen([row[7] for row in _TABLE])  # [m], shape (n,)


@njit(cache=True)
def capsule_segments(T: Array) -> Array:
    """End points [m] of all capsules for the transforms of `fk_arm` (or those times a base transform).

    Shapes (11, 4, 4) -> (n, 2, 3), in the frame that T maps to.
    """
    count = CAPSULE_FRAMES.shape[0]
    segments = np.empty((count, 2, 3))
    for i in range(count):
        frame = CAPSULE_FRAMES[i]
        for r in range(3):
            x, y, z, origin = T[frame, r, 0], T[frame, r, 1], T[frame, r, 2], T[frame, r, 3]
            segments[i, 0, r] = origin + x * CAPSULE_P0[i, 0] + y * CAPSULE_P0[i, 1] + z * CAPSULE_P0[i, 2]
            segments[i, 1, r] = origin + x * CAPSULE_P1[i, 0] + y * CAPSULE_P1[i, 1] + z * CAPSULE_P1[i, 2]
    return segments
