"""The JSON Schema of study files, with that of scenarios in it."""

from typing import Any

from aimd_des.scenario.schema import file_schema, scenario_schema
from aimd_des.study.study import Study

# What a file may say besides, and what is made of it when it is read.
_OF_FILES = {
    "base": "The scenario file on which the scenario is based, seen from this file.",
    "extends": "The study file over which this one is put, key by key, seen from this file.",
}


def study_schema() -> dict[str, Any]:
    """Describe study files for programs."""
    schema, scenario = file_schema(Study, "Study of aimd-des"), scenario_schema()
    properties, definitions = schema["properties"], schema["definitions"]
    definitions |= scenario["definitions"]
    keys = {key: part for key, part in scenario["properties"].items() if key != "seed"}
    meaning = properties["scenario"]["description"]
    definitions["Scenario"] = {"type": "object", "additionalProperties": False, "properties": keys}
    properties["scenario"] = {"allOf": [{"$ref": "#/definitions/Scenario"}], "description": meaning}
    for name, text in _OF_FILES.items():
        properties[name] = {"type": "string", "description": text}
    schema.pop("required", None)
    return schema
