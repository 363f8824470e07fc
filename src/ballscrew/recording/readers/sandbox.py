"""Limits of a process that reads one file: memory, time, no writing, and on Linux no other file."""

from __future__ import annotations

import ctypes
import math
import mmap
import struct
import sys
from contextlib import suppress
from pathlib import Path

_OPEN_FILES = 32
# Numbers of <linux/landlock.h>, https://docs.kernel.org/userspace-api/landlock.html
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION = 1
_PATH_BENEATH = 1
_READ_FILE = 1 << 2
_FILE_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}
_ALL_FILE_RIGHTS = 16
_NO_NEW_PRIVILEGES = 38  # of prctl


def limit_resources(memory: int, seconds: float) -> None:
    """Limit this process for good; what the system does not have is left out.

    Parameters
    ----------
    memory : int
        Address space beyond what is in use now, bytes.
    seconds : float
        Processor time; six times as much may pass on a busy machine.
    """
    try:
        import resource
        import signal
    except ImportError:  # on Windows
        return
    cpu = math.ceil(seconds)
    limits = {
        resource.RLIMIT_CPU: cpu,
        resource.RLIMIT_FSIZE: 0,
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_NOFILE: _OPEN_FILES,
        resource.RLIMIT_AS: _address_space() + memory,
    }
    for kind, limit in limits.items():
        # The signal of the soft limit of time differs from that of a process that is killed.
        hard = limit + 1 if kind == resource.RLIMIT_CPU else limit
        with suppress(OSError, ValueError):
            resource.setrlimit(kind, (limit, hard))
    signal.setitimer(signal.ITIMER_REAL, 6 * seconds)


def _address_space() -> int:
    """Address space in use, bytes; 1 GiB where it cannot be found."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        return pages * mmap.PAGESIZE
    except (OSError, ValueError):
        return 1 << 30


def allow_only(descriptor: int) -> bool:
    """Deny this process every file but an open one, programs, TCP and signals to others, by Landlock.

    Parameters
    ----------
    descriptor : int
        The file that can still be opened to read.

    Returns
    -------
    bool
        False if the kernel has no Landlock.
    """
    if not sys.platform.startswith("linux"):
        return False
    system = ctypes.CDLL(None, use_errno=True)
    version = system.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _VERSION)
    if version < 1:
        return False
    files = (1 << _FILE_RIGHTS.get(version, _ALL_FILE_RIGHTS)) - 1
    attributes = struct.pack("=QQQ", files, 0b11, 0b11)[: _size_of_attributes(version)]
    ruleset = system.syscall(_CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), 0)
    if ruleset < 0:
        return False
    rule = struct.pack("=Qi", _READ_FILE, descriptor)
    if system.syscall(_ADD_RULE, ruleset, _PATH_BENEATH, rule, 0):
        return False
    system.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    return bool(system.syscall(_RESTRICT_SELF, ruleset, 0) == 0)


def _size_of_attributes(version: int) -> int:
    if version < 4:
        return 8
    return 16 if version < 6 else 24
