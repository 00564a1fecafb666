"""Units of work without a cluster: commands in a directory of their own, and what becomes of them."""

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
from iplw.unit import check, command, compute

SMALL = command("estimate", task="basketball", rounds=1, actions=4, samples=24, seed=3, json=True)
LONG = command("estimate", task="bowling", preset="paper", json=True)


def test_options_are_written_as_the_program_reads_them() -> None:
    real = {"damping": 0.8, "noise": 0.01}
    assert command("estimate", real=real, fit=["a.b", "c.d"], no_racing=True, budget=None) == [
        "estimate",
        "--real=damping=0.8,noise=0.01",
        "--fit=a.b",
        "--fit=c.d",
        "--no-racing",
    ]


@pytest.mark.parametrize("wrong", [["serve"], ["tasks"], "estimate", [], ["estimate", 3]])
def test_only_commands_that_compute_are_units(wrong: list[str]) -> None:
    with pytest.raises(ValueError, match="allowed: "):
        check(wrong)


def test_results_do_not_depend_on_threads() -> None:
    reports = [compute([SMALL], threads=threads).json() for threads in (1, 2, 3)]
    for report in reports:
        assert report.pop("seconds") > 0
    assert reports[0] == reports[1] == reports[2]


def test_commands_follow_each_other_in_one_directory_that_is_gone_afterwards(tmp_path: Path) -> None:
    before = set(Path(tempfile.gettempdir()).glob("iplw-unit-*"))
    measure = command("measure", task="basketball", trials=2, out="m")
    policy = b"given, and therefore not handed back"
    found = compute([measure, [*SMALL]], files={"given/policy": policy})
    assert list(found.files) == ["m/scene.json", "m/trials.csv"]
    assert found.json("m/scene.json")["format"] == "iplw.scene/1"
    assert found.json()["seed"] == 3, "what the last command printed"
    found.save(tmp_path / "kept")
    assert (tmp_path / "kept/m/trials.csv").read_bytes() == found.files["m/trials.csv"]
    assert set(Path(tempfile.gettempdir()).glob("iplw-unit-*")) <= before


@pytest.mark.parametrize("name", ["/etc/passwd", "../up", ""])
def test_files_stay_below_the_directory(name: str) -> None:
    with pytest.raises(ValueError, match="allowed: a path below"):
        compute([SMALL], files={name: b""})


def test_a_command_that_fails_says_what_the_program_said() -> None:
    with pytest.raises(CommandFailed, match="rounds") as failed:
        compute([command("estimate", rounds=0)])
    assert failed.value.code == 2


def test_a_command_that_is_killed_is_told_from_one_that_fails() -> None:
    caught: list[BaseException] = []

    def work() -> None:
        try:
            compute([LONG])
        except CommandKilled as killed:
            caught.append(killed)

    thread = threading.Thread(target=work)
    thread.start()
    os.kill(until(lambda: programs(os.getpid()))[0], signal.SIGKILL)
    thread.join(10)
    assert [str(killed).endswith("was killed by SIGKILL") for killed in caught] == [True]


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_no_command_outlives_who_asked_for_it(how: signal.Signals, tmp_path: Path) -> None:
    asks = f"from iplw.unit import compute; compute([{LONG!r}])"
    there = {**os.environ, "TMPDIR": str(tmp_path)}
    asking = subprocess.Popen([sys.executable, "-c", asks], env=there, stderr=subprocess.DEVNULL)
    program = until(lambda: programs(asking.pid))[0]
    asking.send_signal(how)
    asking.wait(10)
    until(lambda: not words(program), seconds=15)
    left = list(tmp_path.glob("iplw-unit-*"))
    assert len(left) == (1 if how == signal.SIGKILL else 0)
    # What a kill leaves on the disk goes with the next unit.
    again = f"from iplw.unit import compute; compute([{SMALL!r}])"
    subprocess.run([sys.executable, "-c", again], env=there, check=True)
    assert not list(tmp_path.glob("iplw-unit-*"))


def test_a_command_that_reads_standard_input_does_not_end_with_it() -> None:
    with pytest.raises(CommandFailed, match="--exit-with-stdin"):
        compute([["rollout"]])
