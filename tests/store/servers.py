"""A PostgreSQL server for tests: Debian's package, run by its own user in a temporary folder."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
import time
from itertools import count
from pathlib import Path

import pg8000.native

_USER = "postgres"
_NUMBERS = count()


def find_postgresql() -> Path | str:
    """Folder of the server's programs, or the reason why there is none."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if not found:
        return "PostgreSQL is not installed: apt-get install postgresql"
    if os.name == "posix" and os.geteuid() == 0 and shutil.which("runuser") is None:
        return "PostgreSQL refuses root, and there is no runuser"
    return found[-1].parent


class PostgreSQL:
    """A server on a free port of the loopback interface."""

    def __init__(self, programs: Path) -> None:
        self.programs = programs
        self.folder = Path(tempfile.mkdtemp(prefix="ballscrew-postgresql-"))
        self.data = self.folder / "data"
        if os.geteuid() == 0:
            shutil.chown(self.folder, _USER, _USER)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._as_user("initdb", "-D", str(self.data), "-A", "trust", "-U", _USER, "-E", "UTF8", "--no-sync")

    def _as_user(self, program: str, *arguments: str) -> None:
        command = [str(self.programs / program), *arguments]
        if os.geteuid() == 0:
            command = ["runuser", "-u", _USER, "--", *command]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=self.folder)  # noqa: S603

    def start(self) -> None:
        # A client that is killed leaves the same rows with and without fsync.
        options = f"-p {self.port} -k {self.folder} -c listen_addresses=127.0.0.1 -c fsync=off"
        log = str(self.folder / "log")
        self._as_user("pg_ctl", "-D", str(self.data), "-o", options, "-l", log, "-t", "600", "-w", "start")

    def stop(self, mode: str = "fast") -> None:
        self._as_user("pg_ctl", "-D", str(self.data), "-m", mode, "-t", "600", "-w", "stop")

    def new_database(self, template: str | None = None) -> str:
        """URL of a new database, empty or a copy of that of another URL."""
        name = f"store{os.getpid()}_{next(_NUMBERS)}"
        deadline = time.monotonic() + 300
        while True:
            try:
                connection = pg8000.native.Connection(_USER, host="127.0.0.1", port=self.port)
                break
            except pg8000.native.InterfaceError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.1)
        copied = "template1" if template is None else template.rpartition("/")[2]
        connection.run(f"CREATE DATABASE {name} TEMPLATE {copied}")
        connection.close()
        return f"postgresql://{_USER}@127.0.0.1:{self.port}/{name}"

    def remove(self) -> None:
        self.stop("immediate")
        shutil.rmtree(self.folder, ignore_errors=True)
