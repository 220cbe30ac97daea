"""Theorems about fixes of models; those of single rules are in `rules/test_fixes.py`."""

import errno
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import mujoco
import pytest

from mjrun.check.check import ModelCheck, _with_reason
from mjrun.check.context import CheckContext
from mjrun.check.finding import FixedModelCopy, FixResult
from mjrun.check.rule import NOT_CERTAIN
from mjrun.check.worker_pool import CheckProcessOutput, CheckProcessPool, CheckRequest
from mjrun.child_process import ExitStatus
from mjrun.errors import option
from tests.check import fixes
from tests.check.fixes import fix, fixed, fixing, lint
from tests.check.models import MESH, codes, hinged, mjcf, write

SWAPPED = 'range="9 -9"'
RIGHT = 'range="-9 9"'


def reasons(*models: str, given: list[str] | None = None, unsafe: bool = False) -> list[str]:
    """Why faults of models are not fixed."""
    made = fixing(*models, given=given or models, unsafe=unsafe)
    return [f.message for result in made.results for f in result.findings if f.code == "MJ007"]  # type: ignore[attr-defined]


def test_an_absolute_path_is_fixed_at_once_although_the_model_loads_only_after_another_fix() -> None:
    write("m.obj", MESH)
    asset = f'<asset><mesh name="m" file="{Path("m.obj").absolute()}"/></asset>'
    text = fixed(hinged('limited="true" range="1 -1"', 'type="mesh" mesh="m"', before=asset))
    assert 'file="m.obj"' in text
    assert 'range="-1 1"' in text


@pytest.mark.parametrize("element", ['<include file="{}.xml"/>', '<asset><model name="m" file="{}.xml"/></asset>'])
def test_a_file_that_is_read_only_after_a_fix_is_fixed_like_the_others(element: str) -> None:
    attach = "" if "include" in element else '<attach model="m" body="b" prefix="l_"/>'
    mesh = '<asset><mesh name="m" file="m.obj"/></asset>'
    write("m.obj", MESH)
    part = write("part.xml", hinged(SWAPPED, 'type="mesh" mesh="m"', before=mesh))
    model = write("model.xml", mjcf(attach, before=element.format("Part")))
    before = Path(part).read_text()
    assert len(fixing(model, dry_run=True).files) == 2
    assert Path(part).read_text() == before
    assert fix(model) == {model: {"MJ107": 1}, part: {"MJ302": 1}}
    assert Path(part).read_text() == before.replace(SWAPPED, RIGHT)
    assert mujoco.MjModel.from_xml_path(model).jnt_limited[0]


def test_a_fix_that_is_wrong_in_another_model_is_not_made() -> None:
    joint = '<joint name="j" range="-1.57 1.57"/>'
    part = write("part.xml", f'<mujoco><worldbody><body name="b">{joint}<geom size=".1"/></body></worldbody></mujoco>')
    text, include = Path(part).read_text(), f'<include file="{part}"/>'
    texts = {unit: mjcf(before=f'<compiler angle="{unit}"/>{include}') for unit in ("degree", "radian")}
    models = [write(f"{unit}.xml", each) for unit, each in texts.items()]
    made = fixing(*models, unsafe=True)
    problems = [f.message for f in made.results[0].findings if f.code == "MJ007"]  # type: ignore[attr-defined]
    assert problems == ["MJ305 is not fixed: it would also change jnt_range of j in radian.xml"]
    assert Path(part).read_text() == text


def test_only_the_words_at_fault_change_in_a_file_of_any_form() -> None:
    text = f"\ufeff<?xml version='1.0'?>\r\n<!-- \u00e9 -->\r\n{hinged(SWAPPED)}\r\n<!-- {SWAPPED} -->"
    Path("model.xml").write_bytes(text.encode())
    assert fix("model.xml") == {"model.xml": {"MJ302": 1}}
    assert Path("model.xml").read_bytes() == text.replace(SWAPPED, RIGHT, 1).encode()


def test_a_comment_in_another_encoding_keeps_its_bytes() -> None:
    text = f"<?xml version='1.0' encoding='iso-8859-1'?><!-- \u00e9 -->{hinged(SWAPPED)}".encode("iso-8859-1")
    Path("model.xml").write_bytes(text)
    fix("model.xml")
    assert Path("model.xml").read_bytes() == text.replace(SWAPPED.encode(), RIGHT.encode())


def test_a_file_in_an_encoding_that_it_does_not_declare_keeps_its_bytes() -> None:
    text = f"<!-- \u00e9 -->{hinged(SWAPPED)}".encode("iso-8859-1")
    Path("model.xml").write_bytes(text)
    fix("model.xml")
    assert Path("model.xml").read_bytes() == text.replace(SWAPPED.encode(), RIGHT.encode())


