"""Where a unit was computed: what results may depend on, and what they may not."""

from __future__ import annotations

import hashlib
import platform
import socket
import subprocess
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ..binary import find_binary

#: Instruction sets that the program and mathematical libraries choose by, the widest first.
_SETS = ("avx512f", "fma", "avx2", "avx", "sse4_2", "asimd")


@dataclass(frozen=True)
class Machine:
    """A node's program and processor."""

    host: str
    #: As the processor calls itself.
    cpu: str
    #: Architecture and the instruction sets that matter, `x86_64 avx512f fma avx2 avx sse4_2`.
    instructions: str
    #: The C library, which has sines and logarithms: `glibc 2.36`.
    libc: str
    #: Of the program, as `iplw --version` says it.
    version: str
    #: First digits of the program's SHA-256.
    build: str

    def kind(self) -> tuple[str, ...]:
        """Equal for machines that give the same bits: the program, the architecture and whether it has fused operations
        (trained weights differ by that; wider registers change nothing), the C library."""
        architecture, *sets = self.instructions.split()
        return self.build, f"{architecture} {'with' if 'fma' in sets else 'without'} fma", self.libc


@dataclass(frozen=True)
class Ran:
    """How one unit was computed."""

    machine: Machine
    #: Ray's name of the node.
    node: str
    #: Threads it computed with.
    threads: int
    #: Wall clock, s.
    seconds: float


def here() -> Machine:
    """This machine, with the program that is found on it."""
    binary = find_binary()
    return _machine(binary, binary.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _machine(binary: Path, _changed: int) -> Machine:
    said = subprocess.run([binary, "--version"], capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL)
    cpu, sets = _processor()
    return Machine(
        host=socket.gethostname(),
        cpu=cpu,
        instructions=" ".join([platform.machine(), *sets]),
        libc=" ".join(platform.libc_ver()).strip() or "unknown",
        version=said.stdout.split()[-1],
        build=hashlib.sha256(binary.read_bytes()).hexdigest()[:12],
    )


def _processor() -> tuple[str, list[str]]:
    """Its name and instruction sets, as Linux tells them."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor() or "unknown", []
    rows = [line.partition(":") for line in text.splitlines()]
    told = {key.strip().lower(): value.strip() for key, _, value in reversed(rows)}
    flags = (told.get("flags") or told.get("features") or "").split()
    return told.get("model name") or platform.machine(), [name for name in _SETS if name in flags]
