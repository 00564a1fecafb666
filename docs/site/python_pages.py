"""Python's reference: the page of each public name. Names without a row get the page "More"."""

from __future__ import annotations

import ast
from pathlib import Path

PACKAGE = "iplw"

#: Page -> heading, introduction, names in order.
PAGES: dict[str, tuple[str, str, list[str]]] = {
    "environments": (
        "Environments",
        "Gymnasium's environments of one world, and of many with one request a step. `import iplw` registers the ids.",
        ["envs.PlacementEnv", "PlacementVectorEnv", "make_vec", "register"],
    ),
    "client": (
        "Client and worlds",
        "The connection to a server, and the methods of a world. `AsyncClient` and its resources (`AsyncWorld`, "
        "`AsyncJob`, `AsyncAskTellJob`, `AsyncPolicy`, `AsyncSurface`, `AsyncLikelihood`) have the same methods, awaited: `await "
        "client.create_world(...)`, `await world.step(action)`, `async with`, `async for`. They are documented here once. A "
        "rejected request raises `Problem`, a missing response `ServerUnavailable`.",
        ["Client", "World", "Rollout", "Rollouts"],
    ),
    "jobs": (
        "Jobs",
        "Background work: estimations, diagnoses, trainings, surfaces. `wait()` returns the result or raises.",
        ["Job", "AskTellJob", "Proposal"],
    ),
    "policies": (
        "Policies, surfaces and likelihoods",
        "Resources that jobs leave on the server.",
        ["Policy", "Ranked", "Surface", "Likelihood"],
    ),
    "errors": (
        "Errors",
        "Exceptions of this package. An invalid argument raises `ValueError` before anything is sent, with what is allowed.",
        ["IplwError", "Problem", "ServerUnavailable", "JobFailed", "JobCancelled"],
    ),
}
#: Documented with the client.
AWAITED = "Async"
#: Packages that are the client itself.
INSIDE = {"aio", "sync"}


def python_pages(sources: Path) -> dict[str, str]:
    """Path -> text; every name of every `__all__` is on one page."""
    pages = {f"python/{name}.md": _page(*page) for name, page in PAGES.items()}
    reply_data = {name for _, _, names in PAGES.values() for name in names}
    extra = [name for name in public(sources / PACKAGE / "__init__.py") if name not in reply_data and not name.startswith(AWAITED)]
    if extra:
        pages["python/more.md"] = _page("More", "Other public names of `iplw`.", extra)
    for file in sorted((sources / PACKAGE).glob("*.py")) + sorted((sources / PACKAGE).glob("*/__init__.py")):
        name = file.parent.name if file.name == "__init__.py" else file.stem
        names = public(file) if name not in (PACKAGE, *INSIDE, "__init__") else []
        if names:
            about = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
            pages[f"python/{name}.md"] = _page(f"iplw.{name}", _dedented(about), [f"{name}.{one}" for one in names])
    return pages


def public(file: Path) -> list[str]:
    """The names in a module's `__all__`, without importing it."""
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
            return [str(name) for name in ast.literal_eval(node.value)]
    return []


def _page(heading: str, about: str, names: list[str]) -> str:
    return f"# {heading}\n\n{about}\n\n" + "\n".join(f"::: {PACKAGE}.{name}\n" for name in names)


def _dedented(text: str) -> str:
    """A module's docstring, its examples in fences: indented blocks of a reStructured kind are code."""
    created: list[str] = []
    inside = False
    for line in text.splitlines():
        code = line.startswith("    ")
        if code and not inside:
            created.append("```text" if line.lstrip().startswith(("python ", "pip ")) else "```python")
        elif inside and line.strip() and not code:
            # Blank lines before the following text belong outside.
            while created and not created[-1].strip():
                created.pop()
            created += ["```", ""]
        inside = code or (inside and not line.strip())
        created.append(line[4:] if code else line)
    if inside:
        created.append("```")
    return "\n".join(created)
