"""`make release`: everything that is published, built and tried; ends with a table. Artefacts are in dist/.

A step that is done for these very sources is not done again, so that after a failure it goes on; `AGAIN=1` forgets that,
`FINAL=1` refuses a draft (unreleased changes, or changes that are not committed). Needs a Rust toolchain, Python 3.11
and PyPI; with buildah the container's image, too.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import changelog
import image
from parts import ROOT, TARGET

DIST = ROOT / "dist"
STATE = DIST / "release.json"
BIN = Path(sys.executable).parent
#: Rust's standard library asks for this C library at least, so the program can run on it.
TAG = "manylinux_2_17"
#: Promised: bytes of the wheel; s from installing it to the first step.
MOST_BYTES, MOST_SECONDS = 15_000_000, 10.0


@dataclass
class Row:
    """A line of the table."""

    step: str
    result: str
    seconds: float
    #: Of its artefact, if it has one.
    bytes: int = 0


def main() -> int:
    """Takes every step, in order, and prints the table; the first that fails ends it."""
    DIST.mkdir(exist_ok=True)
    # maturin looks for zig by the Python that it finds.
    os.environ["PATH"] = f"{BIN}{os.pathsep}{os.environ['PATH']}"
    sources = _sources()
    done = _done_for(sources)
    rows: list[Row] = []
    for name, step in STEPS:
        if name in done and name not in UNKEPT:
            rows.append(done[name])
            continue
        print(f"{name} ...", flush=True)
        started = time.perf_counter()
        try:
            result, size = step()
        except image.NotHere as missing:
            result, size = f"NOT DONE: {missing}", 0
        except (ValueError, subprocess.CalledProcessError) as error:
            print(f"{_table(rows)}\n{name} failed: {error}", file=sys.stderr)
            return 1
        rows.append(Row(name, result, time.perf_counter() - started, size))
        STATE.write_text(json.dumps({"sources": sources, "rows": [asdict(row) for row in rows]}, indent=1))
    print(_table(rows))
    return 0


def versions() -> tuple[str, int]:
    """What is released is what the changelog tells of, and the licences are those of what is inside."""
    final = bool(os.environ.get("FINAL"))
    said = changelog.checked(final)
    changed = _out(["git", "status", "--porcelain"]) if (ROOT / ".git").exists() else ""
    if final and changed:
        raise ValueError(f"changes that are not committed:\n{changed}")
    _run([sys.executable, "release/licences.py", "--check"])
    return said, 0


def wheel() -> tuple[str, int]:
    """The program and the package; compiled for old C libraries by zig."""
    _clear("*.whl")
    _run([*_maturin("build"), "--release", "--locked", "--zig", "--target", TARGET, "--compatibility", TAG])
    built = _only("*.whl")
    if built.stat().st_size > MOST_BYTES:
        raise ValueError(f"{built.name} has {built.stat().st_size} bytes; promised are {MOST_BYTES}")
    return built.name, built.stat().st_size


def tag() -> tuple[str, int]:
    """What C library the wheel truly asks for."""
    shown = _out([str(BIN / "auditwheel"), "show", str(_only("*.whl"))])
    found = re.search(r'the following platform tag:\s*"([^"]+)"', " ".join(shown.split()))
    if found is None:
        raise ValueError(f"auditwheel says no tag: {shown}")
    if not found[1].startswith(TAG):
        raise ValueError(f"the wheel's tag is {TAG}, but auditwheel finds {found[1]}")
    return f"auditwheel: {found[1]}", 0


def sdist() -> tuple[str, int]:
    """The sources, with every file that the wheel's program was compiled from."""
    _clear("*.tar.gz")
    _run(_maturin("sdist"))
    made = _only("*.tar.gz")
    with tempfile.TemporaryDirectory() as place:
        with tarfile.open(made) as packed:
            packed.extractall(place, filter="data")
        (unpacked,) = Path(place).iterdir()
        # (maturin writes Cargo.toml anew, as cargo does when it packs.)
        needed = [*_compiled_from(), *(Path(name) for name in ("Cargo.lock", "LICENSE", "THIRD-PARTY.txt"))]
        for file in needed:
            if not (unpacked / file).is_file() or (unpacked / file).read_bytes() != (ROOT / file).read_bytes():
                raise ValueError(f"{made.name} lacks {file}, or has another")
    return f"{made.name}: all {len(needed)} files that the program is made from", made.stat().st_size


