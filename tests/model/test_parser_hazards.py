"""Models that MuJoCo would crash on or never finish are refused before it reads them, and no others are."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from mjrun import load
from mjrun.errors import BrokenModelError
from mjrun.model.sources.file import MOST_INCLUDES, MOST_KEYFRAMES, MOST_LINKS, MOST_MODELS, require_finite_nesting

BALL = '<worldbody><body name="ball"><geom size="1"/></body></worldbody>'


def attaching(file: str, rest: str = BALL) -> str:
    return f'<mujoco><asset>\n<model name="m" file="{file}"/></asset>{rest}</mujoco>'


def including(file: str) -> str:
    return f'<mujoco>\n<include file="{file}"/></mujoco>'


def write(folder: Path, **texts: str) -> Path:
    """Files of MJCF by their names without a suffix; returns the first."""
    for name, text in texts.items():
        (folder / f"{name}.xml").write_text(text)
    return folder / f"{next(iter(texts))}.xml"


def zipped(folder: Path, **texts: str) -> Path:
    """An archive of the files, named as the first."""
    path = folder / f"{next(iter(texts))}.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in texts.items():
            archive.writestr(f"{name}.xml", text)
    return path


@pytest.mark.parametrize("store", [write, zipped])
@pytest.mark.parametrize(
    ("texts", "place"),
    [
        ({"a": attaching("a.xml")}, "a.xml:2"),
        ({"a": attaching("b.xml"), "b": attaching("a.xml")}, "b.xml:2"),
        ({"a": attaching("b.xml"), "b": including("c.xml"), "c": attaching("./a.xml")}, "c.xml:2"),
        ({"a": including("b.xml"), "b": attaching("c.xml"), "c": attaching("c.xml")}, "c.xml:2"),
    ],
)
def test_models_that_attach_each_other_in_a_circle_are_refused(
    tmp_path: Path, store: Callable[..., Path], texts: dict[str, str], place: str
) -> None:
    with pytest.raises(BrokenModelError, match=f"{place}: attaches '.*', which is or attaches this model again"):
        load(store(tmp_path, **texts))


def test_a_circle_of_a_model_beside_an_included_file_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, a=including("parts/b.xml"))
    (tmp_path / "parts").mkdir()
    write(tmp_path / "parts", b=attaching("c.xml"), c=attaching("c.xml"))
    with pytest.raises(BrokenModelError, match=r"c\.xml:2: attaches '.*', which is or attaches this model again"):
        load(path)


def test_a_circle_through_a_link_to_its_own_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path)
    with pytest.raises(BrokenModelError, match="which is or attaches this model again"):
        load(write(tmp_path, a=attaching("loop/a.xml")))


def test_an_include_of_itself_is_refused_by_mujoco(tmp_path: Path) -> None:
    with pytest.raises(BrokenModelError, match="already included"):
        load(write(tmp_path, a=including("a.xml")))


def test_what_is_no_circle_is_loaded(tmp_path: Path) -> None:
    """A model that is attached twice, one that is named in a comment, and another of the same name."""
    (tmp_path / "inner").mkdir()
    write(tmp_path / "inner", a=f"<mujoco>{BALL}</mujoco>")
    twice = '<asset><model name="n" file="inner/../b.xml"/></asset><!-- <model name="o" file="a.xml"/> -->'
    main = write(tmp_path, a=attaching("b.xml", BALL + twice), b=attaching("inner/a.xml"))
    assert load(main).nbody == 2


def test_copies_are_counted_by_nesting(tmp_path: Path) -> None:
    row = '<replicate count="1000" offset="1 0 0"><site/></replicate>'
    assert load(write(tmp_path, a=f"<mujoco><worldbody>{row * 3}</worldbody></mujoco>")).nsite == 3000


def chain(folder: Path, count: int, link: Callable[[str], str]) -> Path:
    for i in range(count):
        text = link(f"{i + 1}.xml") if i < count - 1 else f"<mujoco>{BALL}</mujoco>"
        (folder / f"{i}.xml").write_text(text)
    return folder / "0.xml"


def test_chains_are_read_up_to_a_length_at_which_mujoco_is_safe(tmp_path: Path) -> None:
    assert load(chain(tmp_path, MOST_INCLUDES, including)).nbody == 2
    with pytest.raises(BrokenModelError, match=rf"{MOST_INCLUDES - 1}\.xml:2: '{MOST_INCLUDES}.xml' is included at"):
        load(chain(tmp_path, MOST_INCLUDES + 1, including))
    with pytest.raises(
        BrokenModelError, match=rf"{MOST_MODELS - 1}\.xml:2: attaches a model at nesting level {MOST_MODELS + 1}"
    ):
        load(chain(tmp_path, MOST_MODELS + 1, attaching))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f'<size nkey="{MOST_KEYFRAMES + 1}"/>', "nkey allocates"),
        ('<size nkey="1e8"/>', "nkey allocates 1e8 keyframes"),
        (
            '<worldbody><flexcomp name="f" type="grid" count="256 256 1" spacing="1 1 1"/></worldbody>',
            "flexcomp has 65536 points",
        ),
        (f'<worldbody><flexcomp name="f" type="grid" count="{"1e300 " * 20}"/></worldbody>', "flexcomp has"),
        (
            '<worldbody><replicate count="1e6"><replicate count="1e308"><site/></replicate></replicate></worldbody>',
            "replicate makes 1e",
        ),
    ],
)
def test_counts_that_take_hours_are_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(BrokenModelError, match=rf"a\.xml:2: .*{said}"):
        load(write(tmp_path, a=f"<mujoco>\n{text}</mujoco>"))


def urdf(parents: dict[int, int]) -> str:
    """A robot whose links hang on their parents."""
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="l{i}">{inertial}</link>' for i in sorted({*parents, *parents.values()}))
    joints = "".join(
        f'<joint name="j{child}" type="continuous"><child link="l{child}"/><parent link="l{parent}"/></joint>'
        if child % 2
        else f'<joint name="j{child}" type="continuous"><parent link="l{parent}"/><child link="l{child}"/></joint>'
        for child, parent in parents.items()
    )
    return f'<robot name="r">{links}{joints}</robot>'


def test_long_chains_of_links_are_refused_and_many_short_ones_are_not(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(urdf({i: i - 1 for i in range(1, MOST_LINKS + 1)}))
    with pytest.raises(BrokenModelError, match=f"more than {MOST_LINKS} links form a chain to 'l{MOST_LINKS}'"):
        load(path)
    path.write_text(urdf({i: i - 1 for i in range(1, 200)}))
    assert load(path).njnt == 199
    require_finite_nesting(path, str(path), urdf(dict.fromkeys(range(1, 2 * MOST_LINKS), 0)).encode())
    require_finite_nesting(path, str(path), urdf({1: 2, 2: 1}).encode())  # a circle, which MuJoCo refuses
