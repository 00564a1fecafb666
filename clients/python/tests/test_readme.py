"""The Python sample of the README, as it stands there: it sees the bad fit, names the effect, and beats domain randomisation."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).resolve().parents[3] / "README.md"
#: AUCCESS that the sample must reach.
MIN_AUCCESS = 0.85
#: Lines that a visitor copies.
MAX_LINES = 20


def test_python_sample() -> None:
    sample = re.search(r"## With Python\n\n```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert sample is not None
    text = sample.group(1)
    assert len(text.splitlines()) <= MAX_LINES
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    print(done.stdout)
    assert "cannot reproduce these trials" in done.stdout
    assert "named" in done.stdout and "linear_drag" in done.stdout
    scores = {name: float(value) for name, value in re.findall(r"^(extended|domain randomisation) ([\d.]+)$", done.stdout, re.MULTILINE)}
    assert scores["extended"] >= MIN_AUCCESS and scores["extended"] > scores["domain randomisation"], scores
