"""Read pickles of SMPL and MoSh++ without running anything that they contain.

SMPL's files were pickled by Python 2 and hold NumPy arrays, SciPy sparse matrices and
`chumpy` objects. `pickletools` of the standard library takes a pickle apart; here its opcodes build
plain containers and inert records, and every other global, so every malicious pickle, is refused.
No constructor of NumPy's, SciPy's or Python's sees a file's values before `as_array` of
`pickled_arrays` has checked them, and that is done where an array is wanted. A file that is never
asked for more bytes than it has (`bridge.runs.untrusted`) bounds what an opcode may ask for.
"""

from __future__ import annotations

import codecs
import math
import pickletools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pickle import UnpicklingError
from typing import IO, Any

import numpy as np

from bridge.body.pickled_arrays import (
    Record,
    array_parts,
    dtype_of,
    holds_objects,
    plain_text,
    whole_numbers,
)
from bridge.runs.untrusted import NpyHeader

MOST_OPCODES = 200_000
"""SMPL's files have some thousands; each makes an object of up to 200 bytes."""
_OPCODES = {operation.code: operation for operation in pickletools.opcodes}
_PLAIN = ("INT", "BININT", "LONG", "FLOAT", "BINFLOAT", "STRING", "BINSTRING", "SHORT_BIN",
          "UNICODE", "BINUNICODE", "BINBYTES", "BYTEARRAY")  # fmt: skip
"""How opcodes of numbers and text begin."""
_SPARSE = re.compile(r"(csc|csr|coo)_(?:matrix|array)")
STORAGES = {"Half": "f2", "Float": "f4", "Double": "f8", "Int": "i4", "Long": "i8"}
_TENSOR_AS_BYTES = "torch.storage", "_load_from_bytes"
_GLOBALS = {
    ("numpy", "ndarray"): "array",
    ("numpy", "dtype"): "dtype",
    ("_codecs", "encode"): "encode",
    **{(f"numpy.{core}.multiarray", "_reconstruct"): "new array" for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): "scalar" for core in ("core", "_core")},
    **{(f"numpy.{core}.numeric", "_frombuffer"): "buffer" for core in ("core", "_core")},
    ("collections", "OrderedDict"): "ordered",
    **{(module, "_reconstructor"): "new object" for module in ("copy_reg", "copyreg")},
    **{(module, "object"): "object" for module in ("__builtin__", "builtins")},
    **{(module, name): name for module in ("__builtin__", "builtins") for name in ("set", "bytes")},
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): "joblib",
    ("torch._utils", "_rebuild_tensor_v2"): "tensor",
    **{("torch", f"{name}Storage"): code for name, code in STORAGES.items()},
    # What stands beside poses and betas.
    **{("torch", f"{name}Storage"): "unread" for name in ("BFloat16", "Bool", "Byte", "Short")},
    ("torch", "Size"): "unread",
    ("torch._utils", "_rebuild_parameter"): "unread",
    # Python 3.13 alone says `pathlib._local`.
    **{
        (f"pathlib{local}", f"{kind}Path"): "unread"
        for local in ("", "._local")
        for kind in ("Posix", "PurePosix", "Windows")
    },
}


_STATEFUL = {"chumpy", "csc", "csr", "coo"}
_RECORDS = {"tensor", "joblib", "array", "dtype", "scalar", "buffer", "unread", *_STATEFUL}
"""What is kept as it was described."""


@dataclass(frozen=True)
class Global:
    """A name in a pickle that is known, in place of what it names."""

    kind: str


def load_restricted(
    file: IO[bytes], most_opcodes: int = MOST_OPCODES, *, of_torch: bool = False
) -> Any:
    """Unpickle arrays, sparse matrices, chumpy objects and plain containers.

    `of_torch`: the pickle in a torch file, whose tensors stay records: `containers.load_torch`.
    """
    stack: list[Any] = []
    marked: list[list[Any]] = []  # stacks below each mark
    memo: dict[int, Any] = {}
    for code, name, argument in _operations(file, most_opcodes):
        match name:
            case "STOP":
                return stack.pop()
            case "PROTO" | "FRAME":
                pass
            case "MARK":
                marked.append(stack)
                stack = []
            case "POP" if stack:
                stack.pop()
            case "POP" | "POP_MARK" | "ADDITEMS":
                stack = marked.pop()
            case "PUT" | "BINPUT" | "LONG_BINPUT":
                memo[argument] = stack[-1]
            case "MEMOIZE":
                memo[len(memo)] = stack[-1]
            case "GET" | "BINGET" | "LONG_BINGET":
                stack.append(memo[argument])
            case "NONE" | "EMPTY_SET":  # chumpy's sets are of no use
                stack.append(None)
            case "NEWTRUE" | "NEWFALSE":
                stack.append(name == "NEWTRUE")
            case "EMPTY_TUPLE":
                stack.append(())
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                count = int(name[-1])
                stack[-count:] = [tuple(stack[-count:])]
            case "EMPTY_LIST":
                stack.append([])
            case "EMPTY_DICT":
                stack.append({})
            case "TUPLE" | "LIST" | "DICT":
                items, stack = stack, marked.pop()
                stack.append(tuple(items) if name == "TUPLE" else items)
                if name == "DICT":
                    stack[-1] = {}
                    _set(stack[-1], items)
            case "APPENDS" | "SETITEMS":
                items, stack = stack, marked.pop()
                (_append if name == "APPENDS" else _set)(stack[-1], items)
            case "APPEND":
                _append(stack[-2], [stack.pop()])
            case "SETITEM":
                _set(stack[-3], stack[-2:])
                del stack[-2:]
            case "GLOBAL":
                module, _, attribute = argument.partition(" ")
                stack.append(_global_named(module, attribute))
            case "STACK_GLOBAL":
                stack[-2:] = [_global_named(*stack[-2:])]
            case "REDUCE" | "NEWOBJ":
                stack[-2:] = [_made(*stack[-2:])]
            case "BUILD":
                state = stack.pop()
                if not isinstance(stack[-1], Record):
                    raise UnpicklingError(f"it asks to change a {type(stack[-1]).__name__}")
                stack[-1].state = state
                if stack[-1].kind == "joblib":
                    stack[-1] = _joblib_array(file, state)
            case "BINPERSID" if of_torch:  # where the numbers of a tensor stand
                stack.append(Record("storage", (stack.pop(),)))
            case _ if name.startswith(_PLAIN):
                stack.append(argument)
            case _:
                raise UnpicklingError(f"it asks for opcode {ord(code)}")
    raise UnpicklingError(f"more than {most_opcodes} objects")


