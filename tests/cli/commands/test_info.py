"""`mjrun info` as a user runs it."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import pytest
from rich.cells import cell_len

from mjrun.cli.commands.schema import schema_of
from mjrun.cli.info_sections import SECTIONS as SHOWN
from mjrun.cli.info_sections import LineSection
from mjrun.cli.terminal_layout import TerminalReport
from mjrun.errors import BrokenModelError, clean
from mjrun.model.info import SECTIONS, Info, ModelDescription
from tests.document.schema_oracle import fits
from tests.reporters import RecordingReporter

if TYPE_CHECKING:
    from tests.conftest import Command

ROOT = Path(__file__).parents[3]
SCENES = sorted((ROOT / "scenes").glob("*.xml"))
HUMANOID = ROOT / "scenes/humanoid.xml"

HOSTILE = """<mujoco model="&#x1b;]0;owned&#x7;"><worldbody><body name="a&#x1b;[31m"><joint name="[bold]j[/bold]"/>
<geom name="x&#xa;y" size=".1"/><body name="字幕"><geom size="1"/></body></body></worldbody></mujoco>"""


def lines(done: subprocess.CompletedProcess[bytes]) -> list[str]:
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode().splitlines()


@pytest.mark.parametrize("scene", SCENES, ids=lambda path: path.stem)
def test_the_page_names_what_the_document_names(mjrun_here: Command, scene: Path) -> None:
    document = json.loads(mjrun_here("info", scene, "--json").stdout)
    assert [*document] == [*SECTIONS, "warnings", "schema"]
    schema = schema_of("info")
    assert fits(document, schema, schema)
    page = mjrun_here("info", scene, *SECTIONS).stdout.decode()
    for section in SECTIONS:
        rows = document[section] if isinstance(document[section], list) else []
        assert f"\n{section}  {len(rows) or 'none'}\n" in page or section in ("summary", "statistics")
        assert all(clean(str(row.get("name") or row.get("path"))) in page for row in rows)
    model = mujoco.MjModel.from_xml_path(str(scene))
    assert f"nq={model.nq}  nv={model.nv}  na={model.na}  nu={model.nu}" in page
    assert f"  mass            {mujoco.mj_getTotalmass(model):.5g} kg" in page


@pytest.mark.parametrize(
    ("scene", "width"),
    [*((scene, 80) for scene in SCENES), (HUMANOID, 40), (HUMANOID, 160)],
    ids=lambda v: getattr(v, "stem", v),
)
def test_no_line_is_wider_than_the_terminal(mjrun_here: Command, scene: Path, width: int) -> None:
    told = lines(mjrun_here("info", scene, *SECTIONS, env={"COLUMNS": str(width)}))
    assert max(len(line) for line in told if not line.startswith("  file ")) <= width  # which is never broken


@pytest.mark.parametrize("width", [45, 80])
@pytest.mark.parametrize("scene", ["humanoid", "pinata"])
def test_names_and_types_stay_whole_and_what_has_no_room_is_named(mjrun_here: Command, scene: str, width: int) -> None:
    path = ROOT / f"scenes/{scene}.xml"
    document = json.loads(mjrun_here("info", path, "--json").stdout)
    for section, field in (("joints", "type"), ("geoms", "type"), ("actuators", "kind"), ("sensors", "type")):
        told = lines(mjrun_here("info", path, section, env={"COLUMNS": str(width)}))
        assert max(map(len, told)) <= width
        rows = [line.split() for line in told if line.startswith("  ")]
        pairs = [[row["name"], row[field]] for row in document[section] if len(row["name"]) <= 20]
        assert all(pair in [row[:2] for row in rows] for pair in pairs)
        whole = lines(mjrun_here("info", path, section))
        _, _, left_out = " ".join(line.strip() for line in told).partition("no room for ")
        assert left_out or max(map(len, whole)) <= width
        assert all(heading in whole[1] for heading in left_out.partition(";")[0].split(", "))


def test_in_a_pipe_every_object_is_one_line_without_escapes_or_spaces_at_the_end(mjrun_here: Command) -> None:
    told = lines(mjrun_here("info", HUMANOID, "joints"))
    joints = json.loads(mjrun_here("info", HUMANOID, "joints", "--json").stdout)["joints"]
    assert [line.split()[0] for line in told[-len(joints) :]] == [joint["name"] for joint in joints]
    assert all(line == line.rstrip() and "\x1b" not in line for line in told)


@pytest.mark.parametrize("more", [{}, {"NO_COLOR": "1"}])
def test_on_a_terminal_headings_stand_out_without_colours(mjrun: Command, more: dict[str, str]) -> None:
    ours, theirs = os.openpty()
    done = mjrun("info", HUMANOID, "sensors", env={"TERM": "xterm-256color", **more}, stdout=theirs)
    os.close(theirs)
    told = os.read(ours, 1 << 16)
    os.close(ours)
    assert done.returncode == 0
    assert b"\x1b[1msensors\x1b[0m" in told
    assert b"\x1b[3" not in told


def test_a_folded_tree_keeps_its_branches(mjrun_here: Command, tmp_path: Path) -> None:
    joints = "".join(f'<joint name="joint_number_{i}" type="slide" axis="1 0 {i}"/>' for i in range(5))
    path = tmp_path / "tree.xml"
    path.write_text(
        f'<mujoco><worldbody><body name="a">{joints}<geom size="1"/><body name="b"><geom size="1"/></body></body>'
        '<body name="c"/></worldbody></mujoco>'
    )
    told = lines(mjrun_here("info", path, "bodies", env={"COLUMNS": "60"}))
    stems = [line[2:10].rstrip() for line in told[3:]]
    assert stems[:2] == ["world", "├─ a"]
    end = stems.index("│  └─ b")
    assert end > 3
    assert set(stems[2:end]) == {"│  │"}
    assert stems[end + 1] == "└─ c"


def test_a_long_section_is_cut_unless_it_is_asked_for(mjrun_here: Command, tmp_path: Path) -> None:
    path = tmp_path / "many models.xml"
    bodies = "".join(f'<body name="b{i}"><freejoint name="j{i}"/><geom size="1"/></body>' for i in range(40))
    path.write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    page = "\n".join(lines(mjrun_here("info", path)))
    assert f"… 17 more: mjrun info '{path}' bodies\n" in page
    assert "j23" in page
    assert "j24" not in page
    assert "more" not in (whole := "\n".join(lines(mjrun_here("info", path, "bodies", "joints"))))
    assert "j39" in whole
    assert "also geoms (40), statistics: mjrun info " in page


def test_sections_come_in_the_order_asked_for_and_may_be_empty(mjrun_here: Command) -> None:
    told = lines(mjrun_here("info", ROOT / "scenes/pendulum.xml", "plugins", "joints"))
    assert told[0] == "plugins  none"
    assert told[2].startswith("joints  ")


def test_a_wrong_section_names_the_nearest(mjrun_here: Command) -> None:
    done = mjrun_here("info", HUMANOID, "actuator")
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.startswith(b"mjrun: error: no section 'actuator' (did you mean 'actuators'?)\n")


def test_columns_are_those_that_trace_lists(mjrun_here: Command) -> None:
    scene = ROOT / "scenes/pinata.xml"
    assert (
        mjrun_here("info", scene, "--columns", "--json").stdout == mjrun_here("trace", scene, "--list", "--json").stdout
    )
    listed = [line.split()[0] for line in lines(mjrun_here("trace", scene, "--list", "--all"))]
    assert [line.split()[0] for line in lines(mjrun_here("info", scene, "--columns"))] == listed
    assert mjrun_here("info", scene, "joints", "--columns").returncode == 2


def test_overrides_apply(mjrun_here: Command) -> None:
    overrides = ["--timestep", "0.0005", "--integrator", "rk4", "--set", "opt.gravity=0,0,-1.62"]
    found = json.loads(mjrun_here("info", ROOT / "scenes/pendulum.xml", "options", *overrides, "--json").stdout)
    values = {setting["path"]: setting["value"] for setting in found["options"]}
    assert values["opt.gravity"] == [0, 0, -1.62]
    assert (values["opt.timestep"], values["opt.integrator"]) == (0.0005, "rk4")


def test_names_are_cleaned_and_are_no_markup(mjrun_here: Command, tmp_path: Path) -> None:
    path = tmp_path / "hostile.xml"
    path.write_text(HOSTILE, "utf-8")
    page = "\n".join(lines(mjrun_here("info", path, *SECTIONS)))
    assert "\x1b" not in page
    assert "\x07" not in page
    for name in (r"a\x1b[31m", "[bold]j[/bold]", r"x\ny", r"\x1b]0;owned\x07", "字幕"):
        assert name in page
    document = json.loads(mjrun_here("info", path, "--json").stdout)
    assert document["bodies"][1]["name"] == "a\x1b[31m"


def test_stderr_is_silent_where_there_is_nothing_to_say_and_no_log_is_left(mjrun_here: Command) -> None:
    done = mjrun_here("info", ROOT / "scenes/pendulum.xml")
    assert (done.returncode, done.stderr) == (0, b"")
    assert mjrun_here.files() == []


def test_a_model_that_is_not_there_ends_with_three(mjrun_here: Command) -> None:
    done = mjrun_here("info", ROOT / "scenes/pendulm.xml", "--json")
    assert (done.returncode, [*json.loads(done.stdout)]) == (3, ["error"])
    assert b"did you mean 'pendulum.xml'" in done.stderr


@pytest.mark.parametrize("command", ["info", "bench", "trace"])
def test_a_model_that_mujoco_refuses_is_sent_to_check_which_says_more(
    mjrun_here: Command, tmp_path: Path, command: str
) -> None:
    path = tmp_path / "a b.xml"
    path.write_text('<mujoco><worldbody><geom szie="1"/></worldbody></mujoco>')
    done = mjrun_here(command, path)
    assert done.returncode == 3
    *_, last = done.stderr.decode().splitlines()
    assert last == f"  mjrun check '{path}' shows the place and a remedy"
    assert "write size" in (checked := mjrun_here("check", path).stdout.decode())
    assert "says where" not in checked
    assert b"says where" not in mjrun_here(command, HUMANOID, "--set", "geom/floor.material=none").stderr


def page_of(found: ModelDescription) -> str:
    """All sections, in the columns that fit into the terminal."""
    page = TerminalReport()
    for name, section in SHOWN.items():
        if isinstance(section, LineSection):
            page.lines(name, section.lines(found))
        else:
            rows = found.section(name)
            page.table(name, section.columns(rows, found.model), len(rows))
    return page.text()


def test_every_real_model_has_a_document_and_a_page_or_is_refused(
    shared_models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    described = 0
    # tests/scoreboard/every_model.py tries all of them.
    for path in sorted([*shared_models.rglob("*.xml"), *SCENES])[::5]:
        reporter = RecordingReporter()
        try:
            result = Info(path).run(reporter)
        except BrokenModelError:
            assert "malformed" in path.parts
            continue
        assert len(reporter.warnings) == len(result.warnings)
        document = json.loads(json.dumps(result.document(), allow_nan=False))
        assert document["summary"]["file"] == str(path)
        description = result.description
        assert description.summary.mass == mujoco.mj_getTotalmass(description.model)
        assert all(asset.bytes for asset in description.assets if asset.path)
        described += 1

        text = page_of(description)
        without_path = (line for line in text.splitlines() if str(path) not in line)  # a path is never broken
        assert all(cell_len(line) <= 80 for line in without_path)
        assert text.count("\n\n") == len(SECTIONS) - 1
    assert described > 5


def test_malformed_models_are_shown_or_refused_without_a_traceback(mjrun_here: Command, shared_models: Path) -> None:
    for path in sorted(shared_models.glob("malformed/*.xml")):
        done = mjrun_here("info", path)
        assert done.returncode in (0, 3), done.stderr.decode()
        assert b"Traceback" not in done.stderr
        assert bool(done.stdout) == (done.returncode == 0)


def test_an_environment_is_a_model_and_with_sections_of_a_task_one(mjrun_here: Command) -> None:
    assert lines(mjrun_here("info", "gym:Hopper-v5"))[-1].endswith("task observations actions rewards terminations")
    page = lines(mjrun_here("info", "gym:Hopper-v5", "task", "actions"))
    assert "  control period      0.008 s, 4 steps of 0.002 s" in page
    document = json.loads(mjrun_here("info", "gym:Hopper-v5", "observations", "--json").stdout)
    assert [row["name"] for row in document["observations"]][:2] == ["qpos/rootz", "qpos/rooty"]
    assert b"no section 'actions'" in mjrun_here("info", "gym:Hopper-v5", "actions", "bodies").stderr


def test_a_collection_is_listed_a_line_each(mjrun_here: Command) -> None:
    models = json.loads(mjrun_here("info", "scene:", "--json").stdout)["models"]
    names = [*(path.stem for path in SCENES), "car_drive", "humanoid_stand", "pendulum_swing_up"]
    assert [model["name"] for model in models] == [f"scene:{name}" for name in sorted(names)]
    page = lines(mjrun_here("info", "scene:"))
    assert [line.split(maxsplit=1) for line in page] == [[model["name"], model["description"]] for model in models]


def test_a_collection_has_neither_sections_nor_columns(mjrun_here: Command) -> None:
    for arguments in (["joints"], ["--columns"]):
        done = mjrun_here("info", "scene:", *arguments)
        assert done.returncode == 3
        assert done.stderr.decode().startswith("mjrun: error: scene: name the scene\n")
