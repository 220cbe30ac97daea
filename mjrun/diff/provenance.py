"""What made two results, as far as they say so: versions, machines and models that are not the same."""

from collections.abc import Mapping
from typing import Any

from mjrun.errors import clean, plain
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
    changed = [
        f"the option {clean(cut(key))} is {_shown(one)} and {_shown(other)}"
        for key, one, other in _changed_options(a, b)
    ]
    return [*notes, *_model_note(a, b, is_overridden=bool(changed)), *changed]


def _changed_options(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[tuple[str, object, object]]:
    """The options of the simulation that differ, such as overrides of the model, each with both values."""
    one, other = (_part(_part(manifest, "options"), "simulation") for manifest in (a, b))
    both = [key for key in one if key in other and key not in (*SETTINGS, "model")]
    return [(key, one[key], other[key]) for key in both if plain(one[key]) != plain(other[key])]


def _model_note(a: Mapping[str, Any], b: Mapping[str, Any], *, is_overridden: bool) -> list[str]:
    """Which model differs, if one does."""
    one, other = _part(a, "model"), _part(b, "model")
    hashes = one.get("sha256"), other.get("sha256")
    if not all(hashes) or hashes[0] == hashes[1]:
        return []
    same_physics = "physics" in a and a["physics"] == b.get("physics")  # which recordings tell
    but = "; what moves in them is" if same_physics else ""
    names = _shown(one.get("path", "")), _shown(other.get("path", ""))
    if is_overridden or not all(names):
        return [f"the models, or what is overridden in them, are not the same{but}"]
    if names[0] == names[1]:
        return [f"the model {names[0]}, or a file that it names, has changed{but}"]
    return [f"the models {names[0]} and {names[1]} are not the same{but}"]


def _part(manifest: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    part = manifest.get(key)
    return part if isinstance(part, dict) else {}


def _shown(value: object) -> str:
    return clean(cut(str(value)))
