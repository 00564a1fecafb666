"""Python's reference: which public names stand on which page. What none of them names gets a page of its own kind."""

from __future__ import annotations

import ast
from pathlib import Path

PACKAGE = "iplw"

#: Page -> heading, what is said first, and names in the order in which they are told.
PAGES: dict[str, tuple[str, str, list[str]]] = {
    "environments": (
        "Environments",
        "Gymnasium's environments of one world, and of many with one request a step. `import iplw` registers the ids.",
        ["envs.PlacementEnv", "PlacementVectorEnv", "make_vec", "register"],
    ),
    "client": (
        "Client and worlds",
        "The connection to a server, and what a world can be asked for. `AsyncClient` and its handles (`AsyncWorld`, "
        "`AsyncJob`, `AsyncAsking`, `AsyncPolicy`, `AsyncSurface`, `AsyncLikelihood`) have the same methods, awaited: `await "
        "client.create_world(...)`, `await world.step(action)`, `async with`, `async for`. They are told here once. What is "
        "refused is a `Problem`; `ServerUnavailable` if nobody answers.",
        ["Client", "World", "Rollout", "Rollouts"],
    ),
    "jobs": (
        "Jobs",
        "Long work: estimations, diagnoses, trainings, surfaces. `wait()` gives the result or raises.",
        ["Job", "Asking", "Proposal"],
    ),
    "policies": (
        "Policies, surfaces and likelihoods",
        "What jobs leave on the server.",
        ["Policy", "Ranked", "Surface", "Likelihood"],
    ),
    "errors": (
        "Errors",
        "What this package raises. What is wrong with an argument before anything is sent is a `ValueError` that says what "
        "is allowed.",
        ["IplwError", "Problem", "ServerUnavailable", "JobFailed", "JobCancelled"],
    ),
}
#: Told with the client.
AWAITED = "Async"
#: Packages that are the client itself.
INSIDE = {"aio", "sync"}


def python_pages(sources: Path) -> dict[str, str]:
    """Path -> text; every name of every `__all__` is on one of them."""
    pages = {f"python/{name}.md": _page(*page) for name, page in PAGES.items()}
    told = {name for _, _, names in PAGES.values() for name in names}
    more = [name for name in public(sources / PACKAGE / "__init__.py") if name not in told and not name.startswith(AWAITED)]
    if more:
        pages["python/more.md"] = _page("More", "Other public names of `iplw`.", more)
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
    made: list[str] = []
    inside = False
    for line in text.splitlines():
        code = line.startswith("    ")
        if code and not inside:
            made.append("```text" if line.lstrip().startswith(("python ", "pip ")) else "```python")
        elif inside and line.strip() and not code:
            # Blank lines before what follows belong outside.
            while made and not made[-1].strip():
                made.pop()
            made += ["```", ""]
        inside = code or (inside and not line.strip())
        made.append(line[4:] if code else line)
    if inside:
        made.append("```")
    return "\n".join(made)
