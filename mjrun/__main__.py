"""`python -m mjrun` and the `mjrun` command."""

import sys


def main() -> None:
    """Runs the command line and exits with its code."""
    from mjrun.cli.standard_streams import open_standard_streams

    open_standard_streams()
    from mjrun.cli.main import run

    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
