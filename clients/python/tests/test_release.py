"""What is released: the changelog's form, licences that go along, and how a container and a service start the server."""

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
import parts  # noqa: E402


def test_the_changelog_has_its_form_and_tells_of_this_version() -> None:
    sections = changelog.read((CHECKOUT / "CHANGELOG.md").read_text())
    assert sections[0].version == "Unreleased"
    assert [s.version for s in sections[1:]].index(changelog.version()) == 0
    assert changelog.version() in changelog.checked(final=False)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("## Unreleased\n", "'## Unreleased'; allowed"),
        ("## [1.0.0] - 25.11.2026\n", "allowed: ## "),
        ("## [Unreleased]\n### News\n", "CHANGELOG.md:2 is '### News'; allowed: Added, Changed"),
        ("## [1.0.0] - 2026-01-01\n## [1.1.0] - 2026-02-01\n", "newest version stands first"),
    ],
)
def test_other_forms_are_refused_by_line(text: str, wrong: str) -> None:
    with pytest.raises(ValueError, match=re.escape(wrong)):
        changelog.read(text)


def test_a_draft_is_not_final(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "Cargo.toml").write_text('[package]\nversion = "1.2.0"\n')
    monkeypatch.setattr(changelog, "ROOT", tmp_path)

    def told(text: str) -> Callable[[bool], str]:
        (tmp_path / "CHANGELOG.md").write_text(text)
        return changelog.checked

    ahead = "## [Unreleased]\n### Fixed\n- It works.\n\n## [1.2.0] - 2026-11-25\n"
    assert "draft: 1.2.0 and 1 unreleased" in told(ahead)(False)
    with pytest.raises(ValueError, match="1 entries of CHANGELOG.md are unreleased"):
        told(ahead)(True)
    assert told("## [Unreleased]\n\n## [1.2.0] - 2026-11-25\n")(True) == "1.2.0 of 2026-11-25"
    with pytest.raises(ValueError, match=re.escape("Cargo.toml says 1.2.0; the newest section of CHANGELOG.md is 1.1.0")):
        told("## [Unreleased]\n\n## [1.1.0] - 2026-11-25\n")(True)


def test_where_mit_may_be_chosen_its_text_is_enough_and_notices_stay() -> None:
    mit, apache = "Permission is hereby granted, free of charge", "Apache License"
    files = {"LICENSE-APACHE": apache, "LICENSE-MIT": mit, "NOTICE": "ours"}
    assert parts.chosen("MIT OR Apache-2.0", files) == (mit, "ours")
    assert parts.chosen("Apache-2.0", {"LICENSE": apache}) == (apache,)
    assert parts.chosen("(MIT OR Apache-2.0) AND Unicode-3.0", files) == tuple(files.values()), "all that is asked for"
    assert parts.chosen("MIT OR Apache-2.0", {"LICENSE-APACHE": apache}) == (apache,), "what there is"


def test_a_container_without_tokens_does_not_listen_to_the_network(tmp_path: Path) -> None:
    recipe = (DEPLOY / "Containerfile").read_text()
    said = re.search(r"^CMD (\[.*\])$", recipe, re.MULTILINE)
    assert said is not None
    command: list[str] = json.loads(said[1])
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
def test_the_containers_health_check_knows_who_answers(client: iplw.Client) -> None:
    def healthy(port: int | None) -> bool:
        run = subprocess.run([DEPLOY / "healthy"], env={**os.environ, "IPLW_PORT": str(port)}, check=False, capture_output=True)
        return run.returncode == 0

    assert healthy(urlsplit(client.url).port)
    assert not healthy(1)


def test_the_service_runs_a_command_that_there_is(tmp_path: Path) -> None:
    unit = (DEPLOY / "iplw.service").read_text()
    said = re.search(r"^ExecStart=/usr/local/bin/iplw (.*)$", unit, re.MULTILINE)
    assert said is not None
    assert "--http 127.0.0.1:8080" in said[1], "nobody but this machine, until told otherwise"
    command = said[1].replace("${STATE_DIRECTORY}", str(tmp_path)).replace(":8080", ":0").split()
    with subprocess.Popen([find_binary(), *command], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        assert server.stdout.readline().startswith("listening on http://127.0.0.1:")
        server.terminate()
