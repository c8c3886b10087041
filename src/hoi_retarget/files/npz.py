"""Arrays out of .npz files without numpy's own reader: checksums compared, nothing pickled, nothing evaluated."""

import io
import lzma
import re
import struct
import zipfile
import zlib

import numpy as np

# The start of an .npy file as numpy writes it: matched, never evaluated.
_NPY = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '(?P<dtype>[<|](?P<kind>[a-zA-Z])\d*)', "
    rb"'fortran_order': (?P<fortran>True|False), 'shape': \((?P<shape>[\d, ]*)\), \} *\n",
    re.DOTALL,
)
# What zipfile and its decompressors raise for damaged archives.
_ARCHIVE_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    KeyError,
    OSError,
    RuntimeError,
    ValueError,
)

MAXIMUM_SIZE = 1 << 32
"""Bytes that all arrays of a file may unpack to: a few megabytes of it can claim any memory."""


def members(content: bytes) -> dict[str, bytes]:
    """Return the .npy files of an .npz by array name, their checksums compared; raises `ValueError`."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
            if size > MAXIMUM_SIZE:
                raise ValueError(f"it would unpack to {size / 1e9:.3g} GB, expected at most {MAXIMUM_SIZE / 1e9:.3g}")
            return {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
    except _ARCHIVE_ERRORS as error:
        raise ValueError(str(error)) from error


def array(name: str, content: bytes, kinds: str) -> np.ndarray:
    """Return the array of an .npy file whose numbers are of one of `kinds`, or raise `ValueError`."""
    header = _NPY.match(content)
    if header is None:
        raise ValueError(f"{name} is no plain array")
    if header["kind"].decode() not in kinds:
        raise ValueError(f"{name} holds {header['dtype'].decode()!r}, expected numpy kind {kinds!r}")
    shape = tuple(int(size) for size in header["shape"].replace(b",", b" ").split())
    order = "F" if header["fortran"] == b"True" else "C"
    try:
        values = np.ndarray(shape, header["dtype"].decode(), content, header.end(), order=order)
    except (TypeError, OverflowError) as error:
        raise ValueError(f"{name}: {error}") from error
    if values.size > len(content):  # Texts of no letters take no bytes.
        raise ValueError(f"{name} has shape {shape} in {len(content)} bytes")
    if values.dtype.kind == "U":
        values.tobytes().decode("utf-32-le")
    return values
