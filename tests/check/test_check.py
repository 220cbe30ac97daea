"""Theorems about checking models."""

import os
import threading
from pathlib import Path
from typing import Any

import pytest

from mjrun.check import check as check_module
from mjrun.check.check import CheckResult, ModelCheck, ModelCheckResult, find_models, root_tag
from mjrun.check.finding import Finding
from mjrun.check.rule_catalogue import matching_codes
from mjrun.check.rule_runner import RULES
from mjrun.check.worker_pool import CheckProcessOutput, CheckProcessPool, CheckRequest
from mjrun.errors import UsageError
from tests.cases import cases
from tests.check.models import PASSIVE, checked, codes, write
from tests.processes import PATIENCE


def test_results_keep_the_order_given_however_many_are_checked_at_once() -> None:
    names = [f"{i}.xml" for i in range(3)]
    for name in names:
        write(name, PASSIVE.format('range="2 1"' if name == "1.xml" else ""))
    one, many = checked(*names, jobs=1), checked(*names, jobs=3)
    assert one == many
    assert [(model.model, codes(model)) for model in many.models] == [
        ("0.xml", []),
        ("1.xml", ["MJ302"]),
        ("2.xml", []),
    ]


def test_a_part_that_models_include_is_skipped_wherever_it_is_given() -> None:
    Path("parts").mkdir()
    part = write("parts/arm.xml", "<mujocoinclude/>")
    fine = write("fine.xml", PASSIVE.format(""))
    assert checked(part, fine) == CheckResult((ModelCheckResult("fine.xml", True, ()),), 1, 0)
    assert checked(part) == CheckResult((), 1, 0)
    with pytest.raises(UsageError, match="no model to check"):
        checked("parts")


@pytest.mark.parametrize(("fail_on", "code"), [("error", 0), ("warning", 1), ("note", 1)])
def test_the_exit_code_is_1_from_the_chosen_severity_on(fail_on: Any, code: int) -> None:
    warned = ModelCheckResult("a", True, (Finding("MJ302", "warning", "", "a.xml"),))
    check = ModelCheck(["a.xml"], fail_on=fail_on)
    assert check._exit_code([warned]) == code
    assert check._exit_code([warned, ModelCheckResult("b", False, ())]) == 3


@pytest.mark.slow
def test_codes_are_chosen_by_their_beginnings() -> None:
    chosen = {code for code in RULES if code.startswith("MJ3")}
    assert ModelCheck(["a.xml"], select=["mj3", "MJ201"]).codes == chosen | {"MJ201"}
    assert ModelCheck(["a.xml"], ignore=["MJ2", "MJ601"]).codes == {
        c for c in RULES if not c.startswith(("MJ2", "MJ601"))
    }
    name = write("two.xml", PASSIVE.format('range="2 1"').replace("</worldbody>", "<camera/></worldbody>"))
    assert codes(checked(name, select=["MJ3", "MJ201"], ignore=["MJ302"]).models[0]) == ["MJ201"]


def test_what_keeps_a_model_from_loading_is_told_whatever_is_chosen() -> None:
    name = write("limit.xml", PASSIVE.format('limited="true"'))
    assert codes(checked(name, select=["MJ6"], ignore=["MJ3"]).models[0]) == ["MJ303"]


def test_all_codes_begin_with_nothing_short_of_a_letter() -> None:
    assert matching_codes(["MJ"]) == frozenset(RULES)
    assert matching_codes(["mj70"]) == {code for code in RULES if code.startswith("MJ70")}


@cases("settings, message")
def test_what_cannot_be_meant_is_refused(settings: dict, message: str) -> None:
    with pytest.raises(UsageError) as error:
        ModelCheck(["a.xml"], **settings)
    assert message in str(error.value)


def test_a_folder_without_models_is_refused(workplace: Path) -> None:
    with pytest.raises(UsageError, match="no model to check"):
        checked(str(workplace))