def test_a_value_is_fixed_where_it_comes_from() -> None:
    part = write(
        "part.xml", f'<mujocoinclude><default><default class="c"><joint {SWAPPED}/></default></default></mujocoinclude>'
    )
    model = write("model.xml", hinged('class="c"', before='<include file="part.xml"/>'))
    assert fix(model) == {part: {"MJ302": 1}}
    assert RIGHT in Path(part).read_text()
    assert SWAPPED not in Path(model).read_text()


def test_a_part_of_several_models_is_fixed_once_and_for_all_of_them() -> None:
    part = write(
        "part.xml",
        f"<mujocoinclude><worldbody><body><joint {SWAPPED}/><geom size='1'/></body></worldbody></mujocoinclude>",
    )
    models = [write(f"{name}.xml", mjcf(before='<include file="part.xml"/>')) for name in "ab"]
    assert fix(*models) == {part: {"MJ302": 1}}
    assert fix(*models) == {}


def test_a_dry_run_changes_no_file_and_shows_what_would_change() -> None:
    model = write("model.xml", text := hinged(SWAPPED))
    made = fixing(model, dry_run=True)
    assert Path(model).read_text() == text
    assert f'-<joint name="j" {SWAPPED}/>' in made.files[0].diff
    patch = subprocess.run(["patch", "-p0"], input=made.files[0].diff, text=True, capture_output=True, check=False)
    assert patch.returncode == 0
    assert Path(model).read_text() == text.replace(SWAPPED, RIGHT)


def test_the_mode_of_a_file_and_a_link_to_it_stay() -> None:
    Path("parts").mkdir()
    model = write("parts/real.xml", hinged(SWAPPED))
    Path(model).chmod(0o640)
    Path("link.xml").symlink_to(model)
    fix("link.xml")
    assert Path("link.xml").is_symlink()
    assert RIGHT in Path(model).read_text()
    assert Path(model).stat().st_mode & 0o777 == 0o640


def test_a_link_out_of_the_folder_is_not_followed() -> None:
    Path("robots").mkdir()
    part = write(
        "part.xml",
        f"<mujocoinclude><worldbody><body><joint {SWAPPED}/><geom size='1'/></body></worldbody></mujocoinclude>",
    )
    Path("robots/part.xml").symlink_to("../part.xml")
    model = write("robots/model.xml", mjcf(before='<include file="part.xml"/>'))
    assert "outside the folders" in reasons(model)[0]
    assert SWAPPED in Path(part).read_text()
    assert reasons(model, given=["."]) == []
    assert RIGHT in Path(part).read_text()


def test_no_file_changes_if_one_is_read_only() -> None:
    part = write("part.xml", "<mujocoinclude><option mpr_iterations='5'/></mujocoinclude>")
    model = write("model.xml", hinged(SWAPPED, before='<include file="part.xml"/>'))
    texts = [Path(name).read_text() for name in (part, model)]
    Path(part).chmod(0o444)
    assert reasons(model) == ["it is read-only"]
    assert [Path(name).read_text() for name in (part, model)] == texts


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells which files are open")
def test_a_file_that_another_process_has_open_is_left_alone() -> None:
    model = write("model.xml", text := hinged(SWAPPED))
    holder = "import sys; file = open(sys.argv[1]); print(flush=True); sys.stdin.read()"
    with subprocess.Popen([sys.executable, "-c", holder, model], stdin=-1, stdout=-1) as process:
        assert process.stdout
        process.stdout.readline()
        assert reasons(model) == ["it is open in another program"]
        process.communicate()
    assert Path(model).read_text() == text
    assert reasons(model) == []


def test_a_file_that_an_editor_has_open_is_left_alone() -> None:
    model = write("model.xml", hinged(SWAPPED))
    Path(".model.xml.swp").touch()
    assert ".model.xml.swp" in reasons(model)[0]


def test_a_file_that_changes_meanwhile_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    model = write("model.xml", text := hinged(SWAPPED))
    check = fixes.lint

    def changing(name: str, copy: FixedModelCopy | None = None, **options: bool) -> FixResult:
        write(model, f"{text}<!-- new -->")
        return check(name, copy, **options)

    monkeypatch.setattr(fixes, "lint", changing)
    assert reasons(model) == ["it changed meanwhile; run the command again"]
    assert Path(model).read_text() == f"{text}<!-- new -->"


def test_a_model_that_would_still_not_load_is_left_alone() -> None:
    model = write("model.xml", text := mjcf(before='<option mpr_iterations="5"/><asset><mesh file="no.obj"/></asset>'))
    assert reasons(model) == ["MJ105 is not fixed: model.xml would still not load"]
    assert Path(model).read_text() == text


