"""Releases: changelog format, licences, and how container and service start the server."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import iplw
from iplw.binary import find_binary

CHECKOUT = Path(__file__).resolve().parents[3]
DEPLOY = CHECKOUT / "deploy"
sys.path.insert(0, str(CHECKOUT / "release"))

import changelog  # noqa: E402
import convert_names  # noqa: E402
import parts  # noqa: E402


def test_changelog_format_and_version() -> None:
    sections = changelog.read((CHECKOUT / "CHANGELOG.md").read_text())
    assert sections[0].version == "Unreleased"
    assert [s.version for s in sections[1:]].index(changelog.version()) == 0
    assert changelog.version() in changelog.checked(final=False)


@pytest.mark.parametrize(
    ("text", "invalid"),
    [
        ("## Unreleased\n", "'## Unreleased'; allowed"),
        ("## [1.0.0] - 25.11.2026\n", "allowed: ## "),
        ("## [Unreleased]\n### News\n", "CHANGELOG.md:2 is '### News'; allowed: Added, Changed"),
        ("## [1.0.0] - 2026-01-01\n## [1.1.0] - 2026-02-01\n", "newest version stands first"),
    ],
)
def test_changelog_errors_name_the_line(text: str, invalid: str) -> None:
    with pytest.raises(ValueError, match=re.escape(invalid)):
        changelog.read(text)


def test_rejects_draft_as_final(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "Cargo.toml").write_text('[package]\nversion = "1.2.0"\n')
    monkeypatch.setattr(changelog, "ROOT", tmp_path)

    def response(text: str) -> Callable[[bool], str]:
        (tmp_path / "CHANGELOG.md").write_text(text)
        return changelog.checked

    ahead = "## [Unreleased]\n### Fixed\n- It works.\n\n## [1.2.0] - 2026-11-25\n"
    assert "draft: 1.2.0 and 1 unreleased" in response(ahead)(False)
    with pytest.raises(ValueError, match="1 entries of CHANGELOG.md are unreleased"):
        response(ahead)(True)
    assert response("## [Unreleased]\n\n## [1.2.0] - 2026-11-25\n")(True) == "1.2.0 of 2026-11-25"
    with pytest.raises(ValueError, match=re.escape("Cargo.toml says 1.2.0; the newest section of CHANGELOG.md is 1.1.0")):
        response("## [Unreleased]\n\n## [1.1.0] - 2026-11-25\n")(True)


def test_chooses_mit_licence_and_keeps_notices() -> None:
    mit, apache = "Permission is hereby granted, free of charge", "Apache License"
    files = {"LICENSE-APACHE": apache, "LICENSE-MIT": mit, "NOTICE": "ours"}
    assert parts.chosen("MIT OR Apache-2.0", files) == (mit, "ours")
    assert parts.chosen("Apache-2.0", {"LICENSE": apache}) == (apache,)
    assert parts.chosen("(MIT OR Apache-2.0) AND Unicode-3.0", files) == tuple(files.values()), "all required licences"
    assert parts.chosen("MIT OR Apache-2.0", {"LICENSE-APACHE": apache}) == (apache,), "the available text"


def test_container_without_tokens_does_not_start(tmp_path: Path) -> None:
    recipe = (DEPLOY / "Containerfile").read_text()
    message = re.search(r"^CMD (\[.*\])$", recipe, re.MULTILINE)
    assert message is not None
    command: list[str] = json.loads(message[1])
    assert command[:3] == ["serve", "--http", "0.0.0.0:8080"]
    command[2] = "0.0.0.0:0"
    command[command.index("/data")] = str(tmp_path)
    environment = {name: value for name, value in os.environ.items() if name != "IPLW_TOKENS"}
    run = subprocess.run(
        [find_binary(), *command], capture_output=True, text=True, timeout=30, check=False, env=environment
    )
    assert run.returncode == 2
    assert "iplw token new" in run.stderr
    assert re.search(r"^USER 10001", recipe, re.MULTILINE)


@pytest.mark.skipif(shutil.which("bash") is None, reason="images have bash")
def test_container_health_check(client: iplw.Client) -> None:
    def healthy(port: int | None) -> bool:
        run = subprocess.run([DEPLOY / "healthy"], env={**os.environ, "IPLW_PORT": str(port)}, check=False, capture_output=True)
        return run.returncode == 0

    assert healthy(urlsplit(client.url).port)
    assert not healthy(1)


def test_service_command_exists(tmp_path: Path) -> None:
    unit = (DEPLOY / "iplw.service").read_text()
    message = re.search(r"^ExecStart=/usr/local/bin/iplw (.*)$", unit, re.MULTILINE)
    assert message is not None
    assert "--http 127.0.0.1:8080" in message[1], "only this machine by default"
    command = message[1].replace("${STATE_DIRECTORY}", str(tmp_path)).replace(":8080", ":0").split()
    with subprocess.Popen([find_binary(), *command], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        assert server.stdout.readline().startswith("listening on http://127.0.0.1:")
        server.terminate()


def test_convert_names_converts_documents_and_scripts() -> None:
    posterior = {"format": "iplw.posterior/1", "config": {"follow": True}, "columns": {}, "unnamed": [{"set": 0}]}
    assert json.loads(convert_names.convert(json.dumps(posterior))) == {
        "format": "iplw.posterior/2",
        "config": {"sample_discrepancy": True},
        "columns": {},
        "discrepancy": [{"set": 0}],
    }
    tokens = {"format": "iplw.tokens/1", "tokens": [{"name": "ann", "may": "act", "sha256": "0"}], "seal": "1"}
    converted = convert_names.convert(json.dumps(tokens))
    assert json.loads(converted) == {"format": "iplw.tokens/1", "tokens": [{"name": "ann", "scope": "act", "sha256": "0"}]}
    assert convert_names.convert(converted) == converted
    script = (
        "iplw posterior --follow --out known\n"
        "iplw estimate --posterior known && iplw plan --task bowling \\\n  --belief known/posterior.json --rows prior,belief\n"
        "iplw token new ann --may act\necho --belief\n"
    )
    assert convert_names.convert(script) == (
        "iplw posterior --sample-discrepancy --out known\n"
        "iplw estimate --save-posterior known && iplw plan --task bowling \\\n"
        "  --posterior known/posterior.json --rows prior,posterior\n"
        "iplw token new ann --scope act\necho --belief\n"
    )
