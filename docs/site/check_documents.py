"""Checks documents against the program: commands, options, targets and paths exist, and checked blocks print the given output.

    python docs/site/check_documents.py --bin target/debug/iplw [--root DIR]

| checked | against |
|---|---|
| `iplw SUB --option` in shell blocks and inline code | `iplw SUB --help` |
| `make TARGET`, `--example NAME`, `--bench NAME` | Makefile, `examples/`, `benches/` |
| a path such as `src/world/mod.rs` in inline code | the repository |
| a block after `<!-- checked -->` | each line `$ COMMAND` is run in the repository; the following lines must equal its standard output (a line `...` matches any lines) |
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from commands import all_help

ROOT = Path(__file__).resolve().parents[2]
#: Languages of fences with shell commands; "" is none.
SHELL = {"sh", "bash", "console", "shell", "text", ""}
FENCE = re.compile(r"^(?P<indent> *)```(?P<kind>[a-z]*)\n(?P<text>.*?)^ *```\s*$", re.MULTILINE | re.DOTALL)
CHECKED = re.compile(r"<!-- checked -->\n+ *```[a-z]*\n(?P<text>.*?)^ *```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
#: `iplw` as a word, or at the end of a path at the start of a command.
CALL = re.compile(r"(?:(?:^(?:[A-Z_]+=\S+ )*|(?<=[;&|(]) ?|\$ )[\w./-]*/|^|(?<=[\s;&|(]))iplw(?=\s)", re.MULTILINE)
OPTION = re.compile(r"(?:^|(?<=[\s\[(|]))(--[a-z][a-z0-9-]*)")
#: The end of a command within its line.
END = re.compile(r"\n|\s#|&&|;|\s>|\s\|\s(?!--)|\)\s*$")
PATH = re.compile(r"^(?:src|docs|tests|examples|benches|clients|web|deploy|release|fuzz|openapi)/[\w./-]+$")
#: Documents of past versions, and generated ones, which are not checked.
HISTORY = ("docs/benchmarks/runs/", "CHANGELOG.md", "docs/calibration.md")
DOCUMENTS = ("*.md", "docs/**/*.md", "clients/python/README.md", "web/README.md", "examples/**/README.md")


@dataclass(frozen=True)
class Block:
    """A command of a checked block and its expected output."""

    command: str
    output: str


def documents(root: Path) -> Iterator[Path]:
    """Documents of the current version."""
    for pattern in DOCUMENTS:
        for file in sorted(root.glob(pattern)):
            name = file.relative_to(root).as_posix()
            if not name.startswith(HISTORY) and "node_modules" not in name and "docs/site/" not in name:
                yield file


def shell_text(text: str) -> str:
    """Shell blocks and inline code of a document, one command per line; lines continued by a backslash are joined."""
    blocks = [result["text"] for result in FENCE.finditer(text) if result["kind"] in SHELL]
    prose = FENCE.sub("", text)
    inline = [result[1].replace("\\|", "|") for result in INLINE.finditer(prose)]
    return re.sub(r"\\\n\s*", " ", "\n".join([*blocks, *inline]))


def calls(text: str) -> Iterator[str]:
    """Arguments of every call of `iplw` in a document."""
    shell = re.sub(r"'[^'\n]*'|\"[^\"\n]*\"", "TEXT", shell_text(text))
    for result in CALL.finditer(shell):
        yield " ".join(END.split(shell[result.end() :], maxsplit=1)[0].split())


def call_error(call: str, helps: dict[tuple[str, ...], str]) -> str | None:
    """The error of a call; None if it is valid."""
    words: tuple[str, ...] = ()
    for word in call.split():
        if (*words, word) not in helps:
            break
        words = (*words, word)
    options = OPTION.findall(call)
    if not words:
        first = call.split()[0] if call else ""
        if not re.fullmatch(r"[a-z][a-z-]*", first):
            # A placeholder (`iplw COMMAND --help`, `iplw ... --threads N`), or not a call.
            known = " ".join(helps.values())
            unknown = [option for option in options if option not in known and option not in ("--help", "--version")]
            return f"no command has {unknown[0]}" if unknown else None
        return f"there is no command `iplw {first}`"
    # Alternatives (`token new NAME`, `token list`) may follow, whose options are not in the parent's help.
    known = " ".join(text for name, text in helps.items() if name[: len(words)] == words)
    for option in options:
        if option not in ("--help", "--version") and not re.search(rf"{re.escape(option)}(?![\w-])", known):
            return f"`iplw {' '.join(words)}` has no {option}"
    return None


def name_errors(text: str, root: Path, targets: set[str], folder: Path | None = None) -> Iterator[str]:
    """Make targets, examples, benchmarks and paths (relative to the root or to `folder`) in a document that do not exist."""
    shell = shell_text(text)
    for target in re.findall(r"(?:^|[;&`] ?)make (?:-\w+ )?([a-z][a-z-]*)(?=$|\s)", shell, re.MULTILINE):
        if target not in targets:
            yield f"there is no `make {target}`"
    for kind, directory in (("example", "examples"), ("bench", "benches")):
        for name in re.findall(rf"--{kind} ([a-z_0-9]+)", shell):
            if not (root / directory / f"{name}.rs").is_file() and not (root / directory / name / "main.rs").is_file():
                yield f"there is no {directory}/{name}.rs"
    for code in INLINE.findall(FENCE.sub("", text)):
        name = code.partition("#")[0].rstrip("/")
        placeholder = re.search(r"[A-Z]{4,}", re.sub(r"README|CITATION|LICENSE", "", name))
        paths = [root / name, (folder or root) / name]
        if PATH.match(name) and not placeholder and not any(path.exists() for path in paths):
            yield f"there is no {name}"


def blocks(text: str) -> Iterator[Block]:
    """Commands of checked blocks with their expected output."""
    for result in CHECKED.finditer(text):
        command, output = "", [""]
        for line in result["text"].splitlines():
            if line.startswith("$ "):
                if command:
                    yield Block(command, "\n".join(output))
                command, output = line[2:], []
            elif command.endswith("\\"):
                command = command[:-1] + line
            else:
                output.append(line)
        if command:
            yield Block(command, "\n".join(output))


def matches(expected: str, observed: str) -> bool:
    """Whether an output equals the expected one; a line `...` matches any lines, trailing spaces are ignored."""
    lines = [line.rstrip() for line in observed.strip().splitlines()]
    # Numbers of observed lines that the expected lines so far may cover.
    covered = {0}
    for line in (line.rstrip() for line in expected.strip().splitlines()):
        if line == "...":
            covered = set(range(min(covered, default=len(lines) + 1), len(lines) + 1))
        else:
            covered = {i + 1 for i in covered if i < len(lines) and lines[i] == line}
    return len(lines) in covered


def block_errors(text: str, root: Path, binary: Path) -> Iterator[str]:
    """Checked blocks whose commands fail or print a different output."""
    checked = list(blocks(text))
    if not checked:
        return
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "iplw").symlink_to(binary.resolve())
        path = os.pathsep.join([folder, os.environ["PATH"]])
        for block in checked:
            bash = shutil.which("bash") or "bash"
            done = subprocess.run([bash, "-c", block.command], cwd=root, env={**os.environ, "PATH": path}, capture_output=True, text=True)
            if done.returncode:
                yield f"`{block.command}` ended with exit code {done.returncode}: {done.stderr.strip()}"
            elif not matches(block.output, done.stdout):
                yield f"`{block.command}` prints a different output:\n{done.stdout.strip()}"


def problems(root: Path, binary: Path) -> list[str]:
    """Errors of all documents, one line each."""
    helps = {words: text for words, text in all_help(binary) if words}
    targets = set(re.findall(r"^([a-z][a-z-]*):", (root / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    result = []
    for file in documents(root):
        text = file.read_text(encoding="utf-8")
        errors = [call_error(call, helps) for call in calls(text)]
        errors += [*name_errors(text, root, targets, file.parent), *block_errors(text, root, binary)]
        result += [f"{file.relative_to(root)}: {error}" for error in dict.fromkeys(errors) if error]
    return result


def main() -> int:
    """Prints all errors; returns 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=Path, required=True, help="the program")
    parser.add_argument("--root", type=Path, default=ROOT, help="the repository")
    options = parser.parse_args()
    result = problems(options.root, options.bin.resolve())
    for line in result:
        print(line, file=sys.stderr)
    return 1 if result else 0


if __name__ == "__main__":
    sys.exit(main())
