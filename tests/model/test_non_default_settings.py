"""Theorems about described settings: they are all that makes a model differ from MuJoCo's defaults."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from mjrun.model.info import ModelDescription
from mjrun.model.override import Override, apply


def as_text(value: Any) -> str:
    return ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)


def state(model: mujoco.MjModel) -> dict[str, Any]:
    """All options and all settings of what is drawn."""
    owners = {"opt": model.opt, **{name: getattr(model.vis, name) for name in ("global_", "quality", "headlight")}}
    owners |= {name: getattr(model.vis, name) for name in ("map", "scale", "rgba")}
    return {
        f"{owner}.{name}": np.array(getattr(value, name)).tolist()
        for owner, value in owners.items()
        for name in dir(type(value))
        if not name.startswith("_")
    }


def test_the_settings_told_are_all_that_makes_the_model_differ(scene: ModelDescription) -> None:
    spec = mujoco.MjSpec()
    for setting in (*scene.options, *scene.visual):
        apply(spec, Override(setting.path, as_text(setting.value)))
    assert state(spec.compile()) == state(scene.model)
    for setting in (*scene.options, *scene.visual):
        apply(spec, Override(setting.path, as_text(setting.default)))
    assert state(spec.compile()) == state(mujoco.MjSpec().compile())


def test_settings_are_reported_in_mujocos_own_words(described: Callable[[str], ModelDescription]) -> None:
    found = described("""<mujoco><option cone="elliptic" gravity="0 0 -1.62"><flag contact="disable" energy="enable"/>
        </option><visual><map znear=".3"/><quality shadowsize="512"/></visual></mujoco>""")
    assert [(s.path, s.value, s.default, s.unit) for s in (*found.options, *found.visual)] == [
        ("opt.cone", "elliptic", "pyramidal", ""),
        ("opt.gravity", (0, 0, -1.62), (0, 0, -9.81), "m/s²"),
        ("opt.flag.contact", "disable", "enable", ""),
        ("opt.flag.energy", "enable", "disable", ""),
        ("vis.quality.shadowsize", 512, 4096, ""),
        ("vis.map.znear", 0.3, 0.01, ""),
    ]
