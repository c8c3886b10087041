"""Reads body models, SMPL-X and SMPL-H, from the files their makers give: `.npz`, or `.pkl` without executing it.

Both layouts hold the same names. Older pickles wrap arrays in chumpy's objects and the regressor in a sparse matrix
of scipy; only their numbers are taken.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import cast, get_args

import numpy as np

from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.body_pickle import read_body_pickle
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.human.body_model import JOINT_COUNT, BodyModel, Family, Gender

_EXPRESSIONS = 400
"""Shape components of an SMPL-X file with expressions: 300 of shape, then 100 of the face."""
_SHAPES_WITH_EXPRESSIONS = 300
_REDUCED = {20: 10}
"""Shape components of older SMPL-X files, with as many of shape as of the face."""
_NAMES = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
_HANDS = ("hands_componentsl", "hands_componentsr", "hands_meanl", "hands_meanr")
_HAND_NUMBERS = 45
_NO_PARENT = 1 << 31  # Roots are written as the largest unsigned number, or as -1.


def load_body_model(path: Path, gender: str, family: str) -> BodyModel:
    """Return the body model in a file, or in a folder by the names its makers give.

    In a folder `SMPLX_MALE.npz`, `SMPLX_male.npz` and `male/model.npz` are tried, there and in `smplx` and `SMPLX`,
    with either ending.

    Raises:
        ArgumentError: an unknown gender or family.
        ReadError: there is no such file, it is damaged, or it holds another family.
    """
    for value, known, what in ((gender, get_args(Gender), "gender"), (family, get_args(Family), "family")):
        if value not in known:
            raise ArgumentError(f"There is no {what} {value!r} of a body model. There are: {', '.join(known)}.")
    gender, family = cast(Gender, gender), cast(Family, family)
    file = _file_in(path, gender, family) if path.is_dir() else path
    values = _values(file)
    missing = [name for name in _NAMES if name not in values]
    if missing:
        raise ReadError(
            f"{file}: no body model: it lacks {', '.join(missing)}. It holds: {', '.join(sorted(values)[:12])}. "
            "Download the model again from its makers."
        )
    try:
        return _model(values, gender, family)
    except (ReadError, ValueError, TypeError) as error:
        raise ReadError(f"{file}: {error}") from error


def _file_in(folder: Path, gender: Gender, family: Family) -> Path:
    names = [
        f"{start}{name}{ending}"
        for start in ("", f"{family}/", f"{family.upper()}/")
        for name in (f"{family.upper()}_{gender.upper()}", f"{family.upper()}_{gender}", f"{gender}/model")
        for ending in (".npz", ".pkl")
    ]
    found = [folder / name for name in names if (folder / name).is_file()]
    if not found:
        raise ReadError(
            f"{folder}: there is no {gender} {family} model in this folder, looked for {names[0]}, {names[1]} and the "
            f"like. It holds: {', '.join(sorted(item.name for item in folder.iterdir())[:12]) or 'nothing'}. "
            "Download the model from its makers, whose terms forbid to ship it here."
        )
    return found[0]


def _values(path: Path) -> Mapping[str, np.ndarray | None]:
    content, wanted = read_bytes(path), (*_NAMES, *_HANDS)
    if content[:1] == b"\x80":
        return read_body_pickle(path, content, wanted)
    try:
        members = npz.members(content)
        # The files hold more, some of it pickled, that no body needs.
        return {name: npz.array(name, members[name], "fiu") if name in wanted else None for name in members}
    except ValueError as error:
        raise ReadError(f"{path}: no readable .npz and no pickle ({error}). Download it again.") from error


def _model(values: Mapping[str, np.ndarray | None], gender: Gender, family: Family) -> BodyModel:
    weights, template = _array(values, "weights"), _array(values, "v_template")
    joints = weights.shape[-1] if weights.ndim else 0
    if joints != JOINT_COUNT[family]:
        other = next((name for name, count in JOINT_COUNT.items() if count == joints), "another kind of body")
        raise ReadError(
            f"the model has {joints} joints, as {other} has; {family} has {JOINT_COUNT[family]}. Name the family that "
            "the poses were fitted with, or give that family's file."
        )
    if template.ndim != 2:
        raise ReadError(f"v_template has shape {template.shape}, expected (V, 3). Download the model again.")
    pose = _array(values, "posedirs")
    # Some files hold the blend shapes flat, a row for each entry of the rotations.
    if pose.ndim == 2:
        pose = pose.T.reshape(len(template), 3, -1)
    table = _array(values, "kintree_table")
    if table.shape != (2, joints):
        raise ReadError(f"kintree_table has shape {table.shape}, expected (2, {joints}). Download the model again.")
    parents = table[0].astype(np.int64)
    hands = {name: _array(values, name) for name in _HANDS if name in values}
    return BodyModel(
        family=family,
        gender=gender,
        template=template,
        shape_directions=_shapes_only(_array(values, "shapedirs"), family),
        pose_directions=pose,
        regressor=_array(values, "J_regressor"),
        weights=weights,
        parents=np.where((parents < 0) | (parents >= _NO_PARENT), -1, parents),
        faces=_array(values, "f").astype(np.int64),
        left_components=hands.get("hands_componentsl", np.zeros((0, _HAND_NUMBERS))),
        right_components=hands.get("hands_componentsr", np.zeros((0, _HAND_NUMBERS))),
        left_mean=hands.get("hands_meanl", np.zeros(_HAND_NUMBERS)).reshape(-1),
        right_mean=hands.get("hands_meanr", np.zeros(_HAND_NUMBERS)).reshape(-1),
    )


def _array(values: Mapping[str, np.ndarray | None], name: str) -> np.ndarray:
    value = values[name]
    if value is None or value.dtype.kind not in "fiu":
        raise ReadError(f"{name} is no array of numbers. Download the model again.")
    return value


def _shapes_only(directions: np.ndarray, family: Family) -> np.ndarray:
    """Return the components of shape, without those of the face, which SMPL-X keeps behind them."""
    if directions.ndim != 3 or family != "smplx":
        return directions
    count = directions.shape[-1]
    if count == _EXPRESSIONS:
        return directions[..., :_SHAPES_WITH_EXPRESSIONS]
    return directions[..., : _REDUCED.get(count, count)]
