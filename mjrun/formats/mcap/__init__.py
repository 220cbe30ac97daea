"""MCAP: a log of messages on topics, each with a time in nanoseconds, with protobuf schemas (https://mcap.dev).

`writer` writes the file, `foxglove` the messages that viewers know, and `numeric` messages of measured values.
"""

EXTRA = "mcap"
LIBRARIES = ("mcap", "foxglove_schemas_protobuf", "google.protobuf")
