"""Models that violate rules, and what the rules find in them, in this process and without simulation."""

from collections.abc import Collection
from pathlib import Path
from typing import Any

from mjrun.check.check import CheckResult, ModelCheck, ModelCheckResult
from mjrun.check.context import CheckContext
from mjrun.check.finding import Finding
from mjrun.check.rule_runner import RULES, apply, explain, ignored_xml
from mjrun.errors import ModelError
from mjrun.model.xml_source import read_xml
from tests.processes import PATIENCE

ROOT = Path(__file__).parents[2]


MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


def mjcf(world: str = "", after: str = "", before: str = "") -> str:
    """A model whose world holds `world` from line 4 on."""
    return f"<mujoco>\n{before}\n<worldbody>\n{world}\n</worldbody>\n{after}\n</mujoco>"


def hinged(joint: str = "", geom: str = 'size=".1"', after: str = "", before: str = "", world: str = "") -> str:
    """A body `b` with a joint `j` and a geom `g`."""
    return mjcf(f'<body name="b">\n<joint name="j" {joint}/>\n<geom name="g" {geom}/>\n</body>\n{world}', after, before)


def keyed(key: str, joint: str = 'range="-1 1"', before: str = '<compiler angle="radian"/>') -> str:
    motor = '<actuator><motor name="m" joint="j" ctrlrange="-1 1"/></actuator>'
    return hinged(joint, after=f"{motor}\n<keyframe>\n<key name='k' {key}/></keyframe>", before=before)


FINE = hinged()


def lint_file(path: Path, codes: Collection[str] = RULES.keys()) -> list[Finding]:
    """What is found in the model `path`."""
    source = read_xml(path)
    try:
        context = CheckContext.load(path, source)
    except ModelError as error:
        return explain(error, source)
    return [*ignored_xml(source), *(finding for code in RULES if code in codes for finding in apply(code, context))]


def lint(text: str) -> list[Finding]:
    """What is found in the model `text`, written to `model.xml` in the working directory, beside a mesh `yes.obj`."""
    Path("yes.obj").write_text(MESH)
    path = Path("model.xml")
    path.write_text(text)
    return lint_file(path)


def arms(attach: str, key: str = "", joint: str = 'range="2 1"', before: str = "") -> str:
    """Writes a model `arm.xml`, whose joint is on line 5, and makes one that attaches it by `attach` from line 4 on."""
    text = mjcf(f'<body name="b">\n<joint name="j" {joint}/><geom size="1"/></body>', key, before)
    Path("arm.xml").write_text(text)
    return mjcf(attach, before=f'{before}<asset><model name="arm" file="arm.xml"/></asset>')


def attaching(prefix: str) -> str:
    return f'<body pos="9 0 {len(prefix)}">\n<attach model="arm" body="b" prefix="{prefix}"/></body>'


PARENT = mjcf(
    '<geom size="1"/>\n<geom size="1"/><site/>\n<attach model="arm" body="arm" prefix="left_"/>',
    before='<asset><model name="arm" file="sub/arm.xml"/></asset>',
)


def attached_arm(geom: str = 'size="1"', asset: str = "") -> str:
    """What `PARENT` attaches: a geom on line 5, where the parent has one too."""
    return mjcf(f'<body name="arm">\n<geom name="g" {geom}/>\n</body>', before=f"<asset>{asset}</asset>")


LFS = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n"


PASSIVE = (
    '<mujoco><worldbody><body name="b"><joint name="j" {}/><geom size=".1" pos="1 0 0"/></body></worldbody></mujoco>'
)


def write(name: str, text: str) -> str:
    """Writes a file, and returns its name."""
    Path(name).write_text(text)
    return name


def checked(*models: str, **options: Any) -> CheckResult:
    """The result of `mjrun check`, each model in a process of its own."""
    return ModelCheck(models, **{"timeout": PATIENCE, "memory": 1024, **options}).run()


def codes(result: ModelCheckResult) -> list[str]:
    return [finding.code for finding in result.findings]
