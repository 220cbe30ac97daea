from typing import Any

Gf: Any
Sdf: Any
Tf: Any
Usd: Any
UsdGeom: Any
UsdLux: Any
UsdShade: Any
UsdUtils: Any
UsdValidation: Any
Vt: Any
