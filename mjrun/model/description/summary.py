"""The summary of a model."""

from dataclasses import dataclass
from pathlib import Path

import mujoco

from mjrun.model.description.plain_values import enum_name, floats

SIZES = (
    *("nq", "nv", "na", "nu", "nsensordata", "nuserdata", "nmocap", "npluginstate", "nhistory", "nplastic"),
    *("nbody", "njnt", "ngeom", "nsite", "ncam", "nlight", "nflex", "ntree"),
    *("nactuator", "nsensor", "ntendon", "neq", "npair", "nexclude", "nkey", "nplugin"),
    *("nmesh", "nskin", "nhfield", "ntex", "nmat", "nmeshvert", "nmeshface", "nflexvert", "nflexelem"),
    *("nnumeric", "ntext", "ntuple", "nM", "nB", "nC", "nD"),
)


@dataclass(frozen=True)
class MemorySize:
    """What the model takes in memory [bytes]: `model`, `data` without its arena, and the `arena`, which holds
    contacts, constraints and what is computed on the way.
    """

    model: int
    data: int
    arena: int


@dataclass(frozen=True)
class ModelSummary:
    """The whole of a model in a few numbers.

    Attributes:
      name: of the model.
      file: its path; None of a model that is in memory only.
      mujoco: the version that compiled it.
      mass: of all bodies [kg].
      centre_of_mass: of all bodies in the model's own configuration [m]; None where nothing has a mass.
      extent, center: of the model in space, as its statistics say [m].
      timestep: [s].
      gravity: [m/s²].
      integrator, solver, cone: by MuJoCo's names.
      jacobian: `dense` or `sparse`, as it is in effect.
      memory: [bytes].
      sizes: by MuJoCo's names: `nq`, `nv`, `nbody` …
    """

    name: str
    file: str | None
    mujoco: str
    mass: float
    centre_of_mass: tuple[float, ...] | None
    extent: float
    center: tuple[float, ...]
    timestep: float
    gravity: tuple[float, ...]
    integrator: str
    solver: str
    cone: str
    jacobian: str
    memory: MemorySize
    sizes: dict[str, int]


def summary(model: mujoco.MjModel, path: Path | None) -> ModelSummary:
    """The summary of a model."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mass = float(mujoco.mj_getTotalmass(model))
    return ModelSummary(
        name=model.names[: model.names.index(b"\0")].decode("utf-8", "replace"),
        file=None if path is None else str(path),
        mujoco=mujoco.mj_versionString(),
        mass=mass,
        centre_of_mass=floats(data.subtree_com[0]) if mass else None,
        extent=float(model.stat.extent),
        center=floats(model.stat.center),
        timestep=float(model.opt.timestep),
        gravity=floats(model.opt.gravity),
        integrator=enum_name(mujoco.mjtIntegrator, model.opt.integrator),
        solver=enum_name(mujoco.mjtSolver, model.opt.solver),
        cone=enum_name(mujoco.mjtCone, model.opt.cone),
        jacobian="sparse" if mujoco.mj_isSparse(model) else "dense",
        memory=MemorySize(int(model.nbuffer), int(data.nbuffer), int(data.narena)),
        sizes={name: int(getattr(model, name)) for name in SIZES},
    )
