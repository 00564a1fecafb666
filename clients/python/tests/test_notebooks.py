"""The tutorials run from top to bottom and are stored without outputs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("matplotlib")
pytest.importorskip("pandas")

NOTEBOOKS = sorted((Path(__file__).resolve().parents[3] / "examples" / "notebooks").glob("*.ipynb"))
#: Time limit of a cell on a busy machine, s.
CELL_S = 300
#: Maximum size of one output, characters.
MOST_HTML = 200_000


def outputs(notebook: Any) -> list[Any]:
    """Outputs of the cells, in order."""
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def displayed(notebook: Any, kind: str = "text/html") -> list[str]:
    """Displayed outputs of this media type."""
    return [output["data"][kind] for output in outputs(notebook) if kind in output.get("data", {})]


def test_tutorials_exist() -> None:
    assert {file.name[:2] for file in NOTEBOOKS} == {"01", "02", "03", "04", "05", "06"}


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_stored_without_outputs(file: Path) -> None:
    notebook = nbformat.read(file, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert (notebook.nbformat, notebook.nbformat_minor) == (4, 5)
    ids = [cell.id for cell in notebook.cells]
    # Descriptive ids are stable when cells move, and diffs are readable.
    assert len(set(ids)) == len(ids) and not [id for id in ids if re.fullmatch(r"[0-9a-f-]{8,}", id)]
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not outputs(notebook) and all(cell.execution_count is None for cell in code)
    assert any("assert " in cell.source for cell in code), "the notebook must check a result"


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook_runs(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The notebook starts a private server from IPLW_BIN.
    for name in ("IPLW_URL", "IPLW_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    notebook = nbformat.read(file, as_version=4)
    runner = nbclient.NotebookClient(
        notebook, timeout=CELL_S, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    runner.execute()
    assert all(cell.execution_count for cell in notebook.cells if cell.cell_type == "code" and cell.source.strip())
    html = displayed(notebook)
    assert any('class="iplw"' in text for text in html)
    assert all(len(text) < MOST_HTML and "<script" not in text for text in html if 'class="iplw"' in text)
    # (Ray writes warnings to stderr.)
    for output in outputs(notebook) if "import ray" not in notebook_source(notebook) else []:
        assert output.get("name") != "stderr", output["text"]
    # A job has one card, which is updated in place.
    watched = notebook_source(notebook).count("wait(progress=True)")
    assert watched <= sum(bool(re.search(r"<b>\w+ job-\d+</b><span class=\"n\">succeeded<", text)) for text in html)
    assert not any('class="bar"' in text for text in html)


def notebook_source(notebook: Any) -> str:
    """The code of all cells."""
    return "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
