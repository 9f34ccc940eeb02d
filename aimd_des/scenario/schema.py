"""The JSON Schema of files: editors complete keys with it, and show what they mean."""

from typing import Any

from pydantic import BaseModel

from aimd_des.scenario.scenario import Scenario

# What editors of TOML understand.
_DIALECT = "http://json-schema.org/draft-07/schema#"


def scenario_schema() -> dict[str, Any]:
    """Describe scenario files for programs.

    Returns
    -------
    dict
        A JSON Schema (draft 7) with all keys, kinds and meanings.
    """
    return file_schema(Scenario, "Scenario of aimd-des")


def file_schema(form: type[BaseModel], title: str) -> dict[str, Any]:
    """Describe a form that files may have."""
    made = form.model_json_schema(ref_template="#/definitions/{model}")
    definitions = made.pop("$defs")
    schema = _in_dialect({**made, "definitions": definitions})
    return {"$schema": _DIALECT, "title": title, **schema}


def _in_dialect(part: Any) -> Any:
    """Leave out what TOML does not have, what says nothing, and what draft 7 would not see."""
    if isinstance(part, list):
        return [_in_dialect(item) for item in part]
    if not isinstance(part, dict):
        return part
    inner = {
        key: _in_dialect(item)
        for key, item in part.items()
        # Names of classes and keys once more; a key of a scenario that is called so is a table here.
        if not (key == "title" and isinstance(item, str)) and not (key == "default" and item is None)
    }
    forms = [form for form in inner.get("anyOf", []) if form != {"type": "null"}]
    if len(forms) == 1:
        del inner["anyOf"]
        inner = {**forms[0], **inner}
    elif forms:
        inner["anyOf"] = forms
    if "$ref" in inner and len(inner) > 1:
        return {"allOf": [{"$ref": inner.pop("$ref")}], **inner}
    return inner
