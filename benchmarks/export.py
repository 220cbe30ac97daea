"""Time of an export compared with a trace of the same simulation: 10 s of a model, as commands, alternately.

python benchmarks/export.py
python benchmarks/export.py --model scenes/humanoid.xml --repeats 5
"""

import argparse
import os
import statistics
import sys
import tempfile
from pathlib import Path

from measured_process import run

HUMANOID = Path(__file__).parents[1] / "scenes" / "humanoid.xml"
MJRUN = [sys.executable, "-m", "mjrun"]
FORMATS = ("glb", "html")


def compare(model: Path, duration: str, repeats: int) -> None:
    """Prints the medians of the wall and CPU times, and of the ratios of adjacent runs."""
    simulation = [str(model), "--duration", duration, "-q"]
    trace = [*MJRUN, "trace", *simulation, "-o", "trace.csv"]
    for name in FORMATS:
        export = [*MJRUN, "export", *simulation, "-o", f"scene.{name}"]
        run(*export)  # writes the bytecode of all modules
        run(*trace)
        pairs = [(run(*export), run(*trace)) for _ in range(repeats)]
        for what in ("wall", "cpu"):
            ours, theirs = (
                statistics.median(getattr(each, what) for each in times) for times in zip(*pairs, strict=True)
            )
            ratio = statistics.median(getattr(mine, what) / getattr(other, what) for mine, other in pairs)
            print(f"{name:5} {what:4}  export {ours:6.3f} s   trace {theirs:6.3f} s   {ratio:.2f} x", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=HUMANOID)
    parser.add_argument("--duration", default="10")
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    model = options.model.resolve()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # without bytecode, compiling would be most of the time
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        compare(model, options.duration, options.repeats)
        os.chdir("/")


if __name__ == "__main__":
    main()
