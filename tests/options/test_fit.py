"""Options of fits."""

import pytest

from mjrun.errors import BadValueError
from mjrun.options.fit import FitOptions


def test_what_is_free_is_a_path_and_bounds() -> None:
    assert FitOptions(free={"joint/a.damping": "0..1"}).free == (("joint/a.damping", "0..1"),)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "value"), [("holdout", 1.0), ("confidence", 0.2), ("starts", 0), ("loss", "l2")])
def test_values_that_cannot_be_are_refused(name: str, value: object) -> None:
    with pytest.raises(BadValueError):
        FitOptions(**{name: value})  # type: ignore[arg-type]
