"""The fields that a controller provably uses, and the loops that its bytecode must not hide."""

import functools
from collections.abc import Callable

import mujoco
import pytest

from mjrun.physics.controller_analysis import access_of
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


def clear(out, source, scale=1.0):
    out[:] = scale * source.time


def passes_on(model, data):
    half = data.qvel / 2
    clear(data.ctrl, data, 0.1 * half[0])


def recurses(model, data):
    recurses(model, data)
    data.ctrl[0] = data.qacc[0]


def reads(model, data):
    mujoco.mj_jacSite(model, data, data.qpos, None, 0)


def by_name(model, data):
    data.actuator("motor").ctrl = data.geom("ball").xpos[0] + data.joint(0).qpos + data.sensor("imu").data[0]


def branches(model, data):
    for index in range(3):
        data.ctrl[index] = data.qpos[index] if index else 0.0
    try:
        clear(data.ctrl, data)
    except ValueError:
        data.xfrc_applied[:] = 0


class Walker:
    def __call__(self, model, data):
        data.ctrl = self.observe(model, data)

    def observe(self, model, instant):
        return instant.qpos + instant.body("torso").xpos


def keeps(data):
    keeps.last = data  # pyright: ignore[reportFunctionMemberAccess]


def passes_to_one_that_keeps(model, data):
    keeps(data)


def chooses(model, data):
    (clear if data.time else passes_on)(data.ctrl, data)


def first_phase(model, data):
    data.ctrl[0] = 1


phase = first_phase


def switch():
    global phase
    phase = calls


def switches(model, data):
    switch()
    phase(model, data)


def yields(data):
    yield data.qpos


def passes_to_a_generator(model, data):
    yields(data)


def passes_by_keyword(model, data):
    clear(out=data.ctrl, source=data)


def passes_perhaps(model, data):
    clear(data.ctrl, data if model else None)


def passes_a_view(model, data):
    keeps(data.body("torso"))


class Learner:
    def __init__(self):
        self.policy = servo

    def __call__(self, model, data):
        self.policy(model, data)


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
        (lambda model, data: data.body("hand").xpos, {"xpos"}),
        (lambda model, data: None, set()),
        (RedirectedFunction(servo), {"ctrl", "qvel", "xfrc_applied", "time"}),
        (passes_on, {"ctrl", "qvel", "time"}),
        (recurses, {"ctrl", "qacc"}),
        (reads, {"qpos"}),
        (by_name, {"ctrl", "geom_xpos", "qpos", "sensordata"}),
        (branches, {"ctrl", "qpos", "time", "xfrc_applied"}),
        (Walker(), {"ctrl", "qpos", "xpos"}),
    ],
)
def test_fields_are_known_if_the_data_is_used_for_attributes_alone(controller: Callable, fields: set[str]) -> None:
    access = access_of(controller)
    assert access
    assert access.fields == fields
    assert access.holds


@pytest.mark.parametrize(
    "controller",
    [
        *(renames, nests, calls, reflects, rebinds, stores, passes_twice, functools.partial(servo), max),
        *(lambda model, *rest: rest[0].qpos, lambda *both: both[1].qpos),
        lambda model, data=None: [data, data.qpos],  # pyright: ignore[reportOptionalMemberAccess]
        functools.cache(servo),
        RedirectedFunction(calls),
        *(passes_to_one_that_keeps, chooses, switches, passes_to_a_generator, passes_by_keyword, passes_perhaps),
        *(passes_a_view, Learner()),
    ],
)
def test_fields_are_unknown_if_the_data_is_used_otherwise(controller: Callable) -> None:
    assert access_of(controller) is None


def test_a_comprehension_hides_nothing() -> None:
    access = access_of(comprehends)  # Python 3.12 has it in the function itself
    assert access is None or access.fields == {"qpos", "qvel"}


def test_an_access_holds_until_a_function_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    walker = Walker()
    of_function, of_method = access_of(passes_on), access_of(walker)
    assert of_function
    assert of_method
    monkeypatch.setitem(globals(), "clear", keeps)
    monkeypatch.setattr(walker, "observe", keeps)
    assert not of_function.holds
    assert not of_method.holds
