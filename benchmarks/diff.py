"""Wall time of `mjrun diff` for two large CSV files, compared with `cmp` and pandas.

Each program is timed as a whole process, alternately in one run. pandas reads both files, merges their rows by time and
compares all numbers; cmp stops at the first byte that differs. Three pairs of files: equal except for one bit in the
last row, every number slightly off, and every other row missing. The files contain a time and 19 columns, in a
temporary folder. Ratios below 1 are better.

    python benchmarks/diff.py
    python benchmarks/diff.py --size 100 --repeats 1
"""

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from measured_process import run

from mjrun.formats.table_writer import TableWriter
from mjrun.model.table_column import Column

COLUMNS = [Column("time", "s"), *(Column(f"qpos/{i}", "rad") for i in range(19))]
BLOCK = 10_000  # rows
ROW = 382  # approximate length of a line [bytes]
PANDAS = """
import sys, numpy as np, pandas as pd
a, b = (pd.read_csv(path) for path in sys.argv[1:3])
both = a.merge(b, on="time", suffixes=("_a", "_b"))
differences = {name: np.abs(both[name + "_a"] - both[name + "_b"]) for name in a.columns if name != "time"}
for name, size in differences.items():
    print(name, (size > 0).sum(), size.max(), np.sqrt((size**2).mean()), size.iloc[-1], size.gt(0).idxmax())
"""
Change = Callable[[np.ndarray, bool], np.ndarray]  # changes a block of rows, which may be the last one


def one_bit(rows: np.ndarray, is_last: bool) -> np.ndarray:
    """Flips one bit of the last number of the last row."""
    changed = rows.copy()
    changed.view(np.int64)[-1, -1] ^= is_last
    return changed


def everything(rows: np.ndarray, is_last: bool) -> np.ndarray:
    """Adds 1e-9 to every number except the time."""
    return rows + np.where(np.arange(rows.shape[1]) > 0, 1e-9, 0.0)


def half_of_the_rows(rows: np.ndarray, is_last: bool) -> np.ndarray:
    """Keeps every other row."""
    return rows[::2]


def blocks(count: int) -> Iterator[tuple[int, np.ndarray]]:
    """Yields the rows of the table in blocks, each with the number of its first row."""
    random = np.random.default_rng(0)
    for first in range(0, count, BLOCK):
        block = random.standard_normal((BLOCK, len(COLUMNS)))
        block[:, 0] = np.arange(first, first + BLOCK) * 0.002
        yield first, block


def write(path: Path, count: int, change: Change = lambda rows, is_last: rows) -> None:
    with TableWriter(str(path), "csv", COLUMNS) as table:
        for first, block in blocks(count):
            table.write(np.ascontiguousarray(change(block, first + BLOCK == count)))
        table.publish()


def compare(title: str, a: Path, b: Path, repeats: int) -> None:
    """Prints the medians, and the medians of the ratios of adjacent runs."""
    commands: dict[str, tuple[str, ...]] = {
        "mjrun diff": (sys.executable, "-m", "mjrun", "diff", str(a), str(b), "-q"),
        "cmp": ("cmp", str(a), str(b)),
        "pandas": (sys.executable, "-c", PANDAS, str(a), str(b)),
    }
    commands = {name: command for name, command in commands.items() if shutil.which(command[0])}
    runs = [{name: run(*command, accepted=(0, 1)) for name, command in commands.items()} for _ in range(repeats)]
    print(f"{title}: {a.stat().st_size / 1e6:.0f} MB and {b.stat().st_size / 1e6:.0f} MB")
    for name in commands:
        wall = statistics.median(each[name].wall for each in runs)
        ratio = statistics.median(each["mjrun diff"].wall / each[name].wall for each in runs)
        peak = max(each[name].peak for each in runs)
        print(f"  {name:10} {wall:7.2f} s   mjrun's ratio {ratio:6.3f}   peak {peak / 1e6:6.0f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=1000, help="of a file [MB]")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument(
        "--folder", type=Path, help="where the files are made, instead of the system's temporary folder"
    )
    given = parser.parse_args()
    rows = max(2, round(given.size * 1e6 / ROW / BLOCK)) * BLOCK
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        a, b = Path(folder, "a.csv"), Path(folder, "b.csv")
        write(a, rows)
        subprocess.run(["sync"], check=True)
        for change in (one_bit, everything, half_of_the_rows):
            write(b, rows, change)
            compare(change.__name__.replace("_", " "), a, b, given.repeats)


if __name__ == "__main__":
    main()
