"""What is known of the machine, and what spoils figures."""

from collections.abc import Sequence

import pytest

from mjrun.bench.machine_info import MachineInfo, machine_info


@pytest.mark.parametrize(
    ("load", "governor", "said"),
    [
        (0.4, None, []),
        (None, "performance", []),
        (3.0, "powersave", ["load average 3.00 on 4 cores", "governor is powersave"]),
    ],
)
def test_what_spoils_figures_is_told(load: float | None, governor: str | None, said: Sequence[str]) -> None:
    causes = MachineInfo("Linux", "a CPU", 4, 4, governor, load).disturbances
    assert len(causes) == len(said)
    for cause, part in zip(causes, said, strict=True):
        assert part in cause


def test_this_machine_is_known() -> None:
    found = machine_info()
    assert found.cpu
    assert 1 <= found.available <= found.cores
