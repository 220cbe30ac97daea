"""Pixels, against MuJoCo's own renderer."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.render import classic
from mjrun.render.backend import Backend
from mjrun.render.camera import rig
from mjrun.render.classic import ClassicRenderer
from mjrun.render.visual import Visual

SIZE = (96, 64)
Still = Callable[..., np.ndarray]


def at(path: Path, step: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The model after `step` steps, with everything derived from that state computed."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=step)
    mujoco.mj_forward(model, data)
    return model, data


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    every = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, every))
    mujoco.mj_getState(model, data, state, every)
    return state


def draw(path: Path, step: int, backend: Backend, camera: str = "side", **visual: object) -> np.ndarray:
    """What mjrun draws of a step."""
    model, data = at(path, step)
    with ClassicRenderer(model, SIZE, backend, Visual(**visual)) as renderer:  # type: ignore[arg-type]
        return renderer.draw(state_of(model, data), rig(camera, model), 0).copy()


@pytest.mark.parametrize("camera", ["side", "free"])
@pytest.mark.parametrize("step", [0, 300])
def test_a_picture_is_mujoco_s_own_to_the_last_bit(
    swing: Path, backend: Backend, still: Still, camera: str, step: int
) -> None:
    expected = still(*at(swing, step), SIZE, -1 if camera == "free" else camera)
    assert np.array_equal(draw(swing, step, backend, camera), expected)


def test_contact_forces_belong_to_the_state_that_is_shown(swing: Path, backend: Backend, still: Still) -> None:
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_CONTACTFORCE] = 1
    expected = still(*at(swing, 80), SIZE, "side", option)
    plain = still(*at(swing, 80), SIZE, "side")
    assert not np.array_equal(expected, plain)
    assert np.array_equal(draw(swing, 80, backend, show=["contactforce"]), expected)


def test_pictures_do_not_depend_on_what_was_drawn_before(swing: Path, backend: Backend) -> None:
    model, early = at(swing, 20)
    _, late = at(swing, 300)
    with ClassicRenderer(model, SIZE, backend, Visual()) as renderer:
        view = rig("side", model)
        first = renderer.draw(state_of(model, early), view, 0).copy()
        other = renderer.draw(state_of(model, late), view, 0).copy()
        renderer.draft_cost()
        again = renderer.draw(state_of(model, early), view, 0)
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)


def test_drawing_leaves_the_model_as_it_was(swing: Path, backend: Backend) -> None:
    model, data = at(swing, 0)
    with ClassicRenderer(model, (200, 100), backend, Visual(quality="draft")) as renderer:
        assert renderer.draw(state_of(model, data), rig("free", model), 0).shape == (100, 200, 3)
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == (64, 64)
    assert model.vis.quality.offsamples == 4


def test_high_quality_is_the_average_of_a_picture_twice_the_size(swing: Path, backend: Backend, still: Still) -> None:
    width, height = SIZE
    large = still(*at(swing, 0), (2 * width, 2 * height), "side").astype(int)
    average = large.reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    assert np.abs(draw(swing, 0, backend, quality="high") - average).max() <= 0.5


def test_a_draft_has_no_shadow_where_the_model_has_one(swing: Path, backend: Backend) -> None:
    model, draft = (draw(swing, 0, backend, quality=q).astype(int) for q in ("model", "draft"))
    darker = (draft - model).max(axis=2) > 30
    assert 0.005 < darker.mean() < 0.3


def test_hidden_things_are_not_drawn(swing: Path, backend: Backend) -> None:
    green = np.array([0, 1, 0])

    def greenness(picture: np.ndarray) -> int:
        return int((picture.argmax(axis=2) == 1)[(picture * (1 - green)).max(axis=2) < 60].sum())

    assert greenness(draw(swing, 0, backend)) > 20
    assert greenness(draw(swing, 0, backend, groups={"geom": ()})) == 0


def test_a_scene_grows_until_everything_is_in_it(
    swing: Path, backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = draw(swing, 0, backend, show=["joint", "com"], hide=["shadow"])
    monkeypatch.setattr(classic, "GEOMS", 2)
    assert np.array_equal(draw(swing, 0, backend, show=["joint", "com"], hide=["shadow"]), expected)


def test_a_size_beyond_the_renderer_s_is_refused(swing: Path, backend: Backend) -> None:
    model, _ = at(swing, 0)
    side = backend.max_size // 2
    with pytest.raises(UsageError, match=f"draws at most {side} pixels a side at --quality high"):
        ClassicRenderer(model, (side + 1, 64), backend, Visual(quality="high"))