def test_counts_are_of_all_models() -> None:
    noted = Finding("MJ201", "note", "", "a.xml")
    result = CheckResult((ModelCheckResult("a", True, (noted,)), ModelCheckResult("b", True, (noted, noted))), 0, 0)
    assert (result.count("note"), result.count("error")) == (3, 0)


def test_a_folder_means_the_models_below_it_that_stand_by_themselves() -> None:
    for name, text in {
        "b/two.xml": "<!-- a remark --><mujoco/>",
        "b/part.xml": "<mujocoinclude/>",
        "b/other.xml": "not xml at all",
        "a/one.urdf": '<robot name="r"/>',
        "a/three.mjz": "",
        "a/notes.txt": "<mujoco/>",
        ".hidden/four.xml": "<mujoco/>",
        "five.xml": "<mujoco/>",
    }.items():
        path = Path(name)
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    models, skipped = find_models([".", "gone.xml", "five.xml"])
    assert models == ["five.xml", "a/one.urdf", "a/three.mjz", "b/two.xml", "gone.xml"]
    assert skipped == 2
    assert find_models(["five.xml", "b/part.xml", "b/other.xml"]) == (["five.xml", "b/other.xml"], 1)


def test_files_of_other_formats_are_skipped_on_request_and_broken_ones_are_not() -> None:
    texts = {"a.xml": "<mujoco/>", "package.xml": "<package/>", "part.xml": "<mujocoinclude/>", "b.xml": "<mujoco"}
    texts["c.xml"] = "text"
    for name, text in texts.items():
        Path(name).write_text(text)

    assert find_models([*texts], skip_other=True) == (["a.xml", "b.xml", "c.xml"], 2)
    assert find_models([*texts]) == (["a.xml", "package.xml", "b.xml", "c.xml"], 1)


def test_a_model_with_the_markers_of_a_conflict_and_a_dangling_link_are_reported_in_a_folder() -> None:
    Path("robots").mkdir()
    write("robots/conflict.xml", f"<<<<<<< HEAD\n{PASSIVE.format('')}")
    write("robots/launch.xml", "<launch/>")
    write("robots/notes.xml", "no model")
    Path("robots/dangling.xml").symlink_to("nowhere.xml")
    assert find_models(["robots"]) == (["robots/conflict.xml", "robots/dangling.xml"], 2)


def test_a_model_that_is_given_by_two_paths_is_checked_once_but_a_link_is_another_model() -> None:
    Path("robots").mkdir()
    model = write("robots/a.xml", PASSIVE.format(""))
    Path("link.xml").symlink_to(model)
    Path("linked").symlink_to("robots")
    given = [model, "robots", str(Path(model).absolute()), "robots/../robots/a.xml", "linked/a.xml", "link.xml"]
    assert find_models(given) == ([model, "link.xml"], 0)


def test_the_root_of_a_pipe_is_not_waited_for() -> None:
    os.mkfifo("pipe.xml")
    assert root_tag(Path("pipe.xml")) == ""


def test_a_result_is_reported_before_those_of_slower_models_and_returned_in_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fast_is_reported = threading.Event()

    class Processes(CheckProcessPool):
        def run(self, task: CheckRequest) -> CheckProcessOutput:
            assert task.path == "fast.xml" or fast_is_reported.wait(PATIENCE)
            return super().run(task)

    def finished(result: ModelCheckResult) -> None:
        reported.append(result)
        fast_is_reported.set()

    monkeypatch.setattr(check_module, "CheckProcessPool", Processes)
    reported: list[ModelCheckResult] = []
    for name in ("slow.xml", "fast.xml"):
        write(name, PASSIVE.format(""))
    result = ModelCheck(["slow.xml", "fast.xml"], jobs=2, steps=0, cache=False).run(finished=finished)
    assert [each.model for each in reported] == ["fast.xml", "slow.xml"]
    assert list(result.models) == reported[::-1]
