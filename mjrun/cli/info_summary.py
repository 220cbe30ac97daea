"""The summary and the statistics of `mjrun info`, as labelled lines."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mjrun.cli.table_cells import byte_size, number, vector
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.model.description.model_description import ModelSummary, Statistics

ALWAYS = ("nq", "nv", "na", "nu", "nbody", "njnt", "ngeom")  # sizes that are shown even if they are 0
STATE = ("nq", "nv", "na", "nu", "nsensordata", "nuserdata", "nmocap", "npluginstate", "nhistory", "nplastic")
HIDDEN = ("nM", "nB", "nC", "nD")  # sizes that only the JSON document has
NEGLIGIBLE = 1e-9  # relative to the extent of a model


def summary(of: "ModelSummary") -> list[tuple[str, str]]:
    """Describes a model in a few lines."""
    memory = of.memory
    state = [name for name in of.sizes if name in STATE]
    rest = [name for name in of.sizes if name not in (*STATE, *HIDDEN)]
    return [
        ("file", clean(of.file or "")),
        ("mass", f"{number(of.mass)} kg"),
        ("centre of mass", _point_in_space(of.centre_of_mass, of.extent)),
        ("extent", f"{number(of.extent)} m around {vector(of.center)}"),
        ("timestep", f"{number(of.timestep)} s, {of.integrator} integrator"),
        ("solver", f"{of.solver}, {of.jacobian} Jacobian, {of.cone} friction cone"),
        ("gravity", f"{vector(of.gravity)} m/s²"),
        ("memory", f"model {byte_size(memory.model)}, data {byte_size(memory.data)}, arena {byte_size(memory.arena)}"),
        ("state", _sizes(of, state)),
        ("objects", _sizes(of, rest)),
        ("compiled by", f"MuJoCo {of.mujoco}"),
    ]


def _point_in_space(values: Sequence[float] | None, extent: float) -> str:
    """Formats a position; components that are negligible relative to the extent of the model are 0."""
    return "" if values is None else f"{vector(value if abs(value) > NEGLIGIBLE * extent else 0 for value in values)} m"


def _sizes(of: "ModelSummary", fields: Sequence[str]) -> str:
    shown = [name for name in fields if of.sizes[name] or name in ALWAYS]
    return "  ".join(f"{name}={of.sizes[name]}" for name in shown)


def statistics(of: "Statistics") -> list[tuple[str, str]]:
    return [
        ("center", f"{vector(of.center)} m"),
        ("extent", f"{number(of.extent)} m"),
        ("meansize", f"{number(of.meansize)} m"),
        ("meanmass", f"{number(of.meanmass)} kg"),
        ("meaninertia", f"{number(of.meaninertia)} kg·m²"),
    ]