@pytest.mark.parametrize("suffix", [".zip", ".mjz", ".mjb"])
def test_a_model_without_text_is_reported_and_not_fixed(suffix: str) -> None:
    path = Path(f"model{suffix}")
    if suffix == ".mjb":
        mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(hinged(SWAPPED)), str(path))
    else:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("model.xml", hinged(SWAPPED))
    content = path.read_bytes()
    result = ModelCheck([path], fix=True, steps=0).run()
    (finding,) = result.models[0].findings
    assert (finding.code, result.fixed, path.read_bytes()) == ("MJ302", (), content)
    assert finding.remedy.endswith("fix changes the text of MJCF, not that of URDF, archives and compiled models")


def test_a_fault_that_stays_states_the_reason() -> None:
    model = write("model.xml", hinged('range="-90 90"', before='<compiler angle="radian"/>'))
    (unit,) = (each for each in lint(model).result.findings if each.code == "MJ305")
    shown = _with_reason(unit, Path(model))
    assert shown.remedy == f"{unit.remedy}\nnot fixed: {option('unsafe_fixes')} may fix it"
    (fixed,) = (each for each in lint(model, unsafe=True).result.findings if each.code == "MJ305")
    assert _with_reason(fixed, Path(model)) == fixed
    (removed,) = lint(write("model.xml", mjcf(before="<option collision='dynamic'/>"))).result.findings
    assert removed.unfixed == NOT_CERTAIN


@pytest.mark.parametrize("name", ["model.urdf", "model.xml"])
def test_a_urdf_is_reported_and_not_fixed(name: str) -> None:
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    ball = '<collision><geometry><sphere radius="1"/></geometry></collision>'  # the balls of both links overlap
    link = f'<link name="{{}}">{inertia}{ball}</link>'
    limit = '<axis xyz="0 0 1"/><limit lower="1" upper="-1" effort="1" velocity="1"/>'
    joint = f'<joint name="j{{0}}" type="revolute"><parent link="a"/><child link="{{0}}"/>{limit}</joint>'
    moving = "".join(f"{link.format(name)}{joint.format(name)}\n" for name in "bc")
    text = f'<robot name="r"><link name="a"/>{moving}</robot>'
    model = write(name, text)
    made = fixing(model, unsafe=True)
    found = [finding.code for finding in made.results[0].findings]  # type: ignore[attr-defined]
    assert ({"MJ302", "MJ501"} - {*found}, "MJ007" in found, made.files) == (set(), False, [])
    assert Path(model).read_text() == text


def test_an_attached_urdf_is_not_edited_either() -> None:
    inertia = '<inertial><mass value="1"/><inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial>'
    link = f'<link name="a">{inertia}<collision><geometry><sphere radius="1"/></geometry></collision></link>'
    joint = '<joint name="j" type="continuous"><parent link="base"/><child link="a"/></joint>'
    write("arm.urdf", f'<robot name="r"><link name="base"/>{link}{joint}</robot>')
    asset = '<asset><model name="m" file="arm.urdf"/></asset>'
    model = write("model.xml", mjcf('<attach model="m" body="a" prefix="l_"/>', before=asset))
    made = fixing(model, unsafe=True)
    assert made.files == []
    assert "MJ206" in [finding.code for finding in made.results[0].findings]  # type: ignore[attr-defined]


def test_fixes_of_the_command_are_those_of_the_processes() -> None:
    model = write("model.xml", hinged(SWAPPED, before='<option mpr_iterations="5"/>'))
    result = ModelCheck([model], fix=True, steps=0).run()
    assert (result.code, result.written) == (0, True)
    assert result.fixed[0].fixes == {"MJ105": 1, "MJ302": 1}
    assert codes(result.models[0]) == []
    assert mujoco.MjModel.from_xml_path(model).jnt_limited[0]
    assert [path.name for path in Path().iterdir()] == [model]


