"""Options of datasets of episodes."""

# Extras of the formats: the libraries that each installs, and what needs them.
EXTRAS: dict[str, tuple[tuple[str, ...], str]] = {
    "lerobot": (("pyarrow",), "LeRobot datasets"),
    "minari": (("pyarrow", "h5py"), "Minari datasets"),
}
