"""Facts about the machine, and conditions that distort figures."""

from collections.abc import Sequence

import pytest

from mjrun.bench.results import MachineInfo, machine_info


@pytest.mark.parametrize(
    ("load", "governor", "expected"),
    [
        (0.4, None, []),
        (None, "performance", []),
        (3.0, "powersave", ["load average 3.00 on 4 cores", "governor is powersave"]),
    ],
)
def test_what_spoils_figures_is_reported(load: float | None, governor: str | None, expected: Sequence[str]) -> None:
    causes = MachineInfo("Linux", "a CPU", 4, 4, governor, load).disturbances
    assert len(causes) == len(expected)
    for cause, part in zip(causes, expected, strict=True):
        assert part in cause


def test_this_machine_is_known() -> None:
    result = machine_info()
    assert result.cpu
    assert 1 <= result.available <= result.cores
