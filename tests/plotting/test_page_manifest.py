"""What a manifest says, whatever it says."""

import json

from hypothesis import given
from hypothesis import strategies as st

from mjrun.plotting.page_manifest import PageManifest, flat, manifest_articles
from tests.plotting.test_markup import read

JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=12,
)
ALLOWED = {"article", "h3", "dl", "div", "dt", "dd", "code", "details", "summary", "table", "caption"}
ALLOWED |= {"thead", "tbody", "tr", "th", "td"}
KEYS = st.sampled_from(["mjrun", "command", "model", "options", "result", "outputs", "seed", "<b>"])


def article(*manifests: PageManifest) -> str:
    return "".join(manifest_articles(manifests))


@given(st.dictionaries(KEYS, JSON, max_size=6))
def test_a_manifest_of_anything_is_shown(content: dict[str, object]) -> None:
    tags = {tag for tag, _ in read(article(PageManifest("m.json", content))).tags}
    assert tags <= ALLOWED


def test_a_manifest_of_ours_says_what_made_it() -> None:
    content = {
        "mjrun": "0.1.0",
        "mujoco": "4.0.0",
        "command": "mjrun trace <b>.xml",
        "model": {"path": "<b>.xml", "sha256": "12ab"},
        "options": {"simulation": {"duration": 2.0, "key": None}, "assert_": ["a < 1"]},
        "result": {"path": "x", "wall": 1.25, "assertions": [{"text": "a < 1"}]},
        "outputs": [{"path": "run.csv", "bytes": 12, "sha256": "feed"}],
    }
    text = read(article(PageManifest("run.json", content))).text
    for part in ("mjrun trace <b>.xml", "12ab", "mjrun 0.1.0, mujoco 4.0.0", "Wall [s]1.25", "feed", "Options (2)"):
        assert part in text
    assert "simulation.key" not in text


def test_mappings_are_taken_apart_to_a_limit() -> None:
    deep = json.loads('{"a":' * 400 + "1" + "}" * 400)
    assert len(flat(deep)) == 1
    assert flat({"a": {"b_": 1, "c": []}, "d": False}) == {"a.b": 1, "d": False}


def test_what_all_manifests_say_is_said_once() -> None:
    shared = {"command": "mjrun run study.yaml", "seed": 0}
    pages = [
        PageManifest(name, {**shared, "result": {"wall": wall}}) for name, wall in (("a.mp4", 1.0), ("b.csv", 2.0))
    ]
    text = read(article(*pages)).text
    assert text.count("mjrun run study.yaml") == 1
    assert text.index("mjrun run") < text.index("a.mp4") < text.index("b.csv")
    assert "Wall [s]1" in text
    assert read(article(pages[0])).text.count("mjrun run study.yaml") == 1
