"""Writes pickles as joblib does, without joblib: an array's bytes stand right behind its description."""

import io
import pickle
import sys
import types
import zlib
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

_MODULE = types.ModuleType("joblib.numpy_pickle")
_Wrapper = type("NumpyArrayWrapper", (), {"__module__": _MODULE.__name__})
vars(_MODULE)["NumpyArrayWrapper"] = _Wrapper


class _Pickler(pickle._Pickler):  # pyright: ignore  # only the one in Python lets bytes be written in between
    def __init__(self, file: io.BytesIO, protocol: int, alignment: int | None) -> None:
        super().__init__(file, protocol=protocol)
        self.file, self.alignment = file, alignment

    def save(self, obj: Any, save_persistent_id: bool = True) -> None:
        if not isinstance(obj, np.ndarray):
            super().save(obj, save_persistent_id)
            return
        order = "F" if obj.flags.f_contiguous and not obj.flags.c_contiguous else "C"
        wrapper = _Wrapper()
        vars(wrapper).update(subclass=np.ndarray, shape=obj.shape, order=order, dtype=obj.dtype, allow_mmap=False)
        if self.alignment is not None:
            vars(wrapper).update(numpy_array_alignment_bytes=self.alignment)
        super().save(wrapper)
        if self.proto >= 4:
            self.framer.commit_frame(force=True)
        if self.alignment is not None:
            padding = self.alignment - (self.file.tell() + 1) % self.alignment
            self.file.write(bytes([padding]) + b"\xff" * padding)
        self.file.write(obj.tobytes(order))


def joblib_bytes(value: Any, *, protocol: int = 4, alignment: int | None = 16, compressed: bool = False) -> bytes:
    """Return what `joblib.dump(value, ..., compress=compressed)` writes; without alignment as up to version 1.1."""
    file = io.BytesIO()
    with mock.patch.dict(sys.modules, {"joblib": types.ModuleType("joblib"), _MODULE.__name__: _MODULE}):
        _Pickler(file, protocol, alignment).dump(value)
    return zlib.compress(file.getvalue()) if compressed else file.getvalue()


def write_joblib(path: Path, value: Any, **settings: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(joblib_bytes(value, **settings))
    return path
