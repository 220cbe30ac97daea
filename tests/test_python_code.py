"""Code that the user names: found where Python finds it, and never in the way of the payload."""

import os
import py_compile
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import pytest

from mjrun import python_code
from mjrun.errors import ControllerError, FileError, UsageError
from mjrun.python_code import (
    ModuleSource,
    PickledWithCode,
    RedirectedFunction,
    code_hash,
    edit_remarks,
    import_from,
    imported_packages,
    load_code,
    made,
    module_sources,
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "some_code_in_test.py").write_text(
        "class A:\n    b = 7\n    def __init__(self, needed): pass\nprint('hello')\n"
    )
    monkeypatch.delitem(sys.modules, "some_code_in_test", raising=False)
    return tmp_path


@pytest.mark.parametrize("place", ["some_code_in_test.py", "some_code_in_test"])
def test_names_are_found_in_files_and_modules(folder: Path, place: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert load_code(f"{place}:A.b", "policy", "") == 7
    assert capsys.readouterr() == ("", "hello\n")


@pytest.mark.parametrize(
    ("code", "error", "message"),
    [
        ("some_code_in_test.py", UsageError, "names no code\nsome_code_in_test.py:A$"),
        ("missing.py", UsageError, "^policy 'missing.py' names no code\nFORM$"),
        (":a", UsageError, "names no code"),
        ("none.py:a", FileError, "none.py: there is no such file\nFORM"),
        ("some_code_in_test.py:B", UsageError, "no policy 'B'"),
        ("some_code_in_test.py:A.c", ControllerError, "raised AttributeError"),
        ("no_such_module_in_test:a", ControllerError, "raised ModuleNotFoundError"),
    ],
)
def test_what_is_not_there_is_told(folder: Path, code: str, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        load_code(code, "policy", "FORM")


def test_the_folders_of_libraries_are_known_before_imports_are_examined(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To find them, Python 3.13 imports a module, and cannot name them within that import."""
    finder, get_paths = python_code._finder, sysconfig.get_paths
    monkeypatch.setattr(sys, "meta_path", [each for each in sys.meta_path if each is not finder])

    def before_the_finder() -> dict[str, str]:
        assert finder not in sys.meta_path
        return get_paths()

    monkeypatch.setattr(sysconfig, "get_paths", before_the_finder)
    python_code._installed.cache_clear()
    (folder / "controllers.py").write_text("gain = 7")  # pytest imports modules whose names contain "test" itself
    assert load_code("controllers:gain", "policy", "") == 7
    assert finder in sys.meta_path
    del sys.modules["controllers"]


def test_a_class_that_cannot_be_made_is_an_error_of_its_own(folder: Path) -> None:
    thing = load_code("some_code_in_test.py:A", "policy", "")
    with pytest.raises(ControllerError, match="raised TypeError"):
        made(thing, "code", "policy")
    assert made(3, "code", "policy") == 3


def test_prints_go_to_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert RedirectedFunction(lambda x: print(x) or x)(4) == 4  # noqa: T201
    assert capsys.readouterr() == ("", "4\n")


def test_the_hash_of_code_is_of_the_modules_that_it_imports_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    helper = tmp_path / "gains_of_a_test.py"
    helper.write_text("KP = 1")
    (tmp_path / "control_of_a_test.py").write_text(
        "import math\nfrom gains_of_a_test import KP\ndef act(model, data): return KP\n"
    )
    import control_of_a_test  # type: ignore[import-not-found]

    act = control_of_a_test.act
    before = code_hash([act])
    assert before == code_hash([act]) == code_hash([act, act])
    helper.write_text("KP = 2")
    assert code_hash([act]) != before
    assert code_hash([]) == code_hash([print]) == code_hash([Path]) == ""
    del sys.modules["control_of_a_test"], sys.modules["gains_of_a_test"]


def test_modules_that_functions_import_later_belong_to_the_code(folder: Path) -> None:
    """A process that executes pickled code finds no other modules; installed packages are known by their versions."""
    texts = {
        "acting_late.py": "def act(model, data):\n    import acting_parts.gains, PIL.Image, math, no_module, odd\n",
        "acting_parts/__init__.py": "raise AssertionError('it is imported')\n",
        "acting_parts/gains.py": "KP = 1\n",
    }
    (folder / "acting_parts").mkdir()
    for path, text in texts.items():
        (folder / path).write_text(text)
    act = load_code("acting_late.py:act", "controller", "")
    found = {str(Path(each.path).relative_to(folder)): each.content.decode() for each in module_sources([act])}
    assert found == texts
    metadata = folder / "other_name-2.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: Other.Name\nVersion: 2.0\n")
    (metadata / "top_level.txt").write_text("odd\n")
    assert imported_packages([act]) == ["Other.Name", "no-module", "pillow"]
    before = code_hash([act])
    (folder / "acting_parts" / "gains.py").write_text("KP = 2\n")
    assert code_hash([act]) != before
    del sys.modules["acting_late"]


def _pushing(force: object) -> Callable[[], object]:
    return lambda: force


def test_code_that_cannot_be_imported_is_pickled_with_what_it_refers_to(monkeypatch: pytest.MonkeyPatch) -> None:
    pushes: Any = type("Pushes", (), {"__call__": lambda _: 5, "__module__": "__main__"})()
    with monkeypatch.context() as patch:
        patch.setattr(sys.modules["__main__"], "Pushes", type(pushes), raising=False)
        pickled = [PickledWithCode.of({"code": code}, [code]) for code in (_pushing(5), pushes, partial(pushes))]
    for each in pickled:  # where the program is another one
        opened = each.open()
        assert isinstance(opened, dict)
        assert opened["code"]() == 5
    assert code_hash([_pushing(5)]) == code_hash([_pushing(5)]) != code_hash([_pushing(6)])
    with pytest.raises(UsageError, match=r"^other processes cannot receive .* cannot pickle '_thread.lock' object\n"):
        PickledWithCode.of(_pushing(Lock()), [])


def test_the_source_of_a_module_is_that_which_was_executed(folder: Path) -> None:
    edit = "__import__('pathlib').Path(__file__).write_text('edited')"
    sources = {"editing_itself": f"{edit}\nimport editing_itself_too", "editing_itself_too": edit}
    for name, text in sources.items():
        (folder / f"{name}.py").write_text(text)
    load_code("editing_itself.py:editing_itself_too", "policy", "")
    assert {each.name: each.content.decode() for each in module_sources(["editing_itself.py:"])} == sources
    for name in sources:
        del sys.modules[name]


def test_code_is_that_of_the_file_and_not_of_bytecode_of_the_same_second(folder: Path) -> None:
    path = folder / "sized_in_test.py"
    for value in "12":
        path.write_text(f"VALUE = {value}")
        os.utime(path, (10**9, 10**9))
        if value == "1":
            py_compile.compile(str(path))
    assert load_code("sized_in_test.py:VALUE", "policy", "") == 2
    del sys.modules["sized_in_test"]


def test_processes_that_execute_pickled_code_do_not_remark_on_edits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path])
    path = tmp_path / "edited.py"
    path.write_text("new = 1\n")
    source = ModuleSource("edited", str(path), b"old = 1\n")
    assert len(edit_remarks([source])) == 1
    import_from([source])
    assert edit_remarks([source]) == []


IN_A_NOTEBOOK = """
from mjrun.python_code import code_hash
FACTOR = 2
class Controller:
    def __call__(self, model, data):
        return [FACTOR * (name in {"hip", "knee", "ankle"}) for name in ("hip", "toe")]
def act(model, data):
    return [FACTOR * value for value in data.qpos]
print(*(code_hash([code]) for code in (Controller(), act, lambda model, data: FACTOR)))
"""


def test_code_that_cannot_be_imported_counts_as_it_is_written_in_every_process(tmp_path: Path) -> None:
    """Also where random numbers order sets, and in other files and lines, as the cells of a notebook have."""

    def hashes(name: str, seed: str, text: str) -> list[str]:
        file = tmp_path / name
        file.write_text(text)
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        return subprocess.run(
            [sys.executable, str(file)], env=environment, check=True, capture_output=True, text=True
        ).stdout.split()

    first = hashes("a.py", "1", IN_A_NOTEBOOK)
    assert len({*first}) == 3
    assert hashes("b.py", "2", "# another line\n" + IN_A_NOTEBOOK) == first
    edited = hashes("b.py", "2", IN_A_NOTEBOOK.replace("FACTOR = 2", "FACTOR = 3"))
    assert not {*edited} & {*first}
