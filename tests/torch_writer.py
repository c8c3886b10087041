"""Writes torch's file formats without torch, for tests: a real `Pickler` over stand-ins for torch's names."""

import io
import pickle
import sys
import types
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np

MAGIC = 0x1950A86A20F9469CFC6C

STORAGE_OF = {
    "float32": "FloatStorage",
    "float64": "DoubleStorage",
    "float16": "HalfStorage",
    "int64": "LongStorage",
    "int32": "IntStorage",
    "int16": "ShortStorage",
    "int8": "CharStorage",
    "uint8": "ByteStorage",
    "bool": "BoolStorage",
}


@dataclass(frozen=True, eq=False)
class Storage:
    """The elements that tensors view; `kind` is torch's class, by default that of the dtype."""

    elements: np.ndarray
    kind: str = ""
    count: int | None = None
    """How many elements the pickle states; by default as many as there are."""


@dataclass(frozen=True, eq=False)
class Tensor:
    """A view of a storage, counted in elements."""

    storage: Storage
    offset: Any
    size: Any
    stride: Any


@dataclass(frozen=True)
class Call:
    """Pickled as a call of an importable function."""

    function: Callable
    arguments: tuple


def _stand_in(module: str, name: str) -> type:
    return type(name, (), {"__module__": module, "__qualname__": name})


_TORCH, _UTILS = types.ModuleType("torch"), types.ModuleType("torch._utils")
for _name in (*STORAGE_OF.values(), "BFloat16Storage"):
    setattr(_TORCH, _name, _stand_in("torch", _name))
REBUILD = _stand_in("torch._utils", "_rebuild_tensor_v2")
_STATES = "protomotions.simulator.base_simulator.simulator_state"
_PROTOMOTIONS = {_STATES.rsplit(".", depth)[0]: types.ModuleType("protomotions") for depth in range(4)}
STATE_CONVERSION = _stand_in(_STATES, "StateConversion")
setattr(_PROTOMOTIONS[_STATES], "StateConversion", STATE_CONVERSION)  # noqa: B010
setattr(_UTILS, "_rebuild_tensor_v2", REBUILD)  # noqa: B010 (a module has no such attribute to a type checker)


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, storages: list[Storage], legacy: bool, protocol: int) -> None:
        super().__init__(file, protocol=protocol)
        self.storages, self.legacy, self.kept = storages, legacy, []

    def persistent_id(self, obj: Any) -> Any:
        if not isinstance(obj, Storage):
            return None
        if not any(known is obj for known in self.storages):
            self.storages.append(obj)
        key = next(index for index, known in enumerate(self.storages) if known is obj)
        count = obj.elements.size if obj.count is None else obj.count
        kind = getattr(_TORCH, obj.kind or STORAGE_OF[obj.elements.dtype.name])
        return ("storage", kind, str(key), "cpu", count, *((None,) if self.legacy else ()))

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, np.ndarray):
            flat = np.array(obj, order="C")
            strides = tuple(step // flat.itemsize for step in flat.strides)
            obj = Tensor(Storage(flat.reshape(-1)), 0, obj.shape, strides)
            self.kept.append(obj)  # The pickler remembers objects by their address.
        if isinstance(obj, Tensor):
            return REBUILD, (obj.storage, obj.offset, obj.size, obj.stride, False, OrderedDict())
        if isinstance(obj, Call):
            return obj.function, obj.arguments
        return NotImplemented


def pickled(value: Any, storages: list[Storage], legacy: bool = False, protocol: int = 2) -> bytes:
    """Return the pickle of a value; the storages of its tensors are added to the list."""
    file = io.BytesIO()
    with mock.patch.dict(sys.modules, {"torch": _TORCH, "torch._utils": _UTILS, **_PROTOMOTIONS}):
        _Pickler(file, storages, legacy, protocol).dump(value)
    return file.getvalue()


def _raw(storage: Storage, byte_order: str) -> bytes:
    elements = storage.elements
    return elements.astype(elements.dtype.newbyteorder("<" if byte_order == "little" else ">")).tobytes()


def archive(entries: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    """Return a zip archive of these entries."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as target:
        for name, content in entries.items():
            target.writestr(zipfile.ZipInfo(name), content, compress_type=compression)
    return file.getvalue()


def torch_entries(value: Any, byte_order: str = "little", protocol: int = 2, name: str = "clip") -> dict[str, bytes]:
    """Return the entries of the archive that `torch.save(value)` writes."""
    storages: list[Storage] = []
    data = pickled(value, storages, protocol=protocol)
    return {
        f"{name}/data.pkl": data,
        f"{name}/byteorder": byte_order.encode(),
        **{f"{name}/data/{key}": _raw(storage, byte_order) for key, storage in enumerate(storages)},
        f"{name}/version": b"3\n",
    }


def torch_bytes(value: Any, byte_order: str = "little", protocol: int = 2) -> bytes:
    """Return what `torch.save(value)` writes."""
    return archive(torch_entries(value, byte_order, protocol))


def legacy_bytes(value: Any, byte_order: str = "little") -> bytes:
    """Return what `torch.save(value, _use_new_zipfile_serialization=False)` writes."""
    storages: list[Storage] = []
    machine = {"protocol_version": 1001, "little_endian": byte_order == "little", "type_sizes": {"int": 4}}
    data = pickled(value, storages, legacy=True)
    parts = [pickle.dumps(item, protocol=2) for item in (MAGIC, 1001, machine)]
    parts += [data, pickle.dumps([str(key) for key in range(len(storages))], protocol=2)]
    for storage in storages:
        parts += [storage.elements.size.to_bytes(8, byte_order), _raw(storage, byte_order)]
    return b"".join(parts)
