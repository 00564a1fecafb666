"""Runs commands of the program as subprocesses in a temporary directory.

    from iplw.cli import command, compute
    report = compute([command("estimate", task="bowling", seed=3, json=True)]).json()

Commands run with `--exit-with-stdin` and a pipe as their standard input. When this process ends, even by SIGKILL, the
system closes the pipe and the commands stop.
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

#: Commands that accept `--threads` and `--exit-with-stdin`.
COMMANDS = ("run", "experiment", "rollout", "measure", "estimate", "surface", "diagnose", "train", "evaluate")
#: Polling interval of a running command, s; the delay of a Ctrl-C or a cancellation.
_POLL_S = 0.2
_PREFIX = "iplw-unit-"


@dataclass(frozen=True)
class Output:
    """The output of a unit: standard output of its last command, and the files that its commands wrote."""

    #: Standard output of the last command.
    stdout: str
    #: Path below the unit's directory, with `/` -> contents.
    files: Mapping[str, bytes] = field(default_factory=dict)

    def json(self, name: str | None = None) -> Any:
        """A file parsed as JSON; without a name, the standard output."""
        return json.loads(self.stdout if name is None else self.files[name])

    def save(self, directory: str | os.PathLike[str]) -> Path:
        """Writes the files to a directory, which is created if necessary."""
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

    `files`: relative path (with `/`) -> content, written to the directory first. `threads`: threads of each command.
    """
    checked = [check(command) for command in commands]
    if not checked:
        raise ValueError("commands is empty; allowed: at least one command")
    program, stdout = find_binary(binary), ""
    with _work_directory() as directory:
        input_names = _write_inputs(directory, files or {})
        for argv in checked:
            stdout = _run([str(program), *argv, "--threads", str(threads), "--exit-with-stdin"], directory)
        return Output(stdout, _output_files(directory, input_names))


def command(name: str, **settings: object) -> list[str]:
    """A command of the program with its options: `command("estimate", real={"damping": 0.8}, rounds=2, json=True)`.

    `True` gives an option without a value; `None` and `False` omit it; a mapping becomes `damping=0.8,...`; a list repeats
    the option.
    """
    argv = [name]
    for key, value in settings.items():
        option = "--" + key.replace("_", "-")
        for item in value if isinstance(value, (list, tuple)) else [value]:
            if item is True:
                argv.append(option)
            elif item is not None and item is not False:
                argv.append(f"{option}={_option_value(item)}")
    return check(argv)


def check(argv: Sequence[str]) -> list[str]:
    """The command as a list; `ValueError` unless it is one of `COMMANDS`."""
    if isinstance(argv, str) or not argv or not all(isinstance(word, str) for word in argv):
        raise ValueError(f'command is {argv!r}; allowed: words such as ["estimate", "--seed", "1"]')
    if argv[0] not in COMMANDS:
        raise ValueError(f"command is {argv[0]!r}; allowed: {', '.join(COMMANDS)}")
    return list(argv)


def _option_value(value: object) -> str:
    if isinstance(value, Mapping):
        return ",".join(f"{key}={item}" for key, item in value.items())
    return str(value)


def _run(argv: list[str], directory: Path) -> str:
    # subprocess.PIPE does not work here: `communicate` would close it.
    read_end, write_end = os.pipe()
    try:
        with subprocess.Popen(
            argv,
            cwd=directory,
            stdin=read_end,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            # A new session: Ctrl-C in the terminal must not reach the command.
            start_new_session=True,
        ) as process:
            os.close(read_end)
            read_end = -1
            try:
                stdout, stderr = _wait(process)
            except BaseException:
                process.kill()
                raise
    finally:
        os.close(write_end)
        if read_end >= 0:
            os.close(read_end)
    words = ["iplw", *argv[1:]]
    if process.returncode < 0:
        raise CommandKilled(words, signal.Signals(-process.returncode).name)
    if process.returncode > 0:
        raise CommandFailed(words, process.returncode, _error_message(stderr))
    return stdout


def _wait(process: subprocess.Popen[str]) -> tuple[str, str]:
    # A wait without a timeout is not interrupted by Python's signal handlers, which Ray uses to cancel.
    while True:
        with suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=_POLL_S)


def _error_message(stderr: str) -> str:
    """The program's error message, or the last lines of stderr."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("iplw: ")]
    return errors[-1].removeprefix("iplw: ") if errors else "\n".join(lines[-5:])


@contextmanager
def _work_directory() -> Iterator[Path]:
    """A temporary directory for a unit. Directories left by killed units are removed by the next unit on the machine."""
    _remove_stale()
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


def _remove_stale() -> None:
    """Removes directories whose lock is free; the system releases the lock when its process ends."""
    for stale in Path(tempfile.gettempdir()).glob(_PREFIX + "*"):
        with suppress(OSError):
            lock = os.open(stale, os.O_RDONLY)
            try:
                # A directory without `work` may be under construction.
                if (stale / "work").is_dir() and stale.stat().st_uid == os.getuid():
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(stale, ignore_errors=True)
            finally:
                os.close(lock)


def _write_inputs(directory: Path, files: Mapping[str, bytes]) -> set[str]:
    for name, content in files.items():
        pure = PurePosixPath(name)
        if pure.is_absolute() or ".." in pure.parts or not pure.parts:
            raise ValueError(f"files has {name!r}; allowed: a path relative to the unit's directory")
        path = directory / pure
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return {str(PurePosixPath(name)) for name in files}


def _output_files(directory: Path, input_names: set[str]) -> dict[str, bytes]:
    """All files except the inputs, sorted by path."""
    outputs = {path.relative_to(directory).as_posix(): path for path in directory.rglob("*") if path.is_file()}
    return {name: outputs[name].read_bytes() for name in sorted(outputs) if name not in input_names}
