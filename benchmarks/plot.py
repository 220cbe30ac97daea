"""Wall time and peak memory of `mjrun plot` for 10⁶ rows × 20 columns, compared with pandas and matplotlib.

All draw the same panels of the same table, each in a separate process and alternately; ratios below 1 are better. The
table is written by mjrun as parquet and as csv; pandas reads the csv with its C parser.

    python benchmarks/plot.py
    python benchmarks/plot.py --rows 100000 --repeats 1
"""

import argparse
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np
from measured_process import run

from mjrun.formats.table_writer import TableWriter
from mjrun.model.table_column import Column

CURVES = 5  # in each of four panels
PANDAS = """
import sys
import matplotlib
matplotlib.use("agg")
import matplotlib.pyplot as plt
import pandas
path, output = sys.argv[1:]
table = pandas.read_parquet(path) if path.endswith("parquet") else pandas.read_csv(path)
groups = list(dict.fromkeys(name.partition("/")[0] for name in table.columns[1:]))
_, axes = plt.subplots(len(groups), 1, sharex=True, figsize=(12.8, 7.2))
for axis, group in zip(axes, groups):
    names = [name for name in table.columns if name.startswith(group + "/")]
    table.plot(x="time", y=names, ax=axis)
plt.savefig(output, dpi=100)
"""


def write_tables(folder: Path, rows: int) -> list[Path]:
    """Writes noisy waves as parquet and as csv."""
    names = [f"{group}/joint_{i}" for group in ("qpos", "qvel", "ctrl", "sensor") for i in range(CURVES)]
    columns = [Column("time", "s"), *(Column(name, "rad") for name in names)]
    rng, block = np.random.default_rng(0), 50_000
    paths = [folder / "table.parquet", folder / "table.csv"]
    for path in paths:
        with TableWriter(str(path), path.suffix[1:], columns, {}) as writer:
            for start in range(0, rows, block):
                t = np.arange(start, min(rows, start + block)) / 1000
                waves = [np.sin(t * (i + 1) / 50) + 0.1 * rng.standard_normal(len(t)) for i in range(len(names))]
                writer.write(np.column_stack([t, *waves]))
            writer.publish()
    return paths


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for path in write_tables(Path(folder), options.rows):
            output = f"{folder}/plot.png"
            ours = (sys.executable, "-m", "mjrun", "plot", str(path), "-o", output, "--size", "1280x720", "-q")
            theirs = (sys.executable, "-c", PANDAS, str(path), output)
            pairs = [(run(*ours), run(*theirs)) for _ in range(options.repeats)]
            wall, reference = (statistics.median(pair[i].wall for pair in pairs) for i in (0, 1))
            peak, reference_peak = (max(pair[i].peak for pair in pairs) / 2**20 for i in (0, 1))
            print(f"{path.suffix[1:]:8} mjrun plot          {wall:6.2f} s {peak:6.0f} MiB")
            print(f"{'':8} pandas + matplotlib {reference:6.2f} s {reference_peak:6.0f} MiB")
            print(f"{'':8} ratio               {wall / reference:6.2f}   {peak / reference_peak:6.2f}")


if __name__ == "__main__":
    main()
