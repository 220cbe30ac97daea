"""What every engine shares: a model for each simulation, and blocks whose memory is bounded."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from mjrun.model import state
from mjrun.physics import engine as engines
from mjrun.physics.engine import CEngine, block_steps, joined, models_of

MODEL = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>")


def test_one_model_stands_for_all_and_several_for_one_each() -> None:
    other = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert models_of(MODEL, 3) == [MODEL] * 3
    assert models_of([MODEL, other], 2) == [MODEL, other]
    with pytest.raises(ValueError, match="2 models for 3 simulations"):
        models_of([MODEL, other], 3)


@pytest.mark.parametrize(("count", "limit"), [(1, 10_000), (7, 10_000), (7, 50_000)])
def test_a_block_has_as_many_steps_as_fit(count: int, limit: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "BLOCK_BYTES", limit)
    fields = ("qpos", "xpos", "ncon")
    data = mujoco.MjData(MODEL)
    row = count * (8 * state.size(MODEL) + data.qpos.nbytes + data.xpos.nbytes + np.asarray(data.ncon).nbytes)
    steps = block_steps(MODEL, fields, count)
    assert steps * row <= limit < (steps + 1) * row


def test_a_block_has_a_step_even_where_it_does_not_fit_and_is_never_endless(monkeypatch: pytest.MonkeyPatch) -> None:
    assert block_steps(MODEL, (), 1) == engines.BLOCK_STEPS
    monkeypatch.setattr(engines, "BLOCK_BYTES", 1)
    assert block_steps(MODEL, ("qpos",), 1000) == 1


def test_rows_do_not_depend_on_the_size_of_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    data = mujoco.MjData(MODEL)
    starts = np.array([state.save(MODEL, data)] * 2)

    def rows(limit: int) -> bytes:
        monkeypatch.setattr(engines, "BLOCK_BYTES", limit)
        blocks = list(CEngine().rollout(MODEL, starts, None, 40, ("qpos", "qacc")))
        return b"".join(
            np.concatenate([block.fields[f] for block in blocks], axis=1).tobytes() for f in ("qpos", "qacc")
        )

    assert rows(1) == rows(5000) == rows(2**26)


@pytest.mark.parametrize("rows", [1, 20, 1000])
def test_joined_blocks_hold_the_same_rows_and_no_more_than_fit(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "BLOCK_BYTES", 1000)
    start = mujoco.MjData(MODEL)
    start.qvel[0] = 1
    starts = np.stack([state.save(MODEL, start)] * 2)
    blocks = list(CEngine().rollout(MODEL, starts, None, 50, ("qpos", "xpos")))
    assert len(blocks) > 3
    made = list(joined(blocks, rows))
    assert max(len(block.steps) for block in made) <= max(rows, *(len(block.steps) for block in blocks))
    assert all(len(one.steps) + len(other.steps) > rows for one, other in pairwise(made))
    assert np.concatenate([block.steps for block in made]).tolist() == list(range(51))
    for name in ("qpos", "xpos"):
        one, other = (np.concatenate([block.fields[name] for block in each], axis=1) for each in (made, blocks))
        np.testing.assert_array_equal(one, other)
    assert np.sum([block.counts for block in made], axis=0).tolist() == [51, 51]