def _compiled_from() -> list[Path]:
    """What the compiler notes that it read, pages and tables inside the program included."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    noted = (target / TARGET / "release" / "iplw.d").read_text(encoding="utf-8")
    files = [Path(name) for name in noted.partition(": ")[2].split()]
    return [file.relative_to(ROOT) for file in files if file.is_relative_to(ROOT)]


def published() -> tuple[str, int]:
    """Whether PyPI would take and show it."""
    _run([str(BIN / "twine"), "check", "--strict", str(_only("*.whl")), str(_only("*.tar.gz"))])
    return "twine check --strict passes", 0


def bill() -> tuple[str, int]:
    """The bill of materials."""
    import sbom

    to = DIST / f"iplw-{changelog.version()}.cdx.json"
    count = sbom.write(_only("*.whl"), to)
    return f"{to.name}: {count} components, valid CycloneDX", to.stat().st_size


def tried() -> tuple[str, int]:
    """Installed in a fresh environment without a compiler, from the install to the first step."""
    with tempfile.TemporaryDirectory() as place:
        venv = Path(place) / "venv"
        _run([sys.executable, "-m", "venv", str(venv)])
        # No compiler, no checkout, no iplw of this machine.
        alone = {"PATH": str(venv / "bin"), "HOME": place, **_network()}
        started, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        _run([str(venv / "bin" / "pip"), "install", "--quiet", str(_only("*.whl"))], cwd=Path(place), env=alone)
        installed, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
        script = str(ROOT / "release" / "trial.py")
        told = json.loads(_out([str(venv / "bin" / "python"), "-I", script], cwd=Path(place), env=alone))
        for what in ("package", "program"):
            if not Path(told[what]).is_relative_to(venv.resolve()):
                raise ValueError(f"the {what} is {told[what]}, not the wheel's")
        if len(told["versions"]) != 1 or not told["page"]:
            raise ValueError(f"the wheel does not do what it is for: {told}")
    whole, busy = installed + told["first_step_s"], os.getloadavg()[0]
    worked = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    kept = "kept" if whole <= MOST_SECONDS else f"NOT kept ({MOST_SECONDS:g} s; {os.cpu_count()} cores, load {busy:.0f})"
    took = f"pip install {installed:.1f} s ({worked:.1f} of processors), then first step {told['first_step_s']:.1f} s"
    return f"{took}: {kept}; page answers", 0


def container() -> tuple[str, int]:
    """The image, where it can be built."""
    to = DIST / f"iplw-{changelog.version()}-image.tar.gz"
    made = image.build(_only("*.whl"), to)
    return f"{to.name} {made}", to.stat().st_size


def sums() -> tuple[str, int]:
    """SHA-256 of everything published."""
    to = DIST / "SHA256SUMS"
    files = sorted(file for file in DIST.iterdir() if file not in (to, STATE) and file.is_file())
    to.write_text("".join(f"{_digest(file)}  {file.name}\n" for file in files))
    return f"{to.name}: {len(files)} files", to.stat().st_size


STEPS: list[tuple[str, Callable[[], tuple[str, int]]]] = [
    ("versions", versions),
    ("wheel", wheel),
    ("tag", tag),
    ("sdist", sdist),
    ("published", published),
    ("bill of materials", bill),
    ("tried", tried),
    ("container", container),
    ("sums", sums),
]
#: Done every time: they take no time, or ask for what may have changed.
UNKEPT = {"versions", "sums"}


def _maturin(command: str) -> list[str]:
    return [str(BIN / "maturin"), command, "--out", str(DIST)]


def _sources() -> str:
    """A digest of everything that is compiled or packed, committed or not."""
    whole = hashlib.sha256()
    listed = _out(["git", "ls-files", "-co", "--exclude-standard"]).splitlines()
    for name in sorted(listed):
        if (ROOT / name).is_file():
            whole.update(f"{name}\0{_digest(ROOT / name)}\n".encode())
    return whole.hexdigest()


def _done_for(sources: str) -> dict[str, Row]:
    if os.environ.get("AGAIN") or not STATE.is_file():
        return {}
    kept = json.loads(STATE.read_text())
    if kept["sources"] != sources:
        return {}
    rows = [Row(**row) for row in kept["rows"]]
    return {row.step: row for row in rows if "NOT" not in row.result}


def _digest(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _clear(pattern: str) -> None:
    for file in DIST.glob(pattern):
        file.unlink()


def _only(pattern: str) -> Path:
    found = list(DIST.glob(pattern))
    if len(found) != 1:
        raise ValueError(f"dist/ should have one {pattern}, it has {len(found)}")
    return found[0]


def _network() -> dict[str, str]:
    """How this machine reaches PyPI."""
    return {k: v for k, v in os.environ.items() if k.startswith("PIP_") or k.lower().endswith("_proxy") or "CERT" in k}


def _run(command: list[str], **how: object) -> None:
    subprocess.run(command, check=True, **{"cwd": ROOT, **how})  # type: ignore[call-overload]


def _out(command: list[str], **how: object) -> str:
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, **{"cwd": ROOT, **how})  # type: ignore[call-overload]
    text: str = done.stdout
    return text


def _table(rows: list[Row]) -> str:
    lines = [f"{'step':<18} {'s':>7} {'MB':>7}  result"]
    for row in rows:
        size = f"{row.bytes / 1e6:.2f}" if row.bytes else ""
        lines.append(f"{row.step:<18} {row.seconds:>7.1f} {size:>7}  {row.result}")
    return "\n".join(lines)


if __name__ == "__main__":
    if shutil.which("cargo") is None:
        sys.exit("error: `cargo` is not on PATH: https://rustup.rs")
    sys.exit(main())
