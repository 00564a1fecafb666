"""Prints the engine names to measure: lanes at every instruction set of this machine, with and without early termination at rest."""

try:
    with open("/proc/cpuinfo") as info:
        flags = info.read().split()
except OSError:
    flags = []
names = ["lanes:baseline"]
if "avx2" in flags:
    names.append("lanes:avx2")
if {"avx512f", "avx512dq", "avx512vl", "avx512bw"} <= set(flags):
    names.append("lanes:avx512")
print(*(row for name in reversed(names) for row in (name, name + "-full")))
