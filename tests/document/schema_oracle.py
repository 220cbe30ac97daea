"""A validator of JSON Schema, as far as the schemas of documents go."""

import re
from collections.abc import Iterator, Sized
from typing import Any, cast

TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}

TOLD = {"title", "description", "default", "$schema", "$defs"}  # say nothing about values


def fits(value: Any, rule: dict[str, Any], whole: dict[str, Any]) -> bool:
    """Whether `value` is what `rule` describes, by the keywords of draft 2020-12 that our schemas use."""
    return all(_fits(key, value, rule, whole) for key in rule if key not in TOLD)


def _fits(key: str, value: Any, rule: dict[str, Any], whole: dict[str, Any]) -> bool:
    wanted, number = rule[key], isinstance(value, int | float) and not isinstance(value, bool)
    match key:
        case "$ref":
            return fits(value, whole["$defs"][wanted.removeprefix("#/$defs/")], whole)
        case "type":
            return any(_is(value, kind, number) for kind in ([wanted] if isinstance(wanted, str) else wanted))
        case "anyOf":
            return any(fits(value, one, whole) for one in wanted)
        case "oneOf":
            return sum(fits(value, one, whole) for one in wanted) == 1
        case "enum":
            return value in wanted
        case "const":
            return value == wanted
        case "properties":
            return all(fits(value[k], r, whole) for k, r in wanted.items() if isinstance(value, dict) and k in value)
        case "required":
            return not isinstance(value, dict) or all(k in value for k in wanted)
        case "additionalProperties":
            known = rule.get("properties", {})
            others = [inner for k, inner in value.items() if k not in known] if isinstance(value, dict) else []
            return all(wanted is not False and fits(other, wanted, whole) for other in others)
        case "propertyNames":
            return not isinstance(value, dict) or all(fits(name, wanted, whole) for name in value)
        case "pattern":
            return not isinstance(value, str) or re.search(wanted, value) is not None
        case "items":
            return not isinstance(value, list) or all(fits(item, wanted, whole) for item in value)
        case "prefixItems":
            return not isinstance(value, list) or all(fits(*pair, whole) for pair in zip(value, wanted, strict=False))
        case "minItems" | "maxItems" | "minLength" | "minProperties" | "maxProperties":
            if not isinstance(value, {"Length": str, "Items": list}.get(key[3:], dict)):
                return True
            count = len(cast("Sized", value))
            return count <= wanted if key.startswith("max") else count >= wanted
        case "minimum" | "exclusiveMinimum":
            return not number or (value >= wanted if key == "minimum" else value > wanted)
        case "maximum" | "exclusiveMaximum":
            return not number or (value <= wanted if key == "maximum" else value < wanted)
    raise AssertionError(f"the checker does not know {key}")


def _is(value: Any, kind: str, number: bool) -> bool:
    if kind in ("number", "integer"):
        return number and (kind == "number" or value == int(value))
    return isinstance(value, TYPES[kind])


def rules(rule: Any) -> Iterator[dict[str, Any]]:
    """Every mapping in a schema, itself first."""
    if isinstance(rule, dict):
        yield rule
        for inner in rule.values():
            yield from rules(inner)
    elif isinstance(rule, list):
        for inner in rule:
            yield from rules(inner)
