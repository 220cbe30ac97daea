"""Annotations of GitHub workflows cannot be broken by what they tell of."""

from mjrun.cli.github_annotations import annotation


def test_an_annotation_is_one_line_whatever_it_says() -> None:
    assert annotation("error", "100%\r\nb", "a,b:c.csv", "x: y", 3) == (
        r"::error file=a%2Cb%3Ac.csv,line=3,title=x%3A y::100%25\r%0Ab"
    )
    assert annotation("notice", "text", "f", "t") == "::notice file=f,title=t::text"
