"""Theorems about checking models: whatever a file does to its process is a finding like any other."""

import json
import os
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from mjrun.check import simulation_rules
from mjrun.check.check import Check, Checked, CheckResult, matching
from mjrun.check.context import LintContext
from mjrun.check.finding import Finding
from mjrun.check.rule_table import RULES
from mjrun.check.worker_processes import MOST_TOLD, Children, Drain
from mjrun.check.xml_source import read
from mjrun.errors import UsageError

FINE = '<mujoco><worldbody><body name="b"><joint name="j" {}/><geom size=".1" pos="1 0 0"/></body></worldbody></mujoco>'
LIMITS = {"timeout": 30.0, "memory": 1024}


@pytest.fixture(autouse=True)
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(name: str, text: str) -> str:
    Path(name).write_text(text)
    return name


def checked(*models: str, **settings: object) -> CheckResult:
    return Check(models, **{**LIMITS, **settings}).run()  # type: ignore[arg-type]


def codes(model: Checked) -> list[str]:
    return [finding.code for finding in model.findings]


def circle() -> list[str]:
    """Two models that attach each other, which crashes MuJoCo 4.0.0."""
    for own, other in ("ab", "ba"):
        attach = f'<attach model="m" prefix="x" body="{other}"/>'
        asset = f'<asset><model name="m" file="{other}.xml"/></asset>'
        write(f"{own}.xml", f'<mujoco>{asset}<worldbody><body name="{own}">{attach}</body></worldbody></mujoco>')
    return ["a.xml", "b.xml"]


def test_a_model_that_is_well_is_found_well() -> None:
    result = checked(write("fine.xml", FINE.format("")))
    assert result == CheckResult((Checked("fine.xml", True, ()),), 0, 0)


def test_results_keep_the_order_given_however_many_are_looked_at_at_once() -> None:
    names = [f"{i}.xml" for i in range(6)]
    for name in names:
        write(name, FINE.format('range="2 1"' if name in ("1.xml", "4.xml") else ""))
    one, many = checked(*names, jobs=1), checked(*names, jobs=4)
    assert one == many
    assert [model.model for model in many.models] == names
    assert [codes(model) for model in many.models] == [[], ["MJ302"], [], [], ["MJ302"], []]


def test_a_crash_is_a_finding_and_the_other_models_are_looked_at() -> None:
    result = checked(*circle(), write("fine.xml", FINE.format("")))
    assert [model.loads for model in result.models] == [False, False, True]
    (crash,) = result.models[0].findings
    assert crash.code == "MJ002"
    assert crash.message == "its process ended by SIGSEGV while loading it"
    assert result.code == 3


def test_a_model_that_is_refused_before_it_attaches_a_circle_is_explained() -> None:
    model, _ = circle()
    text = Path(model).read_text()
    for mistake, code in (('<option solver="x"/>', "MJ110"), ("<goem/>", "MJ102")):
        write(model, text.replace("<mujoco>", f"<mujoco>{mistake}"))
        assert codes(checked(model).models[0]) == [code]


def test_a_model_that_attaches_itself_is_a_crash_whose_cause_is_told() -> None:
    asset = '<asset>\n<model name="me" file="self.xml"/></asset>'
    attach = '<attach model="me" prefix="x" body="b"/>'
    write("self.xml", f'<mujoco>{asset}<worldbody><body name="b">{attach}</body></worldbody></mujoco>')
    (model,) = checked("self.xml").models
    assert codes(model)[0] == "MJ113"
    assert model.findings[0].line == 2
    assert not model.loads


def test_a_pipe_among_the_files_is_told_and_its_wait_has_an_end() -> None:
    os.mkfifo("pipe.obj")
    write("model.xml", '<mujoco>\n<asset><mesh file="pipe.obj"/></asset></mujoco>')
    (model,) = checked("model.xml", timeout=1.5).models
    assert not model.loads
    assert codes(model)[-1] == "MJ003"
    assert "not done after 1.5 s" in model.findings[-1].message


def test_a_pipe_for_a_model_is_refused_at_once() -> None:
    os.mkfifo("pipe.xml")
    (model,) = checked("pipe.xml").models
    assert codes(model) == ["MJ001"]
    assert model.findings[0].message == "is not a regular file"


def test_a_model_that_takes_too_long_is_a_finding() -> None:
    result = checked(write("fine.xml", FINE.format("")), timeout=0.001)
    assert codes(result.models[0]) == ["MJ003"]
    assert result.code == 3


@pytest.mark.parametrize(
    "text",
    [
        '<asset><texture name="t" type="2d" builtin="flat" width="60000" height="60000"/></asset>',
        '<size memory="900G"/><worldbody><body><freejoint/><geom size="1"/></body></worldbody>',
    ],
    ids=["texture", "arena"],
)
def test_a_model_that_explodes_is_a_finding(text: str) -> None:
    result = checked(write("big.xml", f"<mujoco>{text}</mujoco>"), memory=300)
    assert codes(result.models[0]) == ["MJ004"]
    assert result.code == 3


