"""Diagrams of documents (`mermaid` fences), rendered in advance: pages then need neither mermaid (3 MB) nor the network.

    python docs/site/diagrams.py          renders new diagrams, deletes obsolete ones (`make diagrams`; npm and Chromium)

They are committed in `docs/pictures/diagrams`, named by a hash of their source.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DIAGRAMS = ROOT / "docs" / "pictures" / "diagrams"
FENCE = re.compile(r"^```mermaid\n(.*?)^```$", re.MULTILINE | re.DOTALL)
#: Scheme -> mermaid's theme.
THEMES = {"light": "neutral", "dark": "dark"}
MERMAID = "mermaid@11.12.1"


def replace_diagrams(text: str, up: str) -> str:
    """A document with its diagrams replaced by pictures; `up` is the relative path from its page to the root of the site."""

    def picture(result: re.Match[str]) -> str:
        name = _name(result[1])
        if missing := [scheme for scheme in THEMES if not (DIAGRAMS / f"{name}-{scheme}.svg").is_file()]:
            raise SystemExit(f"a diagram has changed and is not rendered ({', '.join(missing)}): run make diagrams")
        labels = ", ".join(label.partition("<")[0] for label in re.findall(r'"([^"]*)"', result[1]))
        return "\n".join(f"![{labels}]({up}diagrams/{name}-{scheme}.svg#only-{scheme})" for scheme in THEMES)

    return FENCE.sub(picture, text)


def _name(source: str) -> str:
    return hashlib.sha256(source.encode()).hexdigest()[:12]


def main() -> None:
    sources = {_name(source): source for file in sorted((ROOT / "docs").rglob("*.md")) for source in FENCE.findall(file.read_text())}
    DIAGRAMS.mkdir(parents=True, exist_ok=True)
    for file in DIAGRAMS.glob("*.svg"):
        if file.stem.partition("-")[0] not in sources:
            file.unlink()
    missing = [(name, scheme) for name in sources for scheme in THEMES if not (DIAGRAMS / f"{name}-{scheme}.svg").is_file()]
    if not missing:
        return
    from playwright.sync_api import sync_playwright

    folder = ROOT / "out" / "mermaid"
    folder.mkdir(parents=True, exist_ok=True)
    npm = ["npm", "install", "--silent", "--no-audit", "--no-fund", "--no-save", "--ignore-scripts", MERMAID]
    subprocess.run(npm, cwd=folder, check=True)
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        for name, scheme in missing:
            page = browser.new_page()
            page.add_script_tag(path=str(folder / "node_modules" / "mermaid" / "dist" / "mermaid.min.js"))
            # Pages are narrow: horizontal flowcharts are rendered vertically.
            vertical = sources[name].replace("flowchart LR", "flowchart TB", 1)
            svg = page.evaluate(RENDER, [vertical, THEMES[scheme]])
            (DIAGRAMS / f"{name}-{scheme}.svg").write_text(svg + "\n")
            print(f"rendered {name}-{scheme}.svg", file=sys.stderr)
        browser.close()


#: Labels as SVG text, as pictures do not display HTML; a generic font family.
RENDER = """async ([source, theme]) => {
  const flowchart = {htmlLabels: false, wrappingWidth: 400, subGraphTitleMargin: {top: 6, bottom: 30}};
  mermaid.initialize({startOnLoad: false, theme, flowchart, htmlLabels: false, fontFamily: "sans-serif",
    deterministicIds: true});
  const {svg} = await mermaid.render("diagram", source);
  return new XMLSerializer().serializeToString(new DOMParser().parseFromString(svg, "text/html").querySelector("svg"));
}"""


if __name__ == "__main__":
    main()
