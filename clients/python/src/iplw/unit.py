"""A whole unit of work: commands of the program, run in a directory of their own that is gone afterwards.

    from iplw.unit import command, compute
    report = compute([command("estimate", task="bowling", seed=3, json=True)]).json()

Commands run with `--exit-with-stdin` and a pipe from us on their standard input. However this process ends, SIGKILL
included, the system closes the pipe and they stop: no unit outlives whoever asked for it.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from .errors import CommandFailed, CommandKilled
from .binary import find_binary

#: Commands that compute, and therefore take `--threads` and `--exit-with-stdin`.
COMMANDS = ("run", "experiment", "rollout", "measure", "estimate", "surface", "diagnose", "train", "evaluate")
#: How often a running command is looked at, s: what a Ctrl-C or a cancellation may have to wait.
_LOOK = 0.2
_PREFIX = "iplw-unit-"


@dataclass(frozen=True)
class Output:
    """What a unit left behind: what its last command printed, and every file that its commands wrote."""

    #: Standard output of the last command.
    stdout: str
    #: Path below the unit's directory, with `/` -> contents.
    files: Mapping[str, bytes] = field(default_factory=dict)

    def json(self, name: str | None = None) -> Any:
        """The file of that name as JSON; without a name, what was printed."""
        return json.loads(self.stdout if name is None else self.files[name])

    def save(self, directory: str | os.PathLike[str]) -> Path:
        """Writes the files below a directory, which is made where it is missing."""
        root = Path(directory)
        for name, content in self.files.items():
            path = root / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return root


def compute(
    commands: Sequence[Sequence[str]],
    *,
    files: Mapping[str, bytes] | None = None,
    threads: int = 1,
    binary: str | os.PathLike[str] | None = None,
) -> Output:
    """Runs commands (`["estimate", "--json"]`, without the program's name) one after the other in one directory.

    `files` are put there first: path below it, with `/` -> contents. Each command computes with `threads` threads.
    """
    checked = [check(command) for command in commands]
    if not checked:
        raise ValueError("commands is empty; allowed: at least one command")
    program, stdout = find_binary(binary), ""
    with _scratch() as directory:
        given = _put(directory, files or {})
        for argv in checked:
            stdout = _run([str(program), *argv, "--threads", str(threads), "--exit-with-stdin"], directory)
        return Output(stdout, _taken(directory, given))


def command(name: str, **settings: object) -> list[str]:
    """A command of the program with its options: `command("estimate", real={"damping": 0.8}, rounds=2, json=True)`.

    `True` is an option without a value, `None` and `False` none at all; a mapping becomes `damping=0.8,...`; a list
    repeats the option for each of its values.
    """
    argv = [name]
    for key, value in settings.items():
        option = "--" + key.replace("_", "-")
        for one in value if isinstance(value, (list, tuple)) else [value]:
            if one is True:
                argv.append(option)
            elif one is not None and one is not False:
                argv.append(f"{option}={_text(one)}")
    return check(argv)


def check(argv: Sequence[str]) -> list[str]:
    """The command as a list; an error unless it is one of those that compute."""
    if isinstance(argv, str) or not argv or not all(isinstance(word, str) for word in argv):
        raise ValueError(f'command is {argv!r}; allowed: words such as ["estimate", "--seed", "1"]')
    if argv[0] not in COMMANDS:
        raise ValueError(f"command is {argv[0]!r}; allowed: {', '.join(COMMANDS)}")
    return list(argv)


def _text(value: object) -> str:
    if isinstance(value, Mapping):
        return ",".join(f"{key}={one}" for key, one in value.items())
    return str(value)


def _run(argv: list[str], directory: Path) -> str:
    # Not subprocess.PIPE, which `communicate` would close at once.
    theirs, ours = os.pipe()
    try:
        with subprocess.Popen(
            argv,
            cwd=directory,
            stdin=theirs,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            # A session of its own: Ctrl-C in a terminal is Python's to handle.
            start_new_session=True,
        ) as process:
            os.close(theirs)
            theirs = -1
            try:
                stdout, stderr = _wait(process)
            except BaseException:
                process.kill()
                raise
    finally:
        os.close(ours)
        if theirs >= 0:
            os.close(theirs)
    words = ["iplw", *argv[1:]]
    if process.returncode < 0:
        raise CommandKilled(words, signal.Signals(-process.returncode).name)
    if process.returncode > 0:
        raise CommandFailed(words, process.returncode, _last(stderr))
    return stdout


def _wait(process: subprocess.Popen[str]) -> tuple[str, str]:
    # A wait without an end is not interrupted by what sets Python's signals, as Ray does to cancel.
    while True:
        with suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=_LOOK)


def _last(stderr: str) -> str:
    """The error's line, or what was said last."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    said = [line for line in lines if line.startswith("iplw: ")]
    return said[-1].removeprefix("iplw: ") if said else "\n".join(lines[-5:])


@contextmanager
def _scratch() -> Iterator[Path]:
    """A directory for a unit. Those whose unit was killed are taken away by the next on the same machine."""
    _sweep()
    directory = Path(tempfile.mkdtemp(prefix=_PREFIX))
    lock = os.open(directory, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        work = directory / "work"
        work.mkdir()
        yield work
    finally:
        shutil.rmtree(directory, ignore_errors=True)
        os.close(lock)


def _sweep() -> None:
    """Takes away directories that nobody holds: a lock goes with whoever took it, however they end."""
    for left in Path(tempfile.gettempdir()).glob(_PREFIX + "*"):
        with suppress(OSError):
            lock = os.open(left, os.O_RDONLY)
            try:
                # One without `work` may be in the making.
                if (left / "work").is_dir() and left.stat().st_uid == os.getuid():
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(left, ignore_errors=True)
            finally:
                os.close(lock)


def _put(directory: Path, files: Mapping[str, bytes]) -> set[str]:
    for name, content in files.items():
        pure = PurePosixPath(name)
        if pure.is_absolute() or ".." in pure.parts or not pure.parts:
            raise ValueError(f"files has {name!r}; allowed: a path below the unit's directory")
        path = directory / pure
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return {str(PurePosixPath(name)) for name in files}


def _taken(directory: Path, given: set[str]) -> dict[str, bytes]:
    """Every file that was not given, in order of the names."""
    found = {path.relative_to(directory).as_posix(): path for path in directory.rglob("*") if path.is_file()}
    return {name: found[name].read_bytes() for name in sorted(found) if name not in given}
