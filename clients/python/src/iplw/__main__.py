"""`python -m iplw ...` runs `iplw ...`, whether or not the command is on PATH."""

from __future__ import annotations

import os
import subprocess
import sys

from .binary import find_binary
from .errors import ServerUnavailable


def main() -> int:
    """Runs the program with the same arguments; on POSIX it replaces this process."""
    try:
        command = [str(find_binary()), *sys.argv[1:]]
    except ServerUnavailable as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if os.name == "posix":
        os.execv(command[0], command)
    return subprocess.call(command)


if __name__ == "__main__":
    sys.exit(main())
