"""The machine that computed a unit: the properties on which the bits of results may depend."""

from __future__ import annotations

import hashlib
import platform
import socket
import subprocess
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ..binary import find_binary

#: Instruction sets that the program and math libraries select by, widest first.
_INSTRUCTION_SETS = ("avx512f", "fma", "avx2", "avx", "sse4_2", "asimd")


@dataclass(frozen=True)
class Machine:
    """Program and processor of a node."""

    host: str
    #: Model name of the processor.
    cpu: str
    #: Architecture and the instruction sets that matter, `x86_64 avx512f fma avx2 avx sse4_2`.
    instructions: str
    #: The C library, which computes sines and logarithms: `glibc 2.36`.
    libc: str
    #: Version of the program, from `iplw --version`.
    version: str
    #: First digits of the program's SHA-256.
    build: str

    def kind(self) -> tuple[str, ...]:
        """Equal for machines with bit-identical results: program, architecture, whether it has FMA (on which trained weights
        depend; wider registers change nothing), C library."""
        architecture, *sets = self.instructions.split()
        return self.build, f"{architecture} {'with' if 'fma' in sets else 'without'} fma", self.libc


@dataclass(frozen=True)
class Ran:
    """Where and how one unit was computed."""

    machine: Machine
    #: Ray's node id.
    node: str
    #: Number of threads.
    threads: int
    #: Wall-clock time, s.
    seconds: float


def this_machine() -> Machine:
    """This machine, with its `iplw` executable."""
    binary = find_binary()
    return _machine(binary, binary.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _machine(binary: Path, _changed: int) -> Machine:
    output = subprocess.run([binary, "--version"], capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL)
    cpu, sets = _processor()
    return Machine(
        host=socket.gethostname(),
        cpu=cpu,
        instructions=" ".join([platform.machine(), *sets]),
        libc=" ".join(platform.libc_ver()).strip() or "unknown",
        version=output.stdout.split()[-1],
        build=hashlib.sha256(binary.read_bytes()).hexdigest()[:12],
    )


def _processor() -> tuple[str, list[str]]:
    """Name and instruction sets of the processor, from /proc/cpuinfo."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor() or "unknown", []
    rows = [line.partition(":") for line in text.splitlines()]
    fields = {key.strip().lower(): value.strip() for key, _, value in reversed(rows)}
    flags = (fields.get("flags") or fields.get("features") or "").split()
    return fields.get("model name") or platform.machine(), [name for name in _INSTRUCTION_SETS if name in flags]