def test_fixes_that_a_full_disk_refuses_change_nothing_and_exit_as_a_failed_output(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    model = write("model.xml", text := hinged(SWAPPED))
    monkeypatch.setattr("mjrun.formats.output_writer.os.fsync", full)
    result = ModelCheck([model], fix=True, steps=0).run()
    (reason,) = (finding.message for finding in result.models[0].findings if finding.code == "MJ007")
    assert reason.endswith("cannot be written: No space left on device")
    assert (result.code, result.written) == (7, False)
    assert Path(model).read_text() == text
    assert [path.name for path in Path().iterdir()] == [model]


def test_reasons_name_options_as_the_caller_does() -> None:
    Path("robots").mkdir()
    write("model.xml", hinged(SWAPPED))
    Path("robots/model.xml").symlink_to("../model.xml")
    result = ModelCheck(["robots"], fix=True, steps=0).run(spelling=lambda name: f"--{name}")
    (reason,) = (finding.message for finding in result.models[0].findings if finding.code == "MJ007")
    assert reason.endswith("with --fix")


def test_safe_fixes_go_on_if_unsafe_ones_take_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    run = CheckProcessPool.run

    def late(self: CheckProcessPool, task: CheckRequest) -> CheckProcessOutput:
        if task.unsafe:
            return CheckProcessOutput([{"stage": "applying MJ506"}], ExitStatus(-9, "time"), "")
        return run(self, task)

    monkeypatch.setattr(CheckProcessPool, "run", late)
    model = write("model.xml", hinged(SWAPPED))
    result = ModelCheck([model], fix=True, unsafe_fixes=True, steps=0, cache=False).run()
    assert [dict(file.fixes) for file in result.fixed] == [{"MJ302": 1}]
    (reason,) = result.models[0].findings
    assert (reason.code, reason.file) == ("MJ007", model)
    assert reason.message.endswith("is left out: not finished after 60 s, while applying MJ506")


def test_known_findings_are_not_fixed() -> None:
    model = write("model.xml", text := hinged(SWAPPED))
    ModelCheck([model], baseline="known.json", update_baseline=True, steps=0).run()
    result = ModelCheck([model], baseline="known.json", fix=True, steps=0).run()
    assert (result.fixed, result.models[0].known) == ((), 1)
    assert Path(model).read_text() == text


def test_a_model_of_a_collection_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "package").mkdir()
    model = write(str(tmp_path / "package/model.xml"), hinged(SWAPPED))
    assert "belongs to a collection" in reasons(model, given=["gym:Model"])[0]


def two(joints: tuple[str, str] = ('range="-1 1"', 'range="-1 1"'), after: str = "") -> str:
    """A model with joints `j` and `n` in radians, each in a body."""
    other = f'<body pos="9 0 0"><joint name="n" {joints[1]}/><geom size=".1"/></body>'
    return hinged(joints[0], after=after, before='<compiler angle="radian"/>', world=other)


INERTIAL = '<body pos="{} 0 0"><joint/><inertial pos="0 0 0" mass="1" diaginertia="{}"/><geom size=".1"/></body>'
TENDON = '<fixed name="{}" range="{}"><joint joint="j" coef="1"/></fixed>'
MOTOR = '<motor name="{}" joint="j" ctrlrange="{}"/>'
# The rule, a kind of objects, a model whose first one is at fault, and what changes if the second is edited instead.
NEIGHBOURS = [
    (
        "MJ206",
        "body",
        mjcf(INERTIAL.format(0, "9 9 9") + INERTIAL.format(5, ".003 .003 .003")),
        "body_inertia of body:2",
    ),
    ("MJ302", "joint", two(('range="1 -1"', 'range="-1 1"')), "jnt_limited of n"),
    (
        "MJ302",
        "tendon",
        two(after=f"<tendon>{TENDON.format('t', '1 -1')}{TENDON.format('u', '-1 1')}</tendon>"),
        "tendon_limited of u",
    ),
    (
        "MJ302",
        "actuator",
        two(after=f"<actuator>{MOTOR.format('t', '1 -1')}{MOTOR.format('u', '-1 1')}</actuator>"),
        "actuator_ctrllimited of u",
    ),
    ("MJ305", "joint", two(('range="-90 90"', 'range="-1 1"')), "jnt_range of n"),
    (
        "MJ402",
        "keyframe",
        two(after='<keyframe><key qpos="2 0"/><key qpos="0 0"/></keyframe>'),
        "key_qpos of keyframe:1",
    ),
]


@pytest.mark.parametrize(("rule", "kind", "text", "change"), NEIGHBOURS, ids=[f"{a}-{b}" for a, b, *_ in NEIGHBOURS])
def test_a_fix_that_edits_a_neighbour_is_left_out(
    rule: str, kind: str, text: str, change: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = write("model.xml", text)
    assert fix(model, unsafe=True) == {model: {rule: 1}}
    element, faulty = CheckContext.element, (kind, kind == "body")
    monkeypatch.setattr(CheckContext, "element", lambda self, of, i: element(self, of, i + ((of, i) == faulty)))
    write(model, text)
    assert reasons(model, unsafe=True) == [f"{rule} is not fixed: it would also change {change} in model.xml"]
    assert Path(model).read_text() == text


@pytest.mark.parametrize("other", ['type="slide"', 'limited="false"'])
def test_a_default_class_is_left_alone_where_a_joint_without_the_fault_inherits_it(other: str) -> None:
    right = "".join(f'<body pos="{x} 0 0"><joint range="-90 90"/><geom size=".1"/></body>' for x in (3, 5))
    default = '<default><default class="c"><joint range="-90 90"/></default></default>'
    text = two(('class="c"', f'class="c" {other}'), default)
    model = write("model.xml", text.replace("</worldbody>", f"{right}</worldbody>"))
    assert reasons(model, unsafe=True) == ["MJ305 is not fixed: it would also change jnt_range of n in model.xml"]
    assert Path(model).read_text().count('range="-90 90"') == 1
