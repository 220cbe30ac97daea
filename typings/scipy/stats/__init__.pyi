from typing import Any

import numpy as np

def spearmanr(a: np.ndarray, b: np.ndarray | None = ..., axis: int | None = ...) -> Any: ...

loguniform: Any
norm: Any
randint: Any
truncnorm: Any
