"""The page of `mjrun info` about a file of demonstrations."""

import shlex

from mjrun.cli.table_cells import common, number, numbers, texts
from mjrun.cli.terminal_layout import TerminalLayout
from mjrun.errors import clean, listing
from mjrun.hdf5.demonstration_summary import DemonstrationList


def demonstrations_page(listed: DemonstrationList) -> str:
    """Formats the origin of the demonstrations, and a table of them."""
    page, origin, episodes = TerminalLayout(), listed.origin, listed.demonstrations
    rate = origin.control_rate
    page.lines(
        clean(listed.path),
        [
            ("task", clean(origin.task)),
            ("instruction", clean(origin.instruction)),
            ("robot", listing(origin.robots)),
            ("made with", common(_programs(listed))),
            ("control rate", f"{number(rate)} Hz" if rate else ""),
            ("cameras", listing(listed.cameras)),
            ("subsets", listing([f"{name} ({count})" for name, count in listed.subsets.items()])),
        ],
    )
    columns = [
        texts("name", [each.name for each in episodes]),
        numbers("states", [each.states for each in episodes]),
        numbers("duration", [each.duration for each in episodes], "s"),
        numbers("reward", [each.reward for each in episodes]),
        texts("images", [listing(each.images) for each in episodes]),
        texts("instruction", [each.instruction for each in episodes]),
    ]
    page.table("demonstrations", columns, len(episodes))
    camera = f" --camera {shlex.quote(listed.cameras[0])}" if listed.cameras else ""
    page.note(clean(f"mjrun video {shlex.quote(f'{listed.path}:{episodes[0].name}')}{camera}"))
    return page.text()


def _programs(listed: DemonstrationList) -> list[str]:
    """Returns the programs that made the file, with their versions."""
    versions = {"MuJoCo": listed.origin.mujoco, "robosuite": listed.origin.robosuite}
    return [clean(f"{program} {version}") for program, version in versions.items() if version]
