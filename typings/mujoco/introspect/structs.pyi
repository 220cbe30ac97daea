# A literal of thousands of entries, whose type takes pyright seconds to infer.
from collections.abc import Mapping
from typing import Any

STRUCTS: Mapping[str, Any]
