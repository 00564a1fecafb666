"""Commands run as subprocesses in temporary directories."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest
from processes import programs, until, words

from iplw.errors import CommandFailed, CommandKilled
from iplw.cli import check, command, compute

SMALL = command("estimate", task="basketball", rounds=1, actions=4, samples=24, seed=3, json=True)
# Takes longer than any test waits.
LONG = command("estimate", task="bowling", preset="paper", json=True)


def test_formats_options() -> None:
    real = {"damping": 0.8, "noise": 0.01}
    assert command("estimate", real=real, fit=["a.b", "c.d"], no_racing=True, budget=None) == [
        "estimate",
        "--real=damping=0.8,noise=0.01",
        "--fit=a.b",
        "--fit=c.d",
        "--no-racing",
    ]


@pytest.mark.parametrize("invalid", [["serve"], ["tasks"], "estimate", [], ["estimate", 3]])
def test_rejects_other_commands(invalid: list[str]) -> None:
    with pytest.raises(ValueError, match="allowed: "):
        check(invalid)


def test_results_independent_of_thread_count() -> None:
    reports = [compute([SMALL], threads=threads).json() for threads in (1, 2, 3)]
    for report in reports:
        assert report.pop("seconds") > 0
    assert reports[0] == reports[1] == reports[2]


def test_runs_commands_in_one_temporary_directory(tmp_path: Path) -> None:
    before = set(Path(tempfile.gettempdir()).glob("iplw-unit-*"))
    measure = command("measure", task="basketball", trials=2, out="m")
    policy = b"given, and therefore not handed back"
    result = compute([measure, [*SMALL]], files={"given/policy": policy})
    assert list(result.files) == ["m/scene.json", "m/trials.csv"]
    assert result.json("m/scene.json")["format"] == "iplw.scene/1"
    assert result.json()["seed"] == 3, "standard output of the last command"
    result.save(tmp_path / "kept")
    assert (tmp_path / "kept/m/trials.csv").read_bytes() == result.files["m/trials.csv"]
    assert set(Path(tempfile.gettempdir()).glob("iplw-unit-*")) <= before


@pytest.mark.parametrize("name", ["/etc/passwd", "../up", ""])
def test_rejects_paths_outside_directory(name: str) -> None:
    with pytest.raises(ValueError, match="allowed: a path relative"):
        compute([SMALL], files={name: b""})


def test_failed_command_reports_error_message() -> None:
    with pytest.raises(CommandFailed, match="rounds") as failed:
        compute([command("estimate", rounds=0)])
    assert failed.value.code == 2


def test_distinguishes_killed_from_failed_command() -> None:
    caught: list[BaseException] = []

    def work() -> None:
        try:
            compute([LONG])
        except CommandKilled as killed:
            caught.append(killed)

    thread = threading.Thread(target=work)
    thread.start()
    os.kill(until(lambda: programs(os.getpid()))[0], signal.SIGKILL)
    thread.join(60)
    assert [str(killed).endswith("was killed by SIGKILL") for killed in caught] == [True]


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_command_ends_with_its_parent(how: signal.Signals, tmp_path: Path) -> None:
    asks = f"from iplw.cli import compute; compute([{LONG!r}])"
    remote = {**os.environ, "TMPDIR": str(tmp_path)}
    # A shell's background jobs ignore Ctrl-C, and so do the processes they start.
    heed = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
    asking = subprocess.Popen([sys.executable, "-c", asks], env=remote, stderr=subprocess.DEVNULL, preexec_fn=heed)
    program = until(lambda: programs(asking.pid))[0]
    asking.send_signal(how)
    asking.wait(60)
    until(lambda: not words(program))
    remaining = list(tmp_path.glob("iplw-unit-*"))
    assert len(remaining) == (1 if how == signal.SIGKILL else 0)
    # The next unit removes the directory of a killed one.
    again = f"from iplw.cli import compute; compute([{SMALL!r}])"
    subprocess.run([sys.executable, "-c", again], env=remote, check=True)
    assert not list(tmp_path.glob("iplw-unit-*"))


def test_rejects_stdin_input_with_exit_with_stdin() -> None:
    with pytest.raises(CommandFailed, match="--exit-with-stdin"):
        compute([["rollout"]])
