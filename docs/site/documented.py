"""Holds documents to the program: commands, options, targets and paths exist, and checked blocks print what they show.

    python docs/site/documented.py --bin target/debug/iplw [--root DIR]

| checked | how |
|---|---|
| `iplw SUB --option` in shell blocks and inline code | `iplw SUB --help` of the program |
| `make TARGET`, `--example NAME`, `--bench NAME` | Makefile, `examples/`, `benches/` |
| a path such as `src/world/mod.rs` in inline code | the checkout |
| a block after `<!-- checked -->` | each line `$ COMMAND` is run in the checkout; the lines below it must be its standard output (a line `...` stands for any lines) |
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
#: Fences that hold shell commands; "" is one without a language.
SHELL = {"sh", "bash", "console", "shell", "text", ""}
FENCE = re.compile(r"^(?P<indent> *)```(?P<kind>[a-z]*)\n(?P<text>.*?)^ *```\s*$", re.MULTILINE | re.DOTALL)
CHECKED = re.compile(r"<!-- checked -->\n+ *```[a-z]*\n(?P<text>.*?)^ *```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
#: `iplw` as a word, or as a path where a command begins: at the start of a line or after a separator.
CALL = re.compile(r"(?:(?:^(?:[A-Z_]+=\S+ )*|(?<=[;&|(]) ?|\$ )[\w./-]*/|^|(?<=[\s;&|(]))iplw(?=\s)", re.MULTILINE)
OPTION = re.compile(r"(?:^|(?<=[\s\[(|]))(--[a-z][a-z0-9-]*)")
#: Where a command ends within its line.
END = re.compile(r"\n|\s#|&&|;|\s>|\s\|\s(?!--)|\)\s*$")
PATH = re.compile(r"^(?:src|docs|tests|examples|benches|clients|web|deploy|release|fuzz|openapi)/[\w./-]+$")
#: Folders and files whose documents describe the past, or are generated.
HISTORY = ("docs/benchmarks/runs/", "CHANGELOG.md", "docs/calibration.md")
DOCUMENTS = ("*.md", "docs/**/*.md", "clients/python/README.md", "web/README.md", "examples/**/README.md")


@dataclass(frozen=True)
class Block:
    """A command of a checked block and the output below it."""

    command: str
    output: str


def documents(root: Path) -> Iterator[Path]:
    """Documents that speak of the present."""
    for pattern in DOCUMENTS:
        for file in sorted(root.glob(pattern)):
            name = file.relative_to(root).as_posix()
            if not name.startswith(HISTORY) and "node_modules" not in name and "docs/site/" not in name:
                yield file


def shell_text(text: str) -> str:
    """Shell blocks and inline code of a document, a command a line; lines that a backslash continues are joined."""
    blocks = [result["text"] for result in FENCE.finditer(text) if result["kind"] in SHELL]
    prose = FENCE.sub("", text)
    inline = [result[1].replace("\\|", "|") for result in INLINE.finditer(prose)]
    return re.sub(r"\\\n\s*", " ", "\n".join([*blocks, *inline]))


def calls(text: str) -> Iterator[str]:
    """What follows `iplw` in every call of a document, up to the end of the command."""
    shell = re.sub(r"'[^'\n]*'|\"[^\"\n]*\"", "TEXT", shell_text(text))
    for result in CALL.finditer(shell):
        yield " ".join(END.split(shell[result.end() :], maxsplit=1)[0].split())


def wrong_call(call: str, helps: dict[tuple[str, ...], str]) -> str | None:
    """What is wrong with a call; None if nothing is."""
    words: tuple[str, ...] = ()
    for word in call.split():
        if (*words, word) not in helps:
            break
        words = (*words, word)
    options = OPTION.findall(call)
    if not words:
        first = call.split()[0] if call else ""
        if not re.fullmatch(r"[a-z][a-z-]*", first):
            # A placeholder (`iplw COMMAND --help`, `iplw ... --threads N`), or no call at all.
            identified = " ".join(helps.values())
            lacking = [option for option in options if option not in identified and option not in ("--help", "--version")]
            return f"no command has {lacking[0]}" if lacking else None
        return f"there is no command `iplw {first}`"
    # A list of alternatives (`token new NAME`, `token list`) may follow; a parent's help has the options of none of them.
    identified = " ".join(text for name, text in helps.items() if name[: len(words)] == words)
    for option in options:
        if option not in ("--help", "--version") and not re.search(rf"{re.escape(option)}(?![\w-])", identified):
            return f"`iplw {' '.join(words)}` has no {option}"
    return None


def wrong_names(text: str, root: Path, targets: set[str], beside: Path | None = None) -> Iterator[str]:
    """Targets of make, examples, benchmarks and paths (from the root, or from `beside`) that a document names and that do not exist."""
    shell = shell_text(text)
    for target in re.findall(r"(?:^|[;&`] ?)make (?:-\w+ )?([a-z][a-z-]*)(?=$|\s)", shell, re.MULTILINE):
        if target not in targets:
            yield f"there is no `make {target}`"
    for kind, folder in (("example", "examples"), ("bench", "benches")):
        for name in re.findall(rf"--{kind} ([a-z_0-9]+)", shell):
            if not (root / folder / f"{name}.rs").is_file() and not (root / folder / name / "main.rs").is_file():
                yield f"there is no {folder}/{name}.rs"
    for code in INLINE.findall(FENCE.sub("", text)):
        name = code.partition("#")[0].rstrip("/")
        placeholder = re.search(r"[A-Z]{4,}", re.sub(r"README|CITATION|LICENSE", "", name))
        places = [root / name, (beside or root) / name]
        if PATH.match(name) and not placeholder and not any(place.exists() for place in places):
            yield f"there is no {name}"


def blocks(text: str) -> Iterator[Block]:
    """Commands of checked blocks with their output."""
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
    """Whether an output is the expected one; a line `...` stands for any lines, blanks at ends of lines do not count."""
    lines = [line.rstrip() for line in expected.strip().splitlines()]
    pattern = "\n".join(r"(?:.*\n?)*?" if line == "..." else re.escape(line) for line in lines)
    return re.fullmatch(pattern, "\n".join(line.rstrip() for line in observed.strip().splitlines())) is not None


def wrong_blocks(text: str, root: Path, binary: Path) -> Iterator[str]:
    """Checked blocks whose commands fail or print something else."""
    result = list(blocks(text))
    if not result:
        return
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "iplw").symlink_to(binary.resolve())
        path = os.pathsep.join([folder, os.environ["PATH"]])
        for block in result:
            bash = shutil.which("bash") or "bash"
            done = subprocess.run([bash, "-c", block.command], cwd=root, env={**os.environ, "PATH": path}, capture_output=True, text=True)
            if done.returncode:
                yield f"`{block.command}` ended with exit code {done.returncode}: {done.stderr.strip()}"
            elif not matches(block.output, done.stdout):
                yield f"`{block.command}` prints something else:\n{done.stdout.strip()}"


def problems(root: Path, binary: Path) -> list[str]:
    """Everything that documents say and that is not so, a line each."""
    helps = {words: text for words, text in all_help(binary) if words}
    targets = set(re.findall(r"^([a-z][a-z-]*):", (root / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    result = []
    for file in documents(root):
        text = file.read_text(encoding="utf-8")
        message = [wrong_call(call, helps) for call in calls(text)]
        message += [*wrong_names(text, root, targets, file.parent), *wrong_blocks(text, root, binary)]
        result += [f"{file.relative_to(root)}: {what}" for what in dict.fromkeys(message) if what]
    return result


def main() -> int:
    """Prints what is wrong; 1 if anything is."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--bin", type=Path, required=True, help="the program")
    options.add_argument("--root", type=Path, default=ROOT, help="the checkout")
    inputs = options.parse_args()
    result = problems(inputs.root, inputs.bin.resolve())
    for line in result:
        print(line, file=sys.stderr)
    return 1 if result else 0


if __name__ == "__main__":
    sys.exit(main())
