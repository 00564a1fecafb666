"""Assembles the kernel with NVIDIA's assembler and checks what the program relies on.

The stack of every entry point must be known before it runs, so there may be no calls through pointers and no recursion;
and no product may be fused with a sum. Needs the package `nvidia-cuda-nvcc-cu12`.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import nvidia.cuda_nvcc

#: Compute capabilities: the oldest that the kernel supports, and recent ones.
CAPABILITIES = ("sm_70", "sm_80", "sm_90")


def assemble(kernel: Path, capability: str) -> str:
    """The assembler's report."""
    assembler = Path(nvidia.cuda_nvcc.__path__[0]) / "bin/ptxas"
    with tempfile.TemporaryDirectory() as folder:
        command = [assembler, "-v", f"-arch={capability}", "-o", Path(folder) / "kernel.cubin", kernel]
        done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{capability}: {done.stderr}")
    return done.stdout + done.stderr


def main() -> None:
    kernel = Path(__file__).parent / "kernel.ptx"
    text = kernel.read_text()
    for pattern, meaning in ((r"\bfma\.|\bmad\.f|\b(add|sub|mul)\.f64", "an operation that is or may be fused"), (r"\.approx", "an approximation"), (r"\.callprototype", "a call through a pointer"), (r"^\.extern", "a function that is missing")):
        if re.search(pattern, text, re.M):
            sys.exit(f"the kernel contains {meaning}")
    for capability in CAPABILITIES:
        report = assemble(kernel, capability)
        stacks = [int(n) for n in re.findall(r"(\d+) bytes cumulative stack size", report)]
        if len(stacks) != len(re.findall(r"^\.visible \.entry", text, re.M)):
            sys.exit(f"{capability}: the stack of an entry point is not known: {report}")
        registers = max(int(n) for n in re.findall(r"Used (\d+) registers", report))
        print(f"{capability}: stacks of {', '.join(map(str, sorted(stacks)))} bytes, {registers} registers")


if __name__ == "__main__":
    main()
