"""Profile of the batched engine by part of the step: samples of `perf`, named by the inlined functions that
contain them.

    python benches/profile.py ENGINES_BINARY SCENES.jsonl [lanes-full]

The parts are compiled into one function, so samples are attributed by `llvm-symbolizer` from the debug lines. Prints a note and exits
if `perf` or the symbolizer is missing or not permitted.
"""

import collections
import os
import subprocess
import sys
import tempfile

# By file and function; the outermost listed one counts.
PARTS = {
    ("kernel.rs", "advance"): "positions",
    ("kernel.rs", "find_contacts"): "finding contacts",
    ("kernel.rs", "push<"): "effects and gravity",
    ("kernel.rs", "warm_start"): "last step's impulses",
    ("kernel.rs", "sweep"): "contact sweeps",
    ("batch.rs", "judge"): "goals",
}


def main():
    binary, scenes = sys.argv[1:3]
    engine = sys.argv[3] if len(sys.argv) > 3 else "lanes-full"
    print(f"\n== profile of {engine}, one core: share of samples by part of the step")
    with tempfile.TemporaryDirectory() as folder:
        data = os.path.join(folder, "perf.data")
        try:
            subprocess.run(["perf", "record", "-q", "-e", "cpu-clock:u", "-F", "999", "-o", data, binary, scenes, engine],
                           check=True, capture_output=True)
            # The address within the file, independent of the load address.
            samples = subprocess.run(["perf", "script", "-i", data, "-F", "ip,sym,symoff,dso", "--show-mmap-events"],
                                     check=True, capture_output=True, text=True).stdout
            parts = shares(samples, os.path.realpath(binary))
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"skipped: {error}")
            return
    total = sum(parts.values())
    for part, count in parts.most_common():
        print(f"{part:24} {count / total:6.1%}")
    print(f"{total} samples")


def shares(script, binary):
    """Samples by part, from the output of `perf script`."""
    maps, addresses, parts = [], [], collections.Counter()
    for line in script.splitlines():
        if "PERF_RECORD_MMAP" in line and line.rstrip().endswith(binary):
            # ... [0xSTART(0xLENGTH) @ 0xOFFSET ...]: ... path
            span = line.split("[", 1)[1]
            start, rest = span.split("(", 1)
            length, rest = rest.split(")", 1)
            offset = rest.split("@", 1)[1].split()[0].rstrip("]:")
            maps.append((int(start, 16), int(length, 16), int(offset, 0)))
        elif line.strip() and "PERF_RECORD" not in line:
            ip = int(line.split()[0], 16)
            place = next((ip - start + offset for start, length, offset in maps if start <= ip < start + length), None)
            if place is None:
                parts["elsewhere"] += 1
            else:
                addresses.append(place)
    unique = sorted(set(addresses))
    lines = "\n".join(hex(virtual(binary, place)) for place in unique)
    named = subprocess.run(["llvm-symbolizer", "--inlining", "--functions=linkage", "--demangle", "--output-style=GNU",
                            "-e", binary, "-a"], input=lines, check=True, capture_output=True, text=True).stdout
    by_place, current = {}, None
    for line in named.splitlines():
        if line.startswith("0x") and " " not in line:
            current = []
            by_place[int(line, 16)] = current
        elif current is not None:
            current.append(line)
    for place in addresses:
        frames = by_place.get(virtual(binary, place), [])
        # Lines come in pairs, from the innermost function outwards: the name, and the file with the line.
        calls = [(place.rsplit("/", 1)[-1].split(":")[0], name) for name, place in zip(frames[::2], frames[1::2])]
        known = (part for file, name in reversed(calls) for (of, function), part in PARTS.items()
                 if file == of and name.startswith(function))
        parts[next(known, "the rest")] += 1
    return parts


def virtual(binary, place, cache={}):
    """Virtual address in the debug information for an offset in the file."""
    if binary not in cache:
        headers = subprocess.run(["readelf", "-lW", binary], check=True, capture_output=True, text=True).stdout
        rows = [line.split() for line in headers.splitlines() if line.split()[:1] == ["LOAD"]]
        cache[binary] = [(int(r[1], 16), int(r[2], 16), int(r[4], 16)) for r in rows]
    return next((place - offset + address for offset, address, size in cache[binary] if offset <= place < offset + size),
                place)


if __name__ == "__main__":
    main()
