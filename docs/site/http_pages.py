"""Pages of the HTTP API, from the OpenAPI document: an index, a page per tag, and the schemas."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from markdown_text import table

Json = Mapping[str, Any]

#: Responses common to all operations, listed once.
COMMON_STATUSES = ("401", "403", "408", "421")


def http_pages(document: Json) -> dict[str, str]:
    """Path -> text."""
    pages = {"http/index.md": _index(document), "http/schemas.md": _schemas(document)}
    for tag in document["tags"]:
        pages[f"http/{tag['name']}.md"] = _tag(document, tag)
    return pages


def operations(document: Json) -> Iterator[tuple[str, str, Json]]:
    """Method, path and description of each operation, in the document's order."""
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield method.upper(), path, operation


def _index(document: Json) -> str:
    rows = [
        (f"[`{operation['operationId']}`]({operation['tags'][0]}.md#{operation['operationId']})", f"`{method} {path}`", operation["summary"])
        for method, path, operation in operations(document)
    ]
    notes = "\n\n".join(f"{part.strip()}." for part in document["info"]["description"].rstrip(".").split(". "))
    statuses = {code: text for _, _, operation in operations(document) for code, text in _errors(operation) if code in COMMON_STATUSES}
    return f"""# HTTP API

{notes}

A server provides interactive documentation at `/docs`, and the OpenAPI document at `/openapi.json`
([download](../files/openapi/openapi.json)). `operationId` is the operation's name in ZeroMQ and in Python's `Client.call`.

{table(("operation", "", ""), rows)}
## Common responses

{table(("status", "when"), sorted(statuses.items()))}
All are [`Problem`](schemas.md#problem). Other responses are listed with each operation.
"""


def _tag(document: Json, tag: Json) -> str:
    parts = [f"# {tag['name'].capitalize()}\n\n{tag['description']}\n"]
    for method, path, operation in operations(document):
        if tag["name"] in operation["tags"]:
            parts.append(_operation(document, method, path, operation))
    return "\n".join(parts)


def _operation(document: Json, method: str, path: str, operation: Json) -> str:
    inputs = [(f"`{p['name']}`", p["in"], _type(p["schema"]), p.get("description", "")) for p in operation.get("parameters", [])]
    body = "".join(
        f"\nBody, `{kind}`: {_type(how['schema'])}\n\n{_fields(document, how['schema'])}"
        for kind, how in operation.get("requestBody", {}).get("content", {}).items()
    )
    good = [
        (code, response["description"], ", ".join(f"`{kind}`: {_type(how['schema'])}" for kind, how in _content(response)))
        for code, response in operation["responses"].items()
        if code.startswith("2")
    ]
    bad = [(code, text, "[`Problem`](schemas.md#problem)") for code, text in _errors(operation) if code not in COMMON_STATUSES]
    scopes = [scope for rule in operation.get("security", []) for scopes in rule.values() for scope in scopes]
    may = f"\nIf the server has tokens, requires the scope `{scopes[0]}`.\n" if scopes else ""
    about = f"\n{operation['description']}\n" if operation.get("description") else ""
    return f"""
## {operation["operationId"]} {{#{operation["operationId"]}}}

`{method} {path}`

{operation["summary"]}
{about}{may}
{table(("parameter", "in", "type", ""), inputs)}{body}
{table(("status", "", "response"), good + bad)}"""


def _errors(operation: Json) -> Iterator[tuple[str, str]]:
    for code, response in operation["responses"].items():
        if not code.startswith("2"):
            yield code, response["description"]


def _content(response: Json) -> list[tuple[str, Json]]:
    return list(response.get("content", {}).items())


def _schemas(document: Json) -> str:
    parts = ["# Schemas\n\nRequest and response bodies. Numbers are in SI units.\n"]
    for name, schema in sorted(document["components"]["schemas"].items()):
        parts.append(f"\n## {name} {{#{name.lower()}}}\n\n{schema.get('description', '')}\n\n{_shape(document, schema)}")
    return "\n".join(parts)


def _shape(document: Json, schema: Json) -> str:
    text = _fields(document, schema) or f"{_type(schema)}\n"
    if "example" in schema:
        text += f"\n```json\n{json.dumps(schema['example'])}\n```\n"
    return text


def _fields(document: Json, schema: Json) -> str:
    """A table of an object's fields; empty for other types."""
    if "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    for part in schema.get("allOf", []):
        schema = {**schema, "properties": {**schema.get("properties", {}), **part.get("properties", {})}}
    required = schema.get("required", [])
    rows = [
        (f"`{name}`{' *' if name in required else ''}", _type(field), _about(field))
        for name, field in schema.get("properties", {}).items()
    ]
    return table(("field (* required)", "type", ""), rows)


def _about(field: Json) -> str:
    for part in [field, *field.get("oneOf", [])]:
        if part.get("description"):
            return str(part["description"])
    return ""


def _type(schema: Json) -> str:
    """A short description of a schema's type, with links to the schemas it refers to."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[`{name}`](schemas.md#{name.lower()})"
    for key in ("oneOf", "anyOf"):
        if key in schema:
            return " or ".join(_type(part) for part in schema[key])
    if "allOf" in schema:
        return " with ".join(_type(part) for part in schema["allOf"])
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    kind = schema.get("type", "anything")
    kinds = [_one(schema, one) for one in ([kind] if isinstance(kind, str) else kind)]
    return " or ".join(kinds)


def _one(schema: Json, kind: str) -> str:
    if kind == "array":
        items = schema.get("items") or schema.get("prefixItems", [{}])[0]
        return f"list of {_type(items)}"
    if kind == "object" and isinstance(schema.get("additionalProperties"), Mapping):
        return f"map of {_type(schema['additionalProperties'])}"
    if kind in ("integer", "number"):
        low, high = schema.get("minimum"), schema.get("maximum")
        # Bounds of the integer types are omitted.
        bounds = [f"from {low}" if low is not None else "", f"to {high}" if high is not None and high < 2**31 else ""]
        return " ".join(["integer" if kind == "integer" else "number", *filter(None, bounds)])
    return {"null": "null", "string": "bytes" if schema.get("format") == "binary" else "text"}.get(kind, kind)
