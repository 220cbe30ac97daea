"""Theorems about a model on standard input: it is what a file in the working directory would be."""

import io
import pickle
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from mjrun.errors import BrokenModelError, UsageError
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.model.sources.stdin import _standard_input
from tests.model.model_files import content

MODEL = """<mujoco>
  <compiler meshdir="meshes"/>
  <include file="parts/floor.xml"/>
  <asset><mesh name="m" file="m.obj"/></asset>
  <worldbody><body><freejoint/><geom type="mesh" mesh="m"/></body></worldbody>
</mujoco>"""
FLOOR = '<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/></worldbody></mujoco>'
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
URDF = '<robot name="r"><link name="a"><collision><geometry><sphere radius="1"/></geometry></collision></link></robot>'
LATER = "import sys; from mjrun.model.sources import parse_source; parse_source('-').load(); print('loaded')"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a mesh and a part to include, and a standard input that has not been read."""
    for name, text in (("meshes/m.obj", MESH), ("parts/floor.xml", FLOOR)):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    _standard_input.cache_clear()
    return tmp_path


def pipe(monkeypatch: pytest.MonkeyPatch, content: str | bytes) -> None:
    """Makes `content` the standard input of this process."""
    data = content if isinstance(content, bytes) else content.encode()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))


def test_mjcf_is_what_mujoco_makes_of_a_file_in_the_working_directory(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "model.xml").write_text(MODEL)
    pipe(monkeypatch, MODEL)
    assert content(parse_source("-").load()) == content(mujoco.MjModel.from_xml_path("model.xml"))


def test_urdf_is_read_too_and_a_byte_order_mark_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe(monkeypatch, b"\xef\xbb\xbf" + URDF.encode())
    assert parse_source("-").load().ngeom == 1


def test_it_is_read_once_however_often_and_with_whatever_overrides_it_is_loaded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pipe(monkeypatch, MODEL)
    settings = [Override("opt.gravity", "0,0,-1")]
    models = [parse_source("-").load(), parse_source("-", settings).load()]
    assert [model.opt.gravity[2] for model in models] == pytest.approx([-9.81, -1])


def test_a_pickled_source_takes_what_was_read_along(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe(monkeypatch, MODEL)
    pickled = pickle.dumps(parse_source("-", [Override("opt.timestep", "0.5")]))
    _standard_input.cache_clear()
    pipe(monkeypatch, "")
    assert pickle.loads(pickled).load().opt.timestep == 0.5


def test_outputs_are_named_after_a_model() -> None:
    source = parse_source("-")
    assert (source.text, source.stem, source.main_file) == ("-", "model", None)


def test_nothing_may_write_to_the_file_of_standard_input(folder: Path) -> None:
    (folder / "model.xml").write_text(MODEL)
    code = "from mjrun import Simulation, Trace; Trace(Simulation('-', duration=1), 'model.xml', format='csv').run()"
    with (folder / "model.xml").open() as stdin:
        done = subprocess.run([sys.executable, "-c", code], stdin=stdin, capture_output=True, text=True, check=False)
    assert "UsageError" in done.stderr
    assert "clashes with the model, which is read" in done.stderr
    assert (folder / "model.xml").read_text() == MODEL


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<mujoco>\n<worldbody><geom siz="1"/></worldbody></mujoco>', "<stdin>:2: Schema violation"),
        ("", "<stdin>: standard input is empty"),
        ("\n \n", "<stdin>: standard input is empty"),
        (b"PK\x03\x04\xff\xfe", "<stdin>: standard input is not UTF-8 text"),
        ("hello", "<stdin>:1: XML parse error"),
    ],
)
def test_what_is_no_model_is_refused_with_its_line(
    monkeypatch: pytest.MonkeyPatch, text: str | bytes, message: str
) -> None:
    pipe(monkeypatch, text)
    with pytest.raises(BrokenModelError) as caught:
        parse_source("-").load()
    assert str(caught.value).startswith(message)


def test_a_terminal_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe(monkeypatch, MODEL)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    with pytest.raises(UsageError, match="which is a terminal\npipe MJCF into it"):
        parse_source("-").load()


def test_a_closed_standard_input_is_no_model() -> None:
    closed = f"import sys; sys.stdin = None; {LATER}"
    done = subprocess.run([sys.executable, "-c", closed], capture_output=True, text=True, check=False)
    assert "which is closed" in done.stderr


def test_a_pipe_is_read_to_its_end() -> None:
    done = subprocess.run([sys.executable, "-c", LATER], input=MODEL, capture_output=True, text=True, check=True)
    assert done.stdout == "loaded\n"
