"""A tiny body of our own, written in the layouts that body models are given away in."""

import io
import pickle
import sys
import types
from pathlib import Path

import numpy as np
from scipy.sparse import csc_matrix

from hoi_retarget.human.body_model import JOINT_COUNT, Family
from hoi_retarget.human.skeleton import JOINTS, PARENT

FACE = ("jaw", "left_eye", "right_eye")
CORNERS = 4  # Vertices around each joint.


def names_of(family: Family) -> tuple[str, ...]:
    return (*JOINTS[:22], *FACE, *JOINTS[22:]) if family == "smplx" else JOINTS


def tiny_model(
    family: Family, *, shapes: int = 20, components: int = 45, seed: int = 0, middles: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """The arrays of a body with four vertices, a tetrahedron, around each joint, which alone moves them."""
    rng = np.random.default_rng(seed)
    names = names_of(family)
    parents = [names.index(PARENT.get(name, "head")) if name != "pelvis" else -1 for name in names]
    middles = rng.normal(size=(len(names), 3)) if middles is None else middles
    tetrahedron = 0.05 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
    template = (middles[:, None] + tetrahedron).reshape(-1, 3)
    regressor = np.kron(np.eye(len(names)), np.full((1, CORNERS), 1 / CORNERS))
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    table = np.array([parents, range(len(names))]).astype(np.uint32)  # The root is written as 2^32 - 1.
    values = {
        "v_template": template,
        "shapedirs": 0.01 * rng.normal(size=(len(template), 3, shapes)),
        "posedirs": 0.01 * rng.normal(size=(len(template), 3, 9 * (JOINT_COUNT[family] - 1))),
        "J_regressor": regressor,
        "weights": regressor.T * CORNERS,
        "kintree_table": table,
        "f": np.concatenate([faces + CORNERS * joint for joint in range(len(names))]).astype(np.uint32),
    }
    for side in "lr":
        values[f"hands_components{side}"] = np.linalg.qr(rng.normal(size=(45, 45)))[0][:components]
        values[f"hands_mean{side}"] = 0.2 * rng.normal(size=45)
    return values


def write_npz(path: Path, values: dict[str, np.ndarray]) -> Path:
    """Makers' archives also hold arrays of objects, which nothing here may unpickle."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, joint2num=np.array({"pelvis": 0}, dtype=object), **values)
    return path


class _ChumpyPickler(pickle._Pickler):  # pyright: ignore  # only the one in Python lets strings be written as Python 2 did
    """Writes bytes as Python 2's strings."""

    def save_bytes(self, value: bytes) -> None:
        self.write(b"T" + len(value).to_bytes(4, "little") + value)
        self.memoize(value)

    def save_text(self, value: str) -> None:
        raw = value.encode()
        self.write(b"U" + bytes([len(raw)]) + raw)
        self.memoize(value)

    dispatch = {**pickle._Pickler.dispatch, bytes: save_bytes, str: save_text}  # noqa: RUF012  # pyright: ignore


def write_pickle(path, values, *, sparse=True, chumpy=True, regressor=None) -> Path:
    """Write as Python 2 with chumpy and scipy does: protocol 2, bytes as strings, arrays wrapped."""
    modules = {name: types.ModuleType(name) for name in ("chumpy", "chumpy.ch", "chumpy.reordering")}
    kind = type("Ch", (), {"__module__": "chumpy.ch"})
    selection = type("Select", (), {"__module__": "chumpy.reordering"})
    vars(modules["chumpy.ch"])["Ch"], vars(modules["chumpy.reordering"])["Select"] = kind, selection
    content = dict(values)
    if chumpy:
        for name in ("shapedirs", "posedirs", "weights"):
            wrapped = kind()
            vars(wrapped).update(x=values[name], label="a name", is_valid=True)
            content[name] = wrapped
        whole, first = kind(), selection()
        vars(whole).update(x=np.concatenate([values["v_template"], np.ones((2, 3))]))
        vars(first).update(
            a=whole, idxs=np.arange(values["v_template"].size), preferred_shape=values["v_template"].shape
        )
        content["v_template"] = first
    if sparse:
        content["J_regressor"] = csc_matrix(values["J_regressor"]) if regressor is None else regressor
    content |= {"bs_style": "lbs", "joint_names": np.array(["pelvis", None], dtype=object)}
    saved = {name: sys.modules.get(name) for name in modules}
    sys.modules |= modules
    try:
        buffer = io.BytesIO()
        _ChumpyPickler(buffer, protocol=2).dump(content)
    finally:
        for name, before in saved.items():
            sys.modules.pop(name) if before is None else sys.modules.update({name: before})
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(buffer.getvalue())
    return path
