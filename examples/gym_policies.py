"""The Gymnasium environment with three policies: at random, scripted from what is observed, the shipped method.

python examples/gym_policies.py towards               # needs Gymnasium: .venv/bin/pip install gymnasium
python examples/gym_policies.py expert --seed 3 --save last.png
"""

import argparse
import math
import sys
import time

import numpy as np

from motm_twin.program import clean_exit

try:
    from motm_twin.gym import ENVIRONMENTS, Expert
except ImportError as missing:  # it says what to install
    print(missing, file=sys.stderr)
    sys.exit(2)
import gymnasium

SLOW = 0.9  # [m] from the target at which the scripted policy goes slowly
HELD_UP = 10  # steps without getting ahead before it tries another way
BACK, AROUND = 24, 40  # steps backwards and away, then straight on


class Towards:
    """Turn to the target, drive up to it, wait in reach; held up, try beside it. It does not plan round a table."""

    def __init__(self):
        self.held_up, self.detour, self.side = 0, 0, 1.0

    def __call__(self, observed):
        """The action for an observation."""
        x, y, _ = observed["target"]
        bearing, distance = math.atan2(y, x), math.hypot(x, y)
        if observed["time_to_range"][0] == 0.0:
            self.held_up = self.detour = 0
            return np.zeros(2, dtype=np.float32)
        if self.detour:
            self.detour -= 1
            return np.array([-0.8, 0.45 * self.side] if self.detour >= AROUND else [0.8, 0.0], dtype=np.float32)
        speed = max(0.0, math.cos(bearing)) * (1.0 if distance > SLOW else 0.3)
        self.held_up = self.held_up + 1 if speed > 0.1 and observed["command"][0] < 0.02 else 0
        if self.held_up > HELD_UP:
            self.held_up, self.detour, self.side = 0, BACK + AROUND, -math.copysign(1.0, bearing)
        return np.clip([speed, 1.5 * bearing], -1.0, 1.0).astype(np.float32)


@clean_exit()
def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("policy", nargs="?", default="towards", choices=("random", "towards", "expert"))
    parser.add_argument("--env", default="motm/Exp1Base-v0", choices=ENVIRONMENTS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--save", metavar="PNG", help="write the last picture")
    options = parser.parse_args()

    env = gymnasium.make(options.env, render_mode="rgb_array", guard=True)
    observed, info = env.reset(seed=options.seed)
    if options.policy == "towards" and env.action_space.shape != (2,):
        parser.error(f"towards drives a base only, not {options.env}: choose another --env or policy")
    env.action_space.seed(options.seed)
    expert = Expert(env.unwrapped)
    policies = {
        "random": lambda observed: env.action_space.sample(),
        "towards": Towards(),
        "expert": lambda observed: expert.action(),
    }
    total, ended, step, began = 0.0, False, 0, time.perf_counter()
    while not ended and step < options.steps:
        observed, reward, terminated, truncated, info = env.step(policies[options.policy](observed))
        total, step, ended = total + reward, step + 1, terminated or truncated
    rate = step / (time.perf_counter() - began)
    print(
        f"{options.policy}: {info['picks']} picked, {info['places']} placed, "
        f"{info['contacts_caused']} contacts caused in {info['time_s']:.1f} s "
        f"(of {info['contacts']}); return {total:.1f}; {rate:.0f} steps/s"
    )
    if options.save:
        from PIL import Image

        Image.fromarray(env.render()).save(options.save)


if __name__ == "__main__":
    main()
