"""Swings pendulum.xml up with a motor too weak to lift it, and balances it: a controller for `--controller`.

mjrun video scenes/pendulum.xml --controller scenes/swing_up.py:SwingUp --camera fixed --duration 12
"""

import math

INERTIA, WEIGHT = 1.004, 9.81  # about the pivot [kg m^2]; m g l [N m]
LIMIT = 3.0  # [N m]


class SwingUp:
    """Pumps energy until the pendulum can reach the top, then holds it there."""

    def reset(self):
        self.balancing = False

    def __call__(self, model, data):
        angle, rate = data.qpos[0], data.qvel[0]  # 0 hangs, pi stands
        off = math.remainder(angle - math.pi, 2 * math.pi)
        self.balancing = abs(off) < (0.6 if self.balancing else 0.2)
        if self.balancing:
            torque = -40 * off - 10 * rate
        else:
            missing = 2 * WEIGHT - (INERTIA * rate**2 / 2 + WEIGHT * (1 - math.cos(angle)))
            torque = math.copysign(LIMIT, missing * (rate or 1.0)) if abs(missing) > 0.1 else 0.0
        data.ctrl[0] = max(-LIMIT, min(LIMIT, torque))
