"""What a damaged or hostile file can cause. Nothing else is a reason to advise against a file.

An error of the interpreter (`SystemError`, `MemoryError`), of the installation (`ImportError`) or
of the machine (too many open files) says nothing of the file that was being read.
"""

from __future__ import annotations

import errno
import pickle
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bridge.errors import DsnetError

DAMAGE = (
    ArithmeticError,
    AttributeError,
    BufferError,
    EOFError,
    LookupError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    pickle.PickleError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)
_OF_THE_MACHINE = frozenset(
    {errno.EACCES, errno.EIO, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EPERM}
)


@contextmanager
def damage_refused(
    refusal: Callable[[Exception], DsnetError], *libraries: type[Exception]
) -> Iterator[None]:
    """Turn what a damaged file can cause into a refusal of it; let all else pass.

    Parameters
    ----------
    refusal : makes it of the error.
    libraries : what the file's reader raises of its own; `RecursionError` where it follows what
        the file nests.
    """
    try:
        yield
    except (*DAMAGE, *libraries) as error:
        ours = isinstance(error, RecursionError) and RecursionError not in libraries
        if ours or is_of_the_machine(error):
            raise
        raise refusal(error) from error


def is_of_the_machine(error: Exception) -> bool:
    """Whether the system refused to read a file, whatever is in it."""
    return isinstance(error, OSError) and error.errno in _OF_THE_MACHINE
