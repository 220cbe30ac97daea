"""The numbers of a compiled model that follow from several bodies, computed as the compiler does."""

import mujoco
import numpy as np

from mjrun.model.compiler_copied_fields import STATISTICS

NO_CONTACTS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
PLANE, HFIELD = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)
FAR, SMALL = 1e10, 1e-5  # of the compiler [m]
CHECKED = ("dof_M0", "dof_invweight0", "body_invweight0", "actuator_acc0", "tendon_invweight0")


class DerivedNumbers:
    """The derived numbers of the variants of a model.

    Args:
      spec: the specification of the model, already compiled.

    Attributes:
      arrays: the arrays and statistics that `compute` may change.
    """

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
        changed = (*mujoco.MjModel._setconst_outputs, "tendon_lengthspring")  # pyright: ignore[reportPrivateUsage]
        self.arrays = [name for name in changed if getattr(model, name).size]
        self.arrays += [f"stat.{name}" for name in STATISTICS]
        self._data = mujoco.MjData(model)
        lengths = [tendon.id for tendon in spec.tendons if (np.asarray(tendon.springlength) == -1).all()]
        self._automatic_lengths = np.array(lengths, int)
        values = {name: getattr(spec.stat, name) for name in STATISTICS}
        self._statistics = {name: value for name, value in values.items() if not np.isnan(value).any()}
        self._parents = model.body_parentid[model.jnt_bodyid]

    def compute(self, model: mujoco.MjModel) -> bool:
        """Computes the numbers of a model with changed bodies; returns whether they are finite."""
        data = self._data
        disabled, enabled = model.opt.disableflags, model.opt.enableflags
        model.opt.disableflags |= NO_CONTACTS
        model.opt.enableflags &= ~SLEEP
        mujoco.mj_resetData(model, data)
        mujoco.mj_setConst(model, data)
        self._compute_spring_lengths(model)
        self._compute_statistics(model)
        model.opt.disableflags, model.opt.enableflags = disabled, enabled
        return all(np.isfinite(getattr(model, name)).all() for name in CHECKED)

    def _compute_spring_lengths(self, model: mujoco.MjModel) -> None:
        """Computes the spring lengths of tendons without their own, in the pose `qpos_spring`."""
        if not len(self._automatic_lengths):
            return
        self._data.qpos[:] = model.qpos_spring
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_comPos(model, self._data)
        mujoco.mj_tendon(model, self._data)
        model.tendon_lengthspring[self._automatic_lengths] = self._data.ten_length[self._automatic_lengths, None]

    def _compute_statistics(self, model: mujoco.MjModel) -> None:
        """Computes the statistics in the pose `qpos0`, except those that the source specifies."""
        data, statistics = self._data, model.stat
        data.qpos[:] = model.qpos0
        mujoco.mj_kinematics(model, data)
        self._compute_extent(model)

        joint_bodies = model.jnt_bodyid
        sizes = np.zeros(model.nbody)
        np.maximum.at(sizes, joint_bodies, _distances(data.xipos[joint_bodies], data.xanchor))
        np.maximum.at(sizes, self._parents, _distances(data.xipos[self._parents], data.xanchor))
        bounded = np.flatnonzero(model.geom_rbound > 0)
        owners = model.geom_bodyid[bounded]
        reach = model.geom_rbound[bounded] + _distances(data.xipos[owners], data.geom_xpos[bounded])
        np.maximum.at(sizes, owners, reach)

        others = model.nbody - 1
        if others:
            statistics.meansize = _sum(np.maximum(sizes[1:], SMALL) / others)
            statistics.meanmass = _sum(model.body_mass[1:]) / others
        statistics.extent = max(statistics.extent, 2 * statistics.meansize)
        if model.nv:
            statistics.meaninertia = _sum(model.dof_M0) / model.nv
        for name, value in self._statistics.items():
            setattr(statistics, name, value)

    def _compute_extent(self, model: mujoco.MjModel) -> None:
        """Computes the centre and the extent of the bounding box."""
        data = self._data
        radii = model.geom_rbound.copy()
        for geom in np.flatnonzero(~(radii > 0)).tolist():
            if model.geom_type[geom] == PLANE:
                radii[geom] = model.geom_size[geom, :2].max() * 0.1 if model.geom_size[geom, :2].any() else 0.01
            elif model.geom_type[geom] == HFIELD:
                radii[geom] = model.hfield_size[model.geom_dataid[geom]].max() * 0.1
            else:
                radii[geom] = 0
        points = np.concatenate([data.xpos[1:], data.xipos[1:], data.xanchor, data.site_xpos])
        low = np.concatenate([points, data.geom_xpos - radii[:, None]]).min(axis=0, initial=FAR)
        high = np.concatenate([points, data.geom_xpos + radii[:, None]]).max(axis=0, initial=-FAR)
        model.stat.center = (low + high) * 0.5
        if high[0] > low[0]:
            model.stat.extent = max(SMALL, (high - low).max())


def _distances(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    difference = one - other
    x, y, z = difference.T
    return np.sqrt(x * x + y * y + z * z)


def _sum(values: np.ndarray) -> float:
    """Returns the sum in order, as a loop in C adds."""
    return float(np.add.accumulate(values)[-1])
