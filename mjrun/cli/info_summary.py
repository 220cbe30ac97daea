"""What `mjrun info` shows in lines with labels: the summary and the statistics."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mjrun.cli.info_formatting import number, size, vector
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.model.description.model_description import ModelSummary, Statistics

ALWAYS = ("nq", "nv", "na", "nu", "nbody", "njnt", "ngeom")  # sizes that are told even where they are 0
STATE = ("nq", "nv", "na", "nu", "nsensordata", "nuserdata", "nmocap", "npluginstate", "nhistory", "nplastic")
UNTOLD = ("nM", "nB", "nC", "nD")  # what only the curious want, of --json
NOTHING = 1e-9  # of the extent of a model


def summary(found: "ModelSummary") -> list[tuple[str, str]]:
    """The whole of a model."""
    memory = found.memory
    state = [name for name in found.sizes if name in STATE]
    rest = [name for name in found.sizes if name not in (*STATE, *UNTOLD)]
    return [
        ("file", clean(found.file or "")),
        ("mass", f"{number(found.mass)} kg"),
        ("centre of mass", _point_in_space(found.centre_of_mass, found.extent)),
        ("extent", f"{number(found.extent)} m around {vector(found.center)}"),
        ("timestep", f"{number(found.timestep)} s, {found.integrator} integrator"),
        ("solver", f"{found.solver}, {found.jacobian} Jacobian, {found.cone} friction cone"),
        ("gravity", f"{vector(found.gravity)} m/s²"),
        ("memory", f"model {size(memory.model)}, data {size(memory.data)}, arena {size(memory.arena)}"),
        ("state", _sizes(found, state)),
        ("objects", _sizes(found, rest)),
        ("compiled by", f"MuJoCo {found.mujoco}"),
    ]


def _point_in_space(values: Sequence[float] | None, extent: float) -> str:
    """A position; what is nothing beside the extent of the model is 0."""
    return "" if values is None else f"{vector(value if abs(value) > NOTHING * extent else 0 for value in values)} m"


def _sizes(found: "ModelSummary", fields: Sequence[str]) -> str:
    told = [name for name in fields if found.sizes[name] or name in ALWAYS]
    return "  ".join(f"{name}={found.sizes[name]}" for name in told)


def statistics(found: "Statistics") -> list[tuple[str, str]]:
    return [
        ("center", f"{vector(found.center)} m"),
        ("extent", f"{number(found.extent)} m"),
        ("meansize", f"{number(found.meansize)} m"),
        ("meanmass", f"{number(found.meanmass)} kg"),
        ("meaninertia", f"{number(found.meaninertia)} kg·m²"),
    ]


LINES = {"summary": summary, "statistics": statistics}