def test_an_arena_that_is_large_and_not_filled_is_no_memory() -> None:
    text = FINE.format("").replace("<mujoco>", '<mujoco><size memory="1G"/>')
    assert checked(write("wide.xml", text), memory=1200).code == 0


def test_nothing_is_written_and_nothing_is_read_from_stdin() -> None:
    write("nan.xml", FINE.format('damping="nan"'))
    before = sorted(Path().iterdir())
    code = "from mjrun.check.check import Check; print(Check(['nan.xml']).run().models[0].findings[0].code)"
    done = subprocess.run([sys.executable, "-c", code], input="unread", capture_output=True, text=True)
    assert done.stdout == "MJ115\n"
    assert sorted(Path().iterdir()) == before


def test_a_folder_of_models_is_no_place_for_modules() -> None:
    for name in ("json.py", "mujoco.py", "numpy.py", "mjrun.py"):
        write(name, "raise SystemExit(9)")
    assert checked(write("fine.xml", FINE.format(""))).code == 0


def test_a_part_that_models_include_is_skipped_wherever_it_is_given() -> None:
    Path("parts").mkdir()
    part = write("parts/arm.xml", "<mujocoinclude/>")
    fine = write("fine.xml", FINE.format(""))
    assert checked(part, fine) == CheckResult((Checked("fine.xml", True, ()),), 1, 0)
    assert checked(part) == CheckResult((), 1, 0)
    with pytest.raises(UsageError, match="there is no model to check"):
        checked("parts")


@pytest.mark.parametrize(
    ("fail_on", "code"),
    [("error", 0), ("warning", 1), ("note", 1)],
)
def test_the_answer_is_no_from_the_severity_asked_for_on(fail_on: str, code: int) -> None:
    assert checked(write("warned.xml", FINE.format('range="2 1"')), fail_on=fail_on).code == code


def test_codes_are_chosen_by_their_beginnings() -> None:
    name = write("two.xml", FINE.format('range="2 1"').replace("</worldbody>", "<camera/></worldbody>"))
    assert codes(checked(name).models[0]) == ["MJ201", "MJ302", "MJ601"]
    assert codes(checked(name, select=["mj3", "MJ201"]).models[0]) == ["MJ201", "MJ302"]
    assert codes(checked(name, ignore=["MJ2", "MJ601"]).models[0]) == ["MJ302"]
    assert codes(checked(name, select=["MJ3"], ignore=["MJ302"]).models[0]) == []


def test_what_keeps_a_model_from_loading_is_told_whatever_is_chosen() -> None:
    name = write("limit.xml", FINE.format('limited="true"'))
    assert codes(checked(name, select=["MJ6"], ignore=["MJ3"]).models[0]) == ["MJ303"]


def test_all_codes_begin_with_nothing_short_of_a_letter() -> None:
    assert matching(["MJ"]) == frozenset(RULES)
    assert matching(["mj70"]) == {code for code in RULES if code.startswith("MJ70")}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"select": ["MJ9"]}, "no code 'MJ9' (did you mean"),
        ({"ignore": [""]}, "no code ''"),
        ({"fail_on": "never"}, "no severity 'never'"),
        ({"steps": -1}, "--steps: '-1' is not a whole number from 0 on"),
        ({"memory": 0}, "--memory: '0' is not"),
        ({"timeout": 0.0}, "--timeout: '0.0' is not"),
        ({"jobs": 0}, "--jobs: '0' is not"),
    ],
)
def test_what_cannot_be_meant_is_refused(settings: dict, message: str) -> None:
    with pytest.raises(UsageError) as error:
        Check(["a.xml"], **settings)
    assert message in str(error.value)


def test_a_folder_without_models_is_refused(workplace: Path) -> None:
    with pytest.raises(UsageError, match="there is no model to check"):
        checked(str(workplace))


