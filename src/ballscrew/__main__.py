"""``ballscrew`` and ``python -m ballscrew``."""

from __future__ import annotations

import gc
import os
import sys

from ballscrew._version import __version__


def main() -> None:
    """Run the command line.  The version alone is answered without loading anything."""
    if sys.argv[1:] in (["--version"], ["-V"]):
        print(f"ballscrew {__version__}")  # noqa: T201
        return
    # The matrices are small: threads of the linear algebra would only wait for each other. Read at its start.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Modules are 170 000 objects that stay, and every search for garbage would visit them.
    gc.set_threshold(100_000)
    try:
        from ballscrew.cli.shell import run

        status = run()
    except KeyboardInterrupt:  # while the modules are loaded
        sys.stderr.write("ballscrew: interrupted.\n")
        status = 130
    sys.exit(status)


if __name__ == "__main__":
    main()
