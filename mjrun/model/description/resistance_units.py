"""The units of what joints and tendons resist with, by the unit of their positions: `rad` or `m`."""

STIFFNESS = {"rad": "N·m/rad", "m": "N/m"}
DAMPING = {"rad": "N·m·s/rad", "m": "N·s/m"}
ARMATURE = {"rad": "kg·m²", "m": "kg"}
FORCE = {"rad": "N·m", "m": "N"}