def _operations(file: IO[bytes], most: int) -> Iterator[tuple[str, str, Any]]:
    """Code, name and argument of each, at most so many."""
    for _ in range(most):
        code = file.read(1).decode("latin1")
        if code not in _OPCODES:
            raise UnpicklingError(f"it asks for opcode {ord(code)}" if code else "it ends early")
        operation = _OPCODES[code]
        if operation.name == "STRING":  # the library's takes text for ASCII
            text = file.readline().strip()[1:-1]
            yield code, operation.name, codecs.escape_decode(text)[0].decode("latin1")
        else:
            yield code, operation.name, operation.arg and _argument(operation.arg.reader, file)


def _argument(reader: Callable[[IO[bytes]], Any], file: IO[bytes]) -> Any:
    try:
        return reader(file)
    except ValueError as error:
        if "bytes at once" in str(error) or not file.read(1):
            raise UnpicklingError(f"it ends early: {error}") from error
        raise


def _append(target: Any, items: list[Any]) -> None:
    if not isinstance(target, list):
        raise UnpicklingError(f"it asks to append to a {type(target).__name__}")
    target.extend(items)


def _set(target: Any, items: list[Any]) -> None:
    keys = [plain_text(key) for key in items[::2]]
    # Tuples that hold one another a million times over can be made, but not hashed.
    names = all(isinstance(key, (str, bytes, int)) for key in keys)
    if not isinstance(target, dict) or not names:
        raise UnpicklingError("a dictionary with keys that are no names")
    target.update(zip(keys, items[1::2], strict=True))


def _global_named(module: Any, name: Any) -> Global:
    if not isinstance(module, str) or not isinstance(name, str):
        raise UnpicklingError("it asks to run what has no name")
    if module.split(".")[0] == "chumpy":
        return Global("chumpy")
    if module.startswith("scipy.sparse") and (sparse := _SPARSE.fullmatch(name)):
        return Global(sparse[1])
    if (module, name) == _TENSOR_AS_BYTES:
        raise UnpicklingError("it holds tensors of PyTorch, pickled without torch.save")
    if (module, name) not in _GLOBALS:
        raise UnpicklingError(f"it asks to run {module}.{name}")
    return Global(_GLOBALS[module, name])


def _made(function: Any, arguments: Any) -> Any:
    """What a known global makes of arguments: a record, or text."""
    if not isinstance(function, Global) or not isinstance(arguments, tuple):
        raise UnpicklingError("it asks to run something that it made")
    match function.kind, arguments:
        case "new array", (Global("array"), _, _):  # the state replaces what else there is
            return Record("array")
        case "new object", (Global(kind), Global("object"), None) if kind in _STATEFUL:
            return Record(kind)
        case "encode", (str(text),) | (str(text), "latin1"):
            return text  # protocol 2's way to write bytes; text holds one byte a character
        case "set", _:
            return None
        case "bytes", ():  # protocol 2's way to write none
            return ""
        case "ordered", ():
            return {}
        case kind, _ if kind in _RECORDS:
            return Record(kind, arguments)
    raise UnpicklingError("it asks to construct something else")


def _joblib_array(file: IO[bytes], state: Any) -> np.ndarray:
    """An array whose numbers follow in the file, as joblib writes them."""
    sizes, numbers = whole_numbers(state["shape"]), dtype_of(state["dtype"])
    if state.get("numpy_array_alignment_bytes") is not None:
        file.read(file.read(1)[0])
    count = math.prod(sizes)
    flat = np.frombuffer(file.read(count * numbers.itemsize), numbers, count)
    return flat.reshape(sizes, order="F" if state["order"] == "F" else "C")


def load_restricted_item(file: IO[bytes]) -> Any:
    """Unpickle the object in an `.npy` that holds one, as NumPy stores what is no array; of several
    the array of them, for `as_array`."""
    NpyHeader.read(file)
    array = load_restricted(file)
    if not isinstance(array, Record) or array.kind != "array":
        raise UnpicklingError("no array")
    shape, dtype, _, items = array_parts(array)
    if not holds_objects(dtype) or not isinstance(items, list):
        raise UnpicklingError("an array of objects")
    return items[0] if shape == () and len(items) == 1 else array
