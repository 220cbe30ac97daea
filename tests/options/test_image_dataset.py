"""The options of datasets."""

from fractions import Fraction

import pytest

from mjrun.options.image_dataset import NamedSharesKind
from mjrun.options.schema_validation import InvalidValueError


def test_shares_are_exact() -> None:
    assert NamedSharesKind()("train=0.7, val=0.2,test=1/10") == (
        ("train", Fraction(7, 10)),
        ("val", Fraction(1, 5)),
        ("test", Fraction(1, 10)),
    )


@pytest.mark.parametrize("text", ["", "train", "train=0.8", "a=0.5,a=0.5", "a=1.5,b=-0.5", "a/b=1", "a=1/0", "a=x"])
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(InvalidValueError):
        NamedSharesKind()(text)
