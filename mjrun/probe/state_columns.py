"""Every number of an integration state by name: `qpos/root/z`, `act/motor`, `xfrc_applied/torso/fx`."""

import mujoco

from mjrun.model import state
from mjrun.probe.fields import field_probe


def state_columns(model: mujoco.MjModel) -> list[str]:
    """The names of all numbers in an integration state of `model`, in order, as columns of traces are named."""
    names: list[str] = []
    for field, part in state.fields(state.sizes(model)).items():
        own = ["time"] if field == "time" else [column.name for column in field_probe(model, field).columns]
        assert len(own) == part.stop - part.start, field
        names += own
    return names
