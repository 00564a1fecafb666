"""Pages of the Python reference. Public names without a row below are on the page "More"."""

from __future__ import annotations

import ast
from pathlib import Path

PACKAGE = "iplw"

#: Page -> title, introduction, names in order.
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
#: Prefix of asynchronous classes, which are documented with the synchronous ones.
ASYNC_PREFIX = "Async"
#: Packages whose names are exported by `iplw` itself.
CLIENT_PACKAGES = {"aio", "sync"}


def python_pages(sources: Path) -> dict[str, str]:
    """Path -> text. Every name of every `__all__` is on one page."""
    pages = {f"python/{name}.md": _page(*page) for name, page in PAGES.items()}
    listed = {name for _, _, names in PAGES.values() for name in names}
    extra = [name for name in public(sources / PACKAGE / "__init__.py") if name not in listed and not name.startswith(ASYNC_PREFIX)]
    if extra:
        pages["python/more.md"] = _page("More", "Other public names of `iplw`.", extra)
    for file in sorted((sources / PACKAGE).glob("*.py")) + sorted((sources / PACKAGE).glob("*/__init__.py")):
        name = file.parent.name if file.name == "__init__.py" else file.stem
        names = public(file) if name not in (PACKAGE, *CLIENT_PACKAGES, "__init__") else []
        if names:
            about = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
            pages[f"python/{name}.md"] = _page(f"iplw.{name}", _with_fences(about), [f"{name}.{one}" for one in names])
    return pages


def public(file: Path) -> list[str]:
    """The names of a module's `__all__`, without importing it."""
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
            return [str(name) for name in ast.literal_eval(node.value)]
    return []


def _page(heading: str, about: str, names: list[str]) -> str:
    return f"# {heading}\n\n{about}\n\n" + "\n".join(f"::: {PACKAGE}.{name}\n" for name in names)


def _with_fences(text: str) -> str:
    """A module's docstring with its indented examples converted to fences."""
    output: list[str] = []
    inside = False
    for line in text.splitlines():
        code = line.startswith("    ")
        if code and not inside:
            output.append("```text" if line.lstrip().startswith(("python ", "pip ")) else "```python")
        elif inside and line.strip() and not code:
            # Blank lines at the end of the block are moved after it.
            while output and not output[-1].strip():
                output.pop()
            output += ["```", ""]
        inside = code or (inside and not line.strip())
        output.append(line[4:] if code else line)
    if inside:
        output.append("```")
    return "\n".join(output)