def test_a_fault_of_a_rule_is_a_finding_and_the_other_rules_look_on(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from mjrun.check.worker import Examination

    def broken(subject: LintContext) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setitem(RULES, "MJ201", RULES["MJ201"]._replace(find=broken))  # type: ignore[arg-type]
    job = {"path": write("a.xml", FINE.format('range="2 1"')), "codes": ["MJ201", "MJ302"], "steps": 0, "memory": 9999}
    with open("said", "w+") as channel:  # noqa: PTH123
        Examination(job, channel).run()
        channel.seek(0)
        said = [json.loads(line)["finding"] for line in channel if "finding" in line]
    assert [finding["code"] for finding in said] == ["MJ005", "MJ302"]
    assert said[0]["message"] == "the rule MJ201 fails: ZeroDivisionError: planted"


# --- motion ---------------------------------------------------------------------------------------


def moved(text: str, steps: int = 200) -> dict[str, str]:
    """Codes and messages of what motion shows."""
    path = Path(write("moved.xml", text))
    found = simulation_rules.sightings(LintContext.load(path, read(path)), steps)
    return {code: sighting.message for code, sighting in found}


def swinging(joint: str = "", option: str = "", world: str = "") -> str:
    """A pendulum."""
    text = FINE.format(joint).replace("<mujoco>", f"<mujoco><option {option}/>")
    return text.replace("</worldbody>", f"{world}</worldbody>")


UNSTABLE = swinging('axis="0 1 0" stiffness="1e7"', 'timestep=".01"')


def test_an_unstable_simulation_is_an_error_at_the_step_that_a_bare_loop_finds() -> None:
    model = mujoco.MjModel.from_xml_string(UNSTABLE)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data, steps = mujoco.MjData(model), 0
    while steps < 200:
        mujoco.mj_step(model, data)
        bad = any(data.warning[kind].number for kind in (3, 4, 5))  # QPOS, QVEL, QACC
        if bad or max(abs(data.qpos[0]), abs(data.qvel[0])) > mujoco.mjMAXVAL:
            break
        steps += 1
    told = moved(UNSTABLE)
    assert list(told) == ["MJ701"]
    assert f"became unstable at step {steps}, " in told["MJ701"]
    assert RULES["MJ701"].severity == "error"


@pytest.mark.parametrize(
    ("text", "gains"),
    [
        (swinging('axis="0 1 0"'), False),
        (swinging('axis="0 1 0" damping=".1"'), False),
        (swinging('axis="0 1 0" damping="-20"'), True),
        (swinging('type="slide" axis="0 0 1"', world='<geom name="in" size=".5" pos="1 0 -.2"/>'), True),
        (swinging('axis="0 1 0" damping="-20"').replace('name="b"', 'name="b" gravcomp="1"'), False),
        (swinging('axis="0 1 0" damping="-20"', 'wind="1 0 0"'), False),
    ],
    ids=["free", "damped", "driven by damping", "pushed out", "with gravcomp", "in wind"],
)
def test_energy_that_grows_with_nothing_to_drive_it_is_told(text: str, gains: bool) -> None:
    assert ("MJ702" in moved(text)) == gains


def test_energy_is_that_of_a_bare_loop() -> None:
    text = swinging('axis="0 1 0" damping="-20"', 'timestep=".001"').replace(
        "/>", '><flag energy="enable"/></option>', 1
    )
    model = mujoco.MjModel.from_xml_string(text)
    data, totals = mujoco.MjData(model), []
    for _ in range(200):
        mujoco.mj_forward(model, data)
        totals.append(sum(data.energy))
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    totals.append(sum(data.energy))
    expected = max(totals[i] for i in range(0, 201, 4)) - totals[0]
    assert f"its energy grows by {expected:.3g} J" in moved(text)["MJ702"]


def test_a_motor_at_work_makes_a_model_no_passive_one() -> None:
    motor = '<actuator><general name="m" joint="j" biastype="affine" biasprm="500 0 0"/></actuator>'
    text = swinging('axis="0 1 0"').replace("</worldbody>", f"</worldbody>{motor}")
    assert moved(text) == {}
    assert "MJ702" in moved(text.replace("500 0 0", "0 0 0").replace('axis="0 1 0"', 'axis="0 1 0" damping="-20"'))


def test_warnings_of_mujoco_are_told() -> None:
    balls = "".join(f'<body pos="{i * 0.01} 0 0"><freejoint/><geom size=".1"/></body>' for i in range(12))
    text = f'<mujoco><size memory="60K"/><worldbody>{balls}</worldbody></mujoco>'
    told = moved(text, 5)
    assert set(told) & {"MJ703", "MJ704"}


def test_without_steps_nothing_moves() -> None:
    assert moved(UNSTABLE, 0) == {}


# --- processes ------------------------------------------------------------------------------------


def test_what_a_process_says_is_kept_from_its_beginning_to_a_limit() -> None:
    read_end, write_end = os.pipe()
    with os.fdopen(read_end, "rb") as pipe:
        drain = Drain(pipe, 10)
        with os.fdopen(write_end, "wb") as into:
            into.write(b"0123456789" * MOST_TOLD)
        assert drain.result() == b"0123456789"


def test_children_that_were_ended_start_no_more() -> None:
    children = Children()
    children.end()
    assert children.run("{}", 1, 1).lines == ()


def test_counts_are_of_all_models() -> None:
    noted = Finding("MJ201", "note", "", "a.xml")
    result = CheckResult((Checked("a", True, (noted,)), Checked("b", True, (noted, noted))), 0, 0)
    assert (result.count("note"), result.count("error")) == (3, 0)
