"""Theorems about the DeepMind Control Suite as model sources: its files, and never its code."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mjrun.errors import ModelNotFoundError
from mjrun.model.override import Override
from mjrun.model.sources import dm, parse_source
from mjrun.model.sources.dm import ControlSuiteSource

MODEL = """<mujoco model="{}"><include file="./common/sky.xml"/><worldbody><body><joint name="hinge"/><geom size=".1"/>
</body></worldbody></mujoco>"""
CODE = """
from dm_control.utils import containers
SUITE = containers.TaggedTasks()

def get_model_and_assets():
  return common.read_model('{0}.xml'), common.ASSETS

@SUITE.add('benchmarking')
def {1}(time_limit=10):
  return control.Environment()

@SUITE.add()
def {2}(time_limit=10):
  return control.Environment()
"""
DOMAINS = {
    "humanoid": ("stand", "walk"),
    "cartpole": ("balance", "two_poles"),
    "swimmer": ("swimmer6", "swimmer15"),
}
LIST = "domains: cartpole, humanoid, swimmer"


@pytest.fixture(autouse=True)
def suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package laid out as dm_control is; whoever imports it fails."""
    folder = tmp_path / "dm_control" / "suite"
    (folder / "common").mkdir(parents=True)
    (tmp_path / "dm_control" / "__init__.py").write_text("raise ImportError('not to be imported')")
    (folder / "common" / "sky.xml").write_text("<mujocoinclude><statistic extent='3'/></mujocoinclude>")
    for domain, tasks in DOMAINS.items():
        (folder / f"{domain}.xml").write_text(MODEL.format(domain))
        (folder / f"{domain}.py").write_text(CODE.format(domain, *tasks))
    (folder / "explore.py").write_text("raise ImportError")
    monkeypatch.syspath_prepend(tmp_path)
    dm._domains.cache_clear()
    yield folder
    dm._domains.cache_clear()


@pytest.mark.parametrize("name", ["humanoid", "humanoid/walk", "cartpole", "cartpole/balance", "swimmer"])
def test_a_domain_and_its_tasks_are_the_xml_of_the_suite(suite: Path, name: str) -> None:
    source = parse_source(f"dm:{name}", [Override("opt.timestep", "0.25")])
    assert source.main_file == suite / f"{name.partition('/')[0]}.xml"
    assert source.files == (source.main_file, suite / "./common/sky.xml")
    model = source.load()
    assert (model.opt.timestep, model.stat.extent, model.njnt) == (0.25, 3, 1)
    assert source.stem == name.replace("/", "_")
    assert "dm_control" not in sys.modules


def test_the_list_says_what_is_the_xml_and_what_python_makes_of_it() -> None:
    assert ControlSuiteSource.descriptions() == {
        "cartpole": "cartpole.xml for balance; Python changes it for two_poles",
        "humanoid": "humanoid.xml for stand, walk",
        "swimmer": "swimmer.xml; Python changes it for swimmer6, swimmer15",
    }


@pytest.mark.parametrize("name", ["swimmer/swimmer6", "cartpole/two_poles"])
def test_a_model_that_python_makes_is_refused_with_what_it_is_made_from(name: str) -> None:
    with pytest.raises(ModelNotFoundError) as caught:
        parse_source(f"dm:{name}").load()
    assert str(caught.value).splitlines() == [
        f"dm:{name}: its model is made by Python code of dm_control, which mjrun does not run",
        f"dm:{name.partition('/')[0]} is the XML before the change",
    ]


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        (
            "humaniod",
            ["dm:humaniod: no such domain (did you mean 'humanoid'?)", "domains: cartpole, humanoid, swimmer"],
        ),
        ("humaniod/walk", ["dm:humaniod/walk: no such domain (did you mean 'humanoid'?)"]),
        ("humanoid/wlk", ["dm:humanoid/wlk: humanoid has no such task (did you mean 'walk'?)"]),
        ("", ["dm: name the domain", LIST]),
        ("common/sky", ["dm:common/sky: no such domain"]),
        ("../suite/humanoid", ["dm:../suite/humanoid: no such domain"]),
        ("humanoid/../swimmer", ["dm:humanoid/../swimmer: humanoid has no such task"]),
        ("humanoid/", ["dm:humanoid/: humanoid has no such task"]),
    ],
)
def test_what_is_not_in_the_suite_is_answered_with_what_is(name: str, lines: list[str]) -> None:
    with pytest.raises(ModelNotFoundError) as caught:
        parse_source(f"dm:{name}").load()
    assert str(caught.value).splitlines()[: len(lines)] == lines


def test_without_dm_control_the_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dm.importlib.util, "find_spec", lambda name: None)
    dm._domains.cache_clear()
    with pytest.raises(ModelNotFoundError, match=r"^dm:humanoid: dm_control is not installed\npip install dm_control"):
        parse_source("dm:humanoid").load()
