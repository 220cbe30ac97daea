"""A value is one of the simulation itself only if every point is bit for bit the same without it."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from mjrun.experiment.design import Design
from mjrun.model import state
from mjrun.model.source import model_fingerprint
from mjrun.simulation.simulation import Simulation
from mjrun.study.prepared import PreparedStudy, own_values
from mjrun.study.spec import StudySpec
from mjrun.study.study import Study
from tests.reporters import RecordingReporter

ARM = """<mujoco><option timestep="0.01"/><worldbody>
<geom name="floor" type="plane" size="5 5 1" friction="0.7 0.005 0.0001"/>
<body name="arm"><joint name="hip" axis="0 1 0"/><geom name="bob" size=".1" pos="0 0 -1" mass="2"/></body>
<body name="box" pos="2 0 .4"><freejoint name="box"/><geom name="box" size=".1"/></body></worldbody>
<actuator><motor name="motor" joint="hip"/></actuator>
<keyframe><key name="up" qpos="3 2 0 .4 1 0 0 0"/><key name="zero" qpos="0 2 0 .4 1 0 0 0"/></keyframe></mujoco>"""
OwnValues = Callable[..., dict[str, frozenset[str]]]
VALUES = {
    "geom/floor.friction[0]": ("0.7", "0.8"),
    "geom/floor.friction": ("0.7,0.005,0.0001", "0.7"),
    "scale:geom/*.friction": ("1", "2"),
    "add:body/box.pos": ("0,0,0", "0,0,1"),
    "body/box.pos[2]": ("0.4", "0.5"),
    "geom/bob.mass": ("2", "2000g", "3"),
    "opt.integrator": ("euler", "rk4"),
    "timestep": ("0.01", "1e-2", "0.02"),
    "opt.flag.contact": ("enable", "disable"),
    "joint/hip.ref": ("0", "1"),
    "key": ("up", "zero"),
    "qpos/hip": ("0", "1"),
    "qpos/box/z": ("0.4", "0.5"),
    "ctrl/motor": ("0", "1"),
    "seed": ("3", "4"),
    "duration": ("5", "4"),
    "model": ("arm.xml",),
}


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Simulation:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(ARM)
    return Simulation("arm.xml", seed=3)


@pytest.fixture
def own(arm: Simulation) -> OwnValues:
    """Returns the own values of parameters by name."""
    source, model = arm.compile()

    def found(*names: str) -> dict[str, frozenset[str]]:
        points = Design(names, list(product(*(VALUES[name] for name in names))))
        values = own_values(points, StudySpec(arm, names, ()), source, model)
        return {names[index]: texts for index, texts in values.items()}

    return found


def content(simulation: Simulation) -> tuple[object, ...]:
    model = simulation.load()
    start = state.save(model, simulation.initial_data(model)).tobytes()
    return model_fingerprint(model), start, simulation.timeline(model), simulation.seed


def test_every_own_value_changes_nothing_at_any_point_of_any_pair(arm: Simulation, own: OwnValues) -> None:
    contents = dict[tuple[tuple[str, str], ...], tuple[object, ...]]()

    def content_of(*values: tuple[str, str]) -> tuple[object, ...]:
        if values not in contents:
            names, texts = tuple(name for name, _ in values), tuple(text for _, text in values)
            contents[values] = content(StudySpec(arm, names, ()).simulation(texts))
        return contents[values]

    names = [name for name in VALUES if name not in ("model", "seed", "duration", "ctrl/motor", "opt.flag.contact")]
    for one in names:
        for other in names:
            if one == other:
                continue
            for text in own(one, other).get(one, ()):
                for value in VALUES[other]:
                    for pair in ([(one, text), (other, value)], [(other, value), (one, text)]):
                        assert content_of(*pair) == content_of((other, value)), pair


def test_the_values_of_the_model_and_of_the_options_are_own_ones(own: OwnValues) -> None:
    names = ("geom/floor.friction[0]", "geom/bob.mass", "opt.integrator", "timestep", "qpos/hip", "seed", "duration")
    found = own(*names)
    assert {name: VALUES[name][:-1] for name in names} == {
        name: tuple(sorted(found[name], key=VALUES[name].index)) for name in names
    }
    assert own("key") == {"key": {"zero"}}
    assert own("qpos/hip", "key") == {"key": {"zero"}}
    assert own("body/box.pos[2]", "qpos/box/z") == {"body/box.pos[2]": {"0.4"}}


def test_of_many_numbers_only_the_equal_one_is_tried(arm: Simulation) -> None:
    study = Study(arm, "s", vary={"geom/floor.friction[0]": "0.2..1.2:1001"})
    prepared = PreparedStudy(study, study.spec)
    assert prepared._own_values == {0: {"0.7"}}


def test_a_study_that_gains_parameters_keeps_its_points(arm: Simulation) -> None:
    def study(folder: str, **vary: str) -> Study:
        metric = {"end": "last(qpos/hip)"}
        return Study(replace(arm, duration=0.2), folder, metric=metric, jobs=1, vary={"ctrl/motor": "1,2", **vary})

    more = {"timestep": "0.005,0.01", "qvel/hip": "0,1"}
    assert study("grown").run().simulated == 2
    reporter = RecordingReporter()
    assert study("grown", **more).run(reporter).simulated == 6
    assert "2 of 8 points are known already, 2 of them from an earlier design" in reporter.texts
    study("new", **more).run()
    assert Path("grown/results.csv").read_bytes() == Path("new/results.csv").read_bytes()
    assert study("grown", timestep="0.01").run().simulated == 0


def test_a_neutral_factor_is_an_own_value(own: OwnValues) -> None:
    assert own("scale:geom/*.friction") == {"scale:geom/*.friction": {"1"}}


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"geom/*.friction[0]": "0.5,1.5"}, {"geom/floor.friction[0]": "2,3"}),
        ({"scale:body/box.pos[2]": "1,2"}, {"body/box.pos[2]": "0.3,0.6"}),
        ({"body/box.quat": "0.8,0.6,0,0;1,0,0,0"}, {"body/box.alt.euler": "0,1,0;0,2,0"}),
        ({"qvel/box": "0,0,0,0,0,0;1,0,0,0,0,0"}, {"qvel/box/vx": "2,0.5"}),
    ],
    ids=["wildcard", "factor", "orientation", "components"],
)
def test_parameters_of_one_number_in_another_order_are_simulated_again(
    arm: Simulation, one: dict[str, str], other: dict[str, str]
) -> None:
    def results(folder: str, vary: dict[str, str]) -> bytes:
        metrics = {"x": "last(qpos/box/x)", "z": "last(qpos/box/z)", "q": "last(qpos/box/qx)", "f": "sum(contact/ncon)"}
        Study(replace(arm, duration=0.1, qvel={"box/wx": 1.0}), folder, metric=metrics, jobs=1, vary=vary).run()
        return Path(folder, "results.csv").read_bytes()

    before = results("swapped", one | other)
    new = results("new", other | one)
    assert results("swapped", other | one) == new
    assert before.splitlines()[1:] != new.splitlines()[1:]
