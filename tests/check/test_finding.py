"""Theorems about paths in findings."""

from pathlib import Path

from mjrun.check.rule import short_path


def test_a_detour_in_a_path_is_taken_out_only_if_it_leads_to_the_same_file() -> None:
    Path("a/b").mkdir(parents=True)
    Path("x.xml").touch()
    Path("link").symlink_to("a/b")
    Path("a/x.xml").touch()
    assert short_path(Path("a/../x.xml")) == "x.xml"
    assert short_path(Path("link/../x.xml")) == "link/../x.xml"
