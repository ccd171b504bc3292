"""The JSON Schema of suite files, with every installed signal, for editors."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import JsonSchemaMode, models_json_schema

from eha_bench.core import plugins
from eha_bench.core.metric import METRICS
from eha_bench.core.trial import MODES
from eha_bench.suites.suite_file import SuiteFile, TrialFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
PARAMETER = {
    "type": "string",
    "pattern": r"\$\{[A-Za-z_][A-Za-z0-9_]*\}",
    "description": "a parameter of the matrix",
}


def suite_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a suite file.

    A value may stand for a parameter of the matrix wherever a trial has a value.

    Raises:
        PluginError: an installed signal cannot be loaded.
    """
    signals = [plugins.load("signals", name) for name in sorted(plugins.names("signals"))]
    mode: JsonSchemaMode = "validation"
    models: list[tuple[type[Any], JsonSchemaMode]] = [
        (model, mode) for model in (SuiteFile, TrialFile, *signals)
    ]
    references, document = models_json_schema(models)
    definitions: dict[str, Any] = document["$defs"]
    names = {model: references[model, mode]["$ref"].rsplit("/", 1)[-1] for model, _ in models}
    _offer_signals(definitions, [names[model] for model in signals], names[TrialFile])
    _offer_metrics(definitions[names[TrialFile]])
    _offer_modes(definitions[names[TrialFile]])
    _allow_parameters(definitions, skip={names[SuiteFile]})
    defaults = _defaults(definitions[names[TrialFile]])
    definitions[names[TrialFile]]["required"] = ["id"]  # defaults may give the rest
    definitions["Parameter"] = PARAMETER
    suite: dict[str, Any] = definitions.pop(names[SuiteFile])
    suite["properties"]["trials"]["items"] = {"$ref": f"#/$defs/{names[TrialFile]}"}
    suite["properties"]["defaults"] = suite["properties"]["defaults"] | defaults
    schema = {"$schema": DIALECT, "title": "eha-bench suite"} | suite | {"$defs": definitions}
    _drop_titles(schema)
    return schema


def _offer_signals(definitions: dict[str, Any], names: list[str], trial: str) -> None:
    """Make the trial's signal a union distinguished by `kind`."""
    alternatives = {
        definitions[name]["properties"]["kind"].get("const", name): {"$ref": f"#/$defs/{name}"}
        for name in names
    }
    definitions[trial]["properties"]["signal"] = {
        "type": "object",
        "required": ["kind"],
        "properties": {"kind": {"enum": sorted(alternatives)}},
        # if/then instead of oneOf: an editor then tells what is wrong with this kind only
        "allOf": [
            {
                "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
                "then": reference,
            }
            for kind, reference in sorted(alternatives.items())
        ],
        "discriminator": {"propertyName": "kind"},
    }


def _offer_metrics(trial: dict[str, Any]) -> None:
    """Let editors complete the ids of the built-in metrics."""
    known = {"enum": sorted(METRICS)}
    trial["properties"]["accept"]["propertyNames"] = {"anyOf": [known, {"type": "string"}]}
    items = trial["properties"]["scores"]["items"]
    items["anyOf"] = [known, *items["anyOf"]]


def _offer_modes(trial: dict[str, Any]) -> None:
    """Let editors complete the well-known control modes."""
    mode = trial["properties"]["mode"]
    known = {"enum": [item.name for item in MODES]}
    other = {"type": mode.pop("type"), "pattern": mode.pop("pattern")}
    mode["anyOf"] = [known, other]


def _allow_parameters(definitions: dict[str, Any], skip: set[str]) -> None:
    """Let every value of a trial be `${name}`, but the ones that tell which schema applies."""
    for name, definition in definitions.items():
        properties = definition.get("properties", {})
        if name in skip:
            continue
        for key, value in properties.items():
            if key not in ("kind", "id", "matrix", "signal", "description"):
                properties[key] = _or_parameter(value)


def _or_parameter(schema: dict[str, Any]) -> dict[str, Any]:
    if _takes_text(schema):
        return schema
    kept = {key: value for key, value in schema.items() if key in ("description", "default")}
    rest = {key: value for key, value in schema.items() if key not in kept and key != "title"}
    return {**kept, "anyOf": [rest, {"$ref": "#/$defs/Parameter"}]}


def _takes_text(schema: dict[str, Any]) -> bool:
    if schema.get("type") == "string":
        return not {"enum", "const", "pattern"} & set(schema)
    return any(map(_takes_text, [*schema.get("anyOf", []), *schema.get("oneOf", [])]))


def _drop_titles(schema: Any) -> None:
    """Remove pydantic's titles: they only repeat the key with a capital letter."""
    if isinstance(schema, list):
        for item in schema:
            _drop_titles(item)
    elif isinstance(schema, dict):
        for key, item in schema.items():
            _drop_titles(item)
            if key in ("properties", "$defs"):
                for definition in item.values():
                    if isinstance(definition.get("title"), str):
                        del definition["title"]


def _defaults(trial: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of what trials may leave to `defaults`."""
    properties = {
        key: value for key, value in trial["properties"].items() if key not in ("id", "matrix")
    }
    return {"type": "object", "properties": properties, "additionalProperties": False}
