"""The container's image of deploy/Containerfile, with the program of a wheel, by buildah and without a daemon."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
import zipfile
from pathlib import Path

from parts import ROOT

NAME = "localhost/iplw"
#: Where no registry answers, the base is made of Debian's packages.
OWN_BASE = "localhost/iplw-base:bookworm"
_BUILDAH = ["buildah", "--storage-driver", os.environ.get("STORAGE_DRIVER", "vfs")]


class NotHere(Exception):
    """This machine cannot build or run images, for the reason it says."""


def build(wheel: Path, to: Path) -> str:
    """Builds the image, tries it, and writes it to a file `.tar.gz`; says what it was made on."""
    if shutil.which("buildah") is None:
        raise NotHere("no buildah (`apt install buildah crun`)")
    base = _base()
    with tempfile.TemporaryDirectory() as place:
        _unpack(wheel, Path(place) / "out" / "iplw")
        command = ["bud", "--isolation", "chroot", "--format", "docker", "--layers=false", "--pull=never"]
        command += ["--build-context", f"build={place}", "--build-arg", f"BASE={base}", "--tag", NAME]
        _run([*_BUILDAH, *command, "--file", "deploy/Containerfile", "."])
    tried = _tried()
    plain = to.with_suffix("")
    plain.unlink(missing_ok=True)
    _run([*_BUILDAH, "push", "--quiet", NAME, f"docker-archive:{plain}:iplw"])
    _run(["gzip", "--force", "--no-name", str(plain)])
    return f"on {base}; {tried}"


def _base() -> str:
    wanted = os.environ.get("BASE", "docker.io/library/debian:bookworm-slim")
    for base in (wanted, OWN_BASE):
        if _succeeds([*_BUILDAH, "inspect", "--type", "image", base]):
            return base
    if _succeeds(["timeout", "60", *_BUILDAH, "pull", "--quiet", wanted]):
        return wanted
    if shutil.which("debootstrap") is None or os.geteuid() != 0:
        raise NotHere(f"{wanted} cannot be had, and without debootstrap (as root) no base can be made")
    with tempfile.TemporaryDirectory() as place:
        _run(["debootstrap", "--variant=minbase", "bookworm", place, "http://deb.debian.org/debian"])
        for needless in ("var/cache/apt", "var/lib/apt/lists", "usr/share/doc", "usr/share/locale", "usr/share/man"):
            shutil.rmtree(Path(place) / needless)
        made = _run([*_BUILDAH, "from", "scratch"])
        _run([*_BUILDAH, "add", "--quiet", made, place, "/"])
        _run([*_BUILDAH, "commit", "--quiet", "--rm", made, OWN_BASE])
    return OWN_BASE


def _unpack(wheel: Path, to: Path) -> None:
    to.parent.mkdir(parents=True)
    with zipfile.ZipFile(wheel) as packed:
        (name,) = (name for name in packed.namelist() if name.endswith(".data/scripts/iplw"))
        to.write_bytes(packed.read(name))
    to.chmod(0o755)


def _tried() -> str:
    """Without tokens it refuses to start; with one it answers, and its own check agrees."""
    made = _run([*_BUILDAH, "from", "--pull=never", NAME])
    inside = [*_BUILDAH, "run", "--isolation", "chroot", made, "--"]
    port = _free()
    serve = ["iplw", "serve", "--http", f"0.0.0.0:{port}", "--plaintext", "--data-dir", "/data"]
    try:
        refused = subprocess.run([*inside, *serve], capture_output=True, text=True, timeout=60)
        if refused.returncode == 0 or "token" not in refused.stderr:
            raise ValueError(f"without tokens the server should refuse the network; it said {refused.stderr!r}")
        token = _run([*inside, "iplw", "token", "new", "tried", "--scope", "read", "--data-dir", "/data"])
        server = subprocess.Popen([*inside, *serve], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            _answers(port, token)
            _run([*inside, "env", f"IPLW_PORT={port}", "iplw-healthy"])
            who = _run([*inside, "id", "-u"])
        finally:
            server.terminate()
            server.wait(30)
    finally:
        _run([*_BUILDAH, "rm", made])
    if who != "10001":
        raise ValueError(f"the container's user is {who}, not 10001")
    return "refuses the network without tokens, answers with one, its health check agrees, user 10001"


def _answers(port: int, token: str) -> None:
    asked = urllib.request.Request(f"http://127.0.0.1:{port}/v1/worlds", headers={"Authorization": f"Bearer {token}"})
    for _ in range(100):
        try:
            with urllib.request.urlopen(asked, timeout=5) as answer:
                answer.read()
                return
        except urllib.error.HTTPError:
            raise
        except OSError:
            time.sleep(0.1)
    raise ValueError("the container did not answer within 10 s")


def _free() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def _run(command: list[str]) -> str:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode != 0:
        raise ValueError(f"`{' '.join(command)}` failed: {(done.stderr or done.stdout)[-2000:]}")
    return done.stdout.strip()


def _succeeds(command: list[str]) -> bool:
    return subprocess.run(command, cwd=ROOT, capture_output=True).returncode == 0
