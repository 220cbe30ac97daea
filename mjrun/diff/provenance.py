"""What made two results, as far as they say so: versions, machines and models that are not the same."""

from collections.abc import Mapping
from typing import Any

from mjrun.errors import clean
from mjrun.formats.input_file import cut

# Keys of a manifest, and what messages call them.
VERSIONS = {"mjrun": "mjrun", "mujoco": "MuJoCo", "numpy": "numpy", "machine": "the machine"}
SETTINGS = {"timestep": "the timestep", "seed": "the seed"}


def provenance_notes(a: Mapping[str, Any] | None, b: Mapping[str, Any] | None) -> list[str]:
    """A sentence for each thing that differs between the manifests of two results, which may say anything."""
    if not a or not b:
        return []
    named = {**VERSIONS, **SETTINGS}
    both = {key: (a[key], b[key]) for key in named if key in a and key in b}
    notes = [f"{named[key]} is {_shown(one)} and {_shown(other)}" for key, (one, other) in both.items() if one != other]
    hashes = _model_hash(a), _model_hash(b)
    if all(hashes) and hashes[0] != hashes[1]:
        same_physics = "physics" in a and a["physics"] == b.get("physics")  # which recordings tell
        but = "; what moves in them is" if same_physics else ""
        notes.append(f"the models, or what is overridden in them, are not the same{but}")
    return notes


def _model_hash(manifest: Mapping[str, Any]) -> str:
    model = manifest.get("model")
    return str(model.get("sha256", "")) if isinstance(model, dict) else ""


def _shown(value: object) -> str:
    return clean(cut(str(value)))
