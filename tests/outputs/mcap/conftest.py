"""Leaves out the tests of MCAP where its libraries are not installed."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("mcap_protobuf") and find_spec("foxglove_schemas_protobuf") else ["test_*.py"]
