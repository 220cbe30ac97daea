# Thousands of functions without types, which take pyright seconds to read.
from typing import Any

GL: Any
