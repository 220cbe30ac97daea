"""A tree knows where each value of a document is written, and finds it by its path."""

import pytest

from mjrun.document.tree import (
    INVALID,
    DocumentPath,
    DocumentPlace,
    ListNode,
    MappingNode,
    Node,
    ReportedFaultNode,
    ScalarNode,
    described,
    find,
    key_mark,
    meaning,
    path_text,
    plain,
    shortened,
    written_path,
)
from mjrun.document.yaml_text import compose

TEXT = "camera: [top, {shots: [{orbit: {lookat: box}}]}]\ntrail: box\nempty:\n"


def tree(text: str = TEXT) -> MappingNode:
    node, faults = compose(text, lambda index: DocumentPlace(0, 1, index, "d.yaml"))
    assert isinstance(node, MappingNode)
    assert not faults
    return node


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ((), "camera"),
        (("trail",), "box\n"),
        (("camera", 0), "top"),
        (("camera", 1, "shots", 0, "orbit", "lookat"), "box}"),
        (("camera", 0, "shots"), "top"),
        (("camera", 5), "[top"),
        (("nothing",), "camera"),
    ],
)
def test_a_value_is_found_where_it_is_written_or_the_last_on_the_way_to_it(path: DocumentPath, text: str) -> None:
    assert TEXT[find(tree(), path).mark.column :].startswith(text)


@pytest.mark.parametrize(
    ("path", "written"),
    [
        (("trail", 0), ("trail",)),
        (("trail", 1), ("trail",)),
        (("trail", 0, "lookat"), ("trail",)),
        (("camera", 0, "lookat"), ("camera", 0)),
        (("camera", 1, 0, "shots", 0, "orbit", "lookat"), ("camera", 1, "shots", 0, "orbit", "lookat")),
        (("camera", 1, "shots", 0, "orbit", "distance"), ("camera", 1, "shots", 0, "orbit", "distance")),
        (("camera", 1, "shots", 0, "orbit", "azimuth", "from"), ("camera", 1, "shots", 0, "orbit", "azimuth")),
        (("camera", 7, "shots"), ("camera",)),
    ],
)
def test_a_path_goes_as_far_as_the_document_goes_into_detail(path: DocumentPath, written: DocumentPath) -> None:
    assert written_path(tree(), path) == written


def test_a_key_is_found_by_itself() -> None:
    assert TEXT[key_mark(tree(), ("trail",)).column :].startswith("trail: box")
    assert TEXT[key_mark(tree(), ("camera", 1, "shots")).column :].startswith("shots: [{orbit")
    assert key_mark(tree(), ("nothing",)) == tree().mark


def test_plain_values_are_pythons_own() -> None:
    assert plain(tree()) == {
        "camera": ["top", {"shots": [{"orbit": {"lookat": "box"}}]}],
        "trail": "box",
        "empty": None,
    }
    assert plain(ReportedFaultNode(DocumentPlace(0, 1, 1, ""))) is INVALID


def test_a_changed_mapping_leaves_the_first_as_it_was() -> None:
    first = tree("a: 1\nb: 2")
    mark = DocumentPlace(1, 0, 0, "b=3")
    changed = first.with_entry("b", mark, ScalarNode(mark, 3, "3")).without("a")
    assert (plain(first), plain(changed)) == ({"a": 1, "b": 2}, {"b": 3})
    assert changed.keys["b"] == mark


HERE = DocumentPlace(0, 1, 1, "d.yaml")


@pytest.mark.parametrize(
    ("node", "text"),
    [
        (ScalarNode(HERE, None, ""), "nothing"),
        (ScalarNode(HERE, "", ""), "''"),
        (ScalarNode(HERE, "fast", "fast"), "'fast'"),
        (ScalarNode(HERE, 0.5, ".50"), ".50"),
        (ScalarNode(HERE, "x" * 99, "x" * 99), f"'{'x' * 39}…'"),
        (ScalarNode(HERE, "a\x1b[2J", "a\x1b[2J"), r"'a\x1b[2J'"),
        (ScalarNode(HERE, 2, "2", "${n}"), "2 from ${n}"),
        (ListNode(HERE), "a list"),
        (MappingNode(HERE), "a mapping"),
    ],
)
def test_messages_show_a_value_as_it_is_written(node: Node, text: str) -> None:
    assert described(node) == text


def test_paths_are_spelled_as_on_the_command_line() -> None:
    assert path_text(("shots", 1, "orbit", "distance")) == "shots[1].orbit.distance"
    assert path_text(()) == ""
    assert path_text(("a\n",)) == r"a\n"


def test_marks_sort_by_source_line_and_column() -> None:
    marks = [
        DocumentPlace(0, 2, 1, "d.yaml"),
        DocumentPlace(0, 2, 9, "d.yaml"),
        DocumentPlace(0, 10, 1, "d.yaml"),
        DocumentPlace(1, 1, 1, "below.yaml"),
    ]
    assert sorted([marks[2], marks[3], marks[1], marks[0]]) == marks
    assert [str(mark) for mark in (marks[0], DocumentPlace(2, 0, 0, "fps=3"))] == ["d.yaml:2:1", "fps=3"]


def test_text_is_cut_to_a_length() -> None:
    assert (shortened("abcde", 5), shortened("abcdef", 5)) == ("abcde", "abcd…")


@pytest.mark.parametrize("sign", ["", "+", "-"])
@pytest.mark.parametrize("text", [str(2**1024), "9" * 309, "9" * 400, "1" + "0" * 309])
def test_an_integer_beyond_the_floats_is_infinite(sign: str, text: str) -> None:
    assert meaning(sign + text) == float(sign + text)
    assert meaning(f"{sign}{2**1023}") == int(f"{sign}{2**1023}")
    assert meaning(hex(2**1024)) == float("inf")
