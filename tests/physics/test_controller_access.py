"""The fields that a controller provably uses, and the loops that its bytecode must not hide."""

import functools
from collections.abc import Callable

import mujoco
import pytest

from mjrun.physics.controller_access import used_fields
from mjrun.python_code import RedirectedFunction


def servo(model, data):
    data.ctrl[:] = -data.qvel[:1]
    data.xfrc_applied[1, 2] += 3 * data.time


def assigns(model, data):
    data.ctrl = [0.0]


def method_of_a_field(model, data):
    data.qvel.fill(1)


def other_uses_of_the_name(model, d):
    data = [1]
    data.append(model.nu)
    return d.qpos[data[0]]


class Policy:
    def __call__(self, model, data):
        return self.act(data.qpos, data.qvel)

    def act(self, model, data):
        return data.time


def renames(model, data):
    same = data
    return same.qpos


def comprehends(model, data):
    return [data.qpos[index] * data.qvel[index] for index in range(2)]


def nests(model, data):
    return (lambda: data.qpos)()


def calls(model, data):
    mujoco.mj_forward(model, data)


def reflects(model, data):
    return locals()["data"].qpos


def rebinds(model, data):
    data = data or model
    return data.qpos


def stores(model, data):
    stores.last = data  # pyright: ignore[reportFunctionMemberAccess]


def passes_twice(model, data):
    return max(data.time, data.qpos[0], key=lambda value: (value, data))


@pytest.mark.parametrize(
    ("controller", "fields"),
    [
        (servo, {"ctrl", "qvel", "xfrc_applied", "time"}),
        (assigns, {"ctrl"}),
        (method_of_a_field, {"qvel"}),
        (other_uses_of_the_name, {"qpos"}),
        (Policy(), {"qpos", "qvel"}),
        (Policy().act, {"time"}),
        (lambda model, data: data.qpos * 2, {"qpos"}),
        (lambda model, data: data.body("hand").xpos, {"body"}),
        (lambda model, data: None, set()),
        (RedirectedFunction(servo), {"ctrl", "qvel", "xfrc_applied", "time"}),
    ],
)
def test_fields_are_known_if_the_data_is_used_for_attributes_alone(controller: Callable, fields: set[str]) -> None:
    assert used_fields(controller) == fields


@pytest.mark.parametrize(
    "controller",
    [
        *(renames, nests, calls, reflects, rebinds, stores, passes_twice, functools.partial(servo), max),
        *(lambda model, *rest: rest[0].qpos, lambda *both: both[1].qpos),
        lambda model, data=None: [data, data.qpos],  # pyright: ignore[reportOptionalMemberAccess]
        functools.cache(servo),
        RedirectedFunction(calls),
    ],
)
def test_fields_are_unknown_if_the_data_is_used_otherwise(controller: Callable) -> None:
    assert used_fields(controller) is None


def test_a_comprehension_hides_nothing() -> None:
    assert used_fields(comprehends) in (None, {"qpos", "qvel"})  # Python 3.12 has it in the function itself
