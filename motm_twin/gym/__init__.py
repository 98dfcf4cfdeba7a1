"""The twin as a Gymnasium environment. Importing this registers it: `gymnasium.make("motm/Exp1Base-v0")`.

Needs the extra `[gym]`. docs/gym.md has the actions, the observations and the reward.
"""

from motm_twin.gym.env import MotmEnv, RewardWeights
from motm_twin.gym.observation import Expert, gymnasium

__all__ = ["ENVIRONMENTS", "Expert", "MotmEnv", "RewardWeights"]

_SCENES = {"Exp1": "exp1", "Exp1a": "exp1a", "Exp2": "exp2"}
_MODES = {"Base": "base", "WholeBody": "whole_body"}
ENVIRONMENTS = {
    f"motm/{title}{suffix}-v0": {"scene": scene, "actions": mode}
    for title, scene in _SCENES.items()
    for suffix, mode in _MODES.items()
}  # id -> arguments of `MotmEnv`

for _id, _arguments in ENVIRONMENTS.items():
    if _id not in gymnasium.registry:
        gymnasium.register(id=_id, entry_point="motm_twin.gym.env:MotmEnv", kwargs=_arguments)
