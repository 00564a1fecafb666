"""The HTTP API as pages, from the OpenAPI document: an index, a page for each tag, and the schemas."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from markdown_text import table

Json = Mapping[str, Any]

#: What every operation may answer, told once.
EVERYWHERE = ("401", "403", "408", "421")


def http_pages(document: Json) -> dict[str, str]:
    """Path -> text."""
    pages = {"http/index.md": _index(document), "http/schemas.md": _schemas(document)}
    for tag in document["tags"]:
        pages[f"http/{tag['name']}.md"] = _tag(document, tag)
    return pages


def operations(document: Json) -> Iterator[tuple[str, str, Json]]:
    """Method, path and what is said of each operation, in the document's order."""
    for path, methods in document["paths"].items():
        for method, message in methods.items():
            yield method.upper(), path, message


def _index(document: Json) -> str:
    rows = [
        (f"[`{message['operationId']}`]({message['tags'][0]}.md#{message['operationId']})", f"`{method} {path}`", message["summary"])
        for method, path, message in operations(document)
    ]
    notes = "\n\n".join(f"{part.strip()}." for part in document["info"]["description"].rstrip(".").split(". "))
    statuses = {code: text for _, _, message in operations(document) for code, text in _refusals(message) if code in EVERYWHERE}
    return f"""# HTTP API

{notes}

A server shows the same at `/docs`, to be tried out, and the document at `/openapi.json`; here it is as
[a file](../files/openapi/openapi.json). `operationId` is the operation's name over ZeroMQ and in Python's `Client.call`.

{table(("operation", "", ""), rows)}
## What any operation may answer

{table(("status", "when"), sorted(statuses.items()))}
All are [`Problem`](schemas.md#problem). What each operation answers beside these is told with it.
"""


def _tag(document: Json, tag: Json) -> str:
    parts = [f"# {tag['name'].capitalize()}\n\n{tag['description']}\n"]
    for method, path, message in operations(document):
        if tag["name"] in message["tags"]:
            parts.append(_operation(document, method, path, message))
    return "\n".join(parts)


def _operation(document: Json, method: str, path: str, message: Json) -> str:
    inputs = [(f"`{p['name']}`", p["in"], _type(p["schema"]), p.get("description", "")) for p in message.get("parameters", [])]
    body = "".join(
        f"\nBody, `{kind}`: {_type(how['schema'])}\n\n{_fields(document, how['schema'])}"
        for kind, how in message.get("requestBody", {}).get("content", {}).items()
    )
    good = [
        (code, answer["description"], ", ".join(f"`{kind}`: {_type(how['schema'])}" for kind, how in _content(answer)))
        for code, answer in message["responses"].items()
        if code.startswith("2")
    ]
    bad = [(code, text, "[`Problem`](schemas.md#problem)") for code, text in _refusals(message) if code not in EVERYWHERE]
    scopes = [scope for rule in message.get("security", []) for scopes in rule.values() for scope in scopes]
    may = f"\nWhere the server has tokens: one that may `{scopes[0]}`.\n" if scopes else ""
    about = f"\n{message['description']}\n" if message.get("description") else ""
    return f"""
## {message["operationId"]} {{#{message["operationId"]}}}

`{method} {path}`

{message["summary"]}
{about}{may}
{table(("parameter", "in", "type", ""), inputs)}{body}
{table(("status", "", "answer"), good + bad)}"""


def _refusals(message: Json) -> Iterator[tuple[str, str]]:
    for code, answer in message["responses"].items():
        if not code.startswith("2"):
            yield code, answer["description"]


def _content(answer: Json) -> list[tuple[str, Json]]:
    return list(answer.get("content", {}).items())


def _schemas(document: Json) -> str:
    parts = ["# Schemas\n\nWhat bodies and answers hold. Numbers are SI; the unit is told where there is one.\n"]
    for name, schema in sorted(document["components"]["schemas"].items()):
        parts.append(f"\n## {name} {{#{name.lower()}}}\n\n{schema.get('description', '')}\n\n{_shape(document, schema)}")
    return "\n".join(parts)


def _shape(document: Json, schema: Json) -> str:
    text = _fields(document, schema) or f"{_type(schema)}\n"
    if "example" in schema:
        text += f"\n```json\n{json.dumps(schema['example'])}\n```\n"
    return text


def _fields(document: Json, schema: Json) -> str:
    """A table of an object's fields; nothing if it is none."""
    if "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    for part in schema.get("allOf", []):
        schema = {**schema, "properties": {**schema.get("properties", {}), **part.get("properties", {})}}
    needed = schema.get("required", [])
    rows = [
        (f"`{name}`{' *' if name in needed else ''}", _type(field), _about(field))
        for name, field in schema.get("properties", {}).items()
    ]
    return table(("field (* needed)", "type", ""), rows)


def _about(field: Json) -> str:
    for part in [field, *field.get("oneOf", [])]:
        if part.get("description"):
            return str(part["description"])
    return ""


def _type(schema: Json) -> str:
    """A schema in a few words, with links to what it names."""
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
        # Bounds of the machine's numbers are none that one needs to know.
        bounds = [f"from {low}" if low is not None else "", f"to {high}" if high is not None and high < 2**31 else ""]
        return " ".join(["whole number" if kind == "integer" else "number", *filter(None, bounds)])
    return {"null": "null", "string": "bytes" if schema.get("format") == "binary" else "text"}.get(kind, kind)
