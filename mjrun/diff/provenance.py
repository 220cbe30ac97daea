"""The provenance of two results: versions, machines and models that differ, as far as their manifests state them."""

from collections.abc import Mapping
from typing import Any, cast

from mjrun.errors import clean, plain
from mjrun.formats.input_file import cut

# Keys of a manifest, and their names in messages.
VERSIONS = {"mjrun": "mjrun", "mujoco": "MuJoCo", "numpy": "numpy", "machine": "the machine"}
SETTINGS = {"timestep": "the timestep", "seed": "the seed"}


def provenance_notes(a: Mapping[str, Any] | None, b: Mapping[str, Any] | None) -> list[str]:
    """Returns a sentence for each difference between the manifests of two results, whose content is untrusted."""
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
    """Returns the options of the simulation that differ, such as overrides of the model, each with both values."""
    one, other = (manifest_part(manifest_part(manifest, "options"), "simulation") for manifest in (a, b))
    both = [key for key in one if key in other and key not in (*SETTINGS, "model")]
    return [(key, one[key], other[key]) for key in both if plain(one[key]) != plain(other[key])]


def _model_note(a: Mapping[str, Any], b: Mapping[str, Any], *, is_overridden: bool) -> list[str]:
    """Returns a sentence about the models if they differ."""
    one, other = manifest_part(a, "model"), manifest_part(b, "model")
    hashes = one.get("sha256"), other.get("sha256")
    if not all(hashes) or hashes[0] == hashes[1]:
        return []
    same_physics = "physics" in a and a["physics"] == b.get("physics")  # only recordings have it
    but = "; their physics is the same" if same_physics else ""
    names = _shown(one.get("path", "")), _shown(other.get("path", ""))
    if is_overridden or not all(names):
        return [f"the models, or their overrides, differ{but}"]
    if names[0] == names[1]:
        return [f"the model {names[0]}, or a file that it refers to, has changed{but}"]
    return [f"the models {names[0]} and {names[1]} differ{but}"]


def manifest_part(manifest: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Returns an object in a manifest; empty if the manifest, which is untrusted, has none."""
    part = manifest.get(key)
    return cast("dict[str, Any]", part) if isinstance(part, dict) else {}


def _shown(value: object) -> str:
    return clean(cut(str(value)))
