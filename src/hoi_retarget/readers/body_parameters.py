"""People from parameters of SMPL-X or SMPL-H, and the body models, from their publishers' files.

Models are `.npz`, or `.pkl` without executing it, with the same names in both. Older pickles wrap arrays in chumpy's
objects and the regressor in a sparse matrix of scipy; only numbers are taken. Fits to images store betas for every
frame, which differ a little between frames.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.human.body_model import JOINT_COUNT, BodyModel, BodyShape, Family, Gender
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, PARENT
from hoi_retarget.readers.fields import Fields

_SHAPES = {400: 300, 20: 10}
"""All shape components of an SMPL-X file, or of an older one -> those of shape, before those of the face."""
_NAMES = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
_NO_COMPONENTS, _FLAT = np.zeros((0, 45)), np.zeros(45)
_HANDS = {
    "hands_componentsl": _NO_COMPONENTS,
    "hands_componentsr": _NO_COMPONENTS,
    "hands_meanl": _FLAT,
    "hands_meanr": _FLAT,
}
"""Name -> array of models without hands."""
_NO_PARENT = 1 << 31  # Roots are written as the largest unsigned number, or as -1.


def load_body_model(path: Path, gender: str, family: str) -> BodyModel:
    """Return the body model in a file, or in a folder by the names its makers give.

    In a folder `SMPLX_MALE.npz`, `SMPLX_male.npz` and `male/model.npz` are tried, there and in `smplx` and `SMPLX`,
    with either ending. Raises `ArgumentError` for an unknown gender or family, `ReadError` where there is no such file,
    or it is damaged, or of another family.
    """
    for value, known, kind in ((gender, get_args(Gender), "gender"), (family, get_args(Family), "family")):
        if value not in known:
            raise ArgumentError(f"There is no {kind} {value!r} of a body model. There are: {', '.join(known)}.")
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
        return _body_model(values, gender, family)
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
    content, names = read_bytes(path), (*_NAMES, *_HANDS)
    if content[:1] == b"\x80":
        from hoi_retarget.files.body_pickle import read_body_pickle  # noqa: PLC0415  # few models are pickles

        return read_body_pickle(path, content, names)
    try:
        members = npz.Members(content)
        # The files hold more, some of it pickled, that no body needs.
        return {name: npz.array(name, members[name], "fiu") if name in names else None for name in members}
    except ValueError as error:
        raise ReadError(f"{path}: no readable .npz and no pickle ({error}). Download it again.") from error


def _body_model(values: Mapping[str, np.ndarray | None], gender: Gender, family: Family) -> BodyModel:
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
    hands = {name: _array(values, name) if name in values else absent for name, absent in _HANDS.items()}
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
        left_components=hands["hands_componentsl"],
        right_components=hands["hands_componentsr"],
        left_mean=hands["hands_meanl"].reshape(-1),
        right_mean=hands["hands_meanr"].reshape(-1),
    )


def _array(values: Mapping[str, np.ndarray | None], name: str) -> np.ndarray:
    value = values[name]
    if value is None or value.dtype.kind not in "fiu":
        raise ReadError(f"{name} is no array of numbers. Download the model again.")
    return value


def _shapes_only(directions: np.ndarray, family: Family) -> np.ndarray:
    """Return the components of shape, without those of the face, which SMPL-X has behind them."""
    if directions.ndim != 3 or family != "smplx":
        return directions
    count = directions.shape[-1]
    return directions[..., : _SHAPES.get(count, count)]


MAX_BETA_CHANGE = 1e-3  # Of betas between frames that are meant to be one body's.
MAX_BONE_GROWTH = 0.05
"""Part of their mean length by which all bones together may be longer or shorter in a frame of one person."""
_CHILDREN = [JOINT_INDEX[joint] for joint, parent in PARENT.items() if parent is not None]
_PARENTS = [JOINT_INDEX[parent] for parent in PARENT.values() if parent is not None]
_BODY = 66  # Numbers of the pose of the body, before those of the hands.
FLAT_HANDS = "The recording has no hand poses; the hands are flat."
TITLES: Mapping[Family, str] = {"smplx": "SMPL-X", "smplh": "SMPL-H"}


@dataclass(frozen=True, eq=False)
class BodyParameters:
    """Shape and pose of one person over time; rotations are rotation vectors [rad]."""

    family: Family
    gender: str
    betas: Float[np.ndarray, "*T b"]  # Of one body, or as they were fitted in each frame.
    translation: Float[np.ndarray, "T 3"]  # [m]
    body: Float[np.ndarray, "T 66"]  # The 22 joints of the body, pelvis first.
    left_hand: Float[np.ndarray, "T L"]  # 45 numbers of 15 joints, or weights of principal components.
    right_hand: Float[np.ndarray, "T L"]
    flat_hands: bool  # Whether hands are counted from flat ones; otherwise from the model's mean hand.
    template: Float[np.ndarray, "V 3"] | None = None  # The person's own body at rest [m], in the place of the model's.

    @classmethod
    def of_rows(cls, pose: Float[np.ndarray, "T n"], **others: Any) -> "BodyParameters":
        """Return parameters from poses in one row for each frame: body, left hand, right hand."""
        hand = _BODY + (pose.shape[1] - _BODY) // 2
        return cls(body=pose[:, :_BODY], left_hand=pose[:, _BODY:hand], right_hand=pose[:, hand:], **others)

    @classmethod
    def of_fields(cls, fields: Fields, frames: int, *, hand: int, **others: Any) -> "BodyParameters":
        """Return parameters of SMPL-X from poses under SMPL-X's own names; raises `ClipError`.

        Each hand's pose has `hand` numbers; `others` are the fields that are not of the pose.
        """
        root = fields.rows("global_orient", frames, 3, "the pelvis's rotation")
        body = fields.rows("body_pose", frames, _BODY - 3, "the body's pose")
        return cls(
            family="smplx",
            translation=fields.rows("transl", frames, 3, "the body's position"),
            body=np.concatenate([root, body], axis=1),
            left_hand=fields.rows("left_hand_pose", frames, hand, "the left hand's pose"),
            right_hand=fields.rows("right_hand_pose", frames, hand, "the right hand's pose"),
            **others,
        )

    def at(self, frames: slice | Int[np.ndarray, "F"]) -> "BodyParameters":
        """Return the parameters in some of the frames."""
        varying = ("translation", "body", "left_hand", "right_hand", *(("betas",) if self.betas.ndim > 1 else ()))
        return replace(self, **{name: getattr(self, name)[frames] for name in varying})


def person_of(path: Path, name: str, parameters: BodyParameters, body_models: Path | None) -> Person:
    """Return a person from a body's shape and pose; `path` is the recording, for errors.

    Raises `BodyModelError`: there is no folder; `ReadError`: the model is not there, damaged, or of another family;
    `ClipError`: the parameters are not those of this model.
    """
    model = _model(path, parameters, body_models)
    hands = (parameters.left_hand, parameters.right_hand)
    try:
        pose = model.pose(parameters.body, *hands, flat_hands=parameters.flat_hands)
        positions, quats = model.joints(parameters.betas, pose, parameters.translation)
    except ArgumentError as error:
        raise ClipError(f"{path}: person {name!r}: {error}") from error
    shape = BodyShape(model, parameters.betas)
    return Person(name, positions[:, model.skeleton_joints], quats[:, model.skeleton_joints], shape=shape)


def person_from_smplx(
    values: Mapping[str, Any], models: Path | str, *, gender: str = "neutral", flat_hands: bool = True
) -> Person:
    """Return a person from arrays under SMPL-X's own names, in a world with z up; raises as `person_of`.

    `transl` (T, 3) [m], `betas` (b,), and [rad] `global_orient` (T, 3), `body_pose` (T, 63), `left_hand_pose` and
    `right_hand_pose` (T, 45). Hands that are missing are flat; those there are count from flat hands or, with
    `flat_hands=False`, from the model's mean hand. `models` is the file or the folder of the body model.
    """
    absent = {"left_hand_pose", "right_hand_pose"} - values.keys()
    flat = dict.fromkeys(absent, np.zeros((len(values.get("transl", ())), 45)))
    fields = Fields(Path("parameters"), {**flat, **{key: np.asarray(value) for key, value in values.items()}})
    frames = len(fields.array("transl", ("T", 3), "the body's position"))
    others = {"gender": gender, "betas": fields.array("betas", ("b",), "the body's shape"), "flat_hands": flat_hands}
    parameters = BodyParameters.of_fields(fields, frames, hand=45, **others)
    return replace(person_of(fields.path, "person", parameters, Path(models)), fingers_recorded=not absent)


def person_of_rows(
    path: Path, name: str, parameters: BodyParameters, body_models: Path | None
) -> tuple[Person, tuple[str, ...]]:
    """Return a person from betas of one body or of each frame, and notes of them.

    Rotations do not depend on the shape, and positions depend on it linearly: one body for each component that
    changes is enough.

    Args: as `person_of`, and so are the errors; `ClipError` is also raised for bodies of several sizes.
    """
    rows = np.atleast_2d(parameters.betas)
    change = np.ptp(rows, axis=0)
    if change.max(initial=0.0) <= MAX_BETA_CHANGE:
        return person_of(path, name, replace(parameters, betas=rows[0]), body_models), ()
    mean = rows.mean(axis=0)
    person = person_of(path, name, replace(parameters, betas=mean), body_models)
    positions = person.joint_positions.copy()
    for component in np.flatnonzero(change):
        unit = (np.arange(len(mean)) == component).astype(float)
        other = person_of(path, name, replace(parameters, betas=mean + unit), body_models)
        weights = (rows[:, component] - mean[component])[:, None, None]
        positions += weights * (other.joint_positions - person.joint_positions)
    lengths = np.linalg.norm(positions[:, _CHILDREN] - positions[:, _PARENTS], axis=-1).sum(axis=1)
    growth = float(np.abs(lengths / lengths.mean() - 1.0).max())
    if growth > MAX_BONE_GROWTH:
        raise ClipError(
            f"{path}: the betas change by {change.max():.3g} over the recording, which makes bones up to {growth:.0%} "
            "longer or shorter than they are on average. Are these frames of several people?"
        )
    note = (
        f"The betas change by up to {change.max():.2g} over the recording, as they were fitted frame by frame: bones "
        f"are up to {growth:.1%} longer or shorter than on average."
    )
    return replace(person, joint_positions=positions), (note,)


def constant_betas(path: Path, rows: Float[np.ndarray, "T b"]) -> Float[np.ndarray, "b"]:
    """Return the betas [unitless] of a body that are stored for every frame; raises `ClipError` where they change."""
    change = float(np.ptp(rows, axis=0).max(initial=0.0))
    if change > MAX_BETA_CHANGE:
        raise ClipError(
            f"{path}: the betas change by {change:.3g} over the recording, expected those of one body. "
            "Are these frames of several people?"
        )
    return rows[0]


def _model(path: Path, parameters: BodyParameters, folder: Path | None) -> BodyModel:
    what = f"the {parameters.gender} {TITLES[parameters.family]} body model"
    if folder is None:
        raise BodyModelError(
            f"{path}: the recording holds parameters of {what}, not joints. Download it from its makers, whose terms "
            "forbid to ship it here, and pass --body-models DIR."
        )
    if not folder.exists():
        raise BodyModelError(f"--body-models {folder}: there is no such folder. {path} needs {what}.")
    try:
        model = _loaded(folder, parameters.gender, parameters.family)
    except ArgumentError as error:
        raise ClipError(f"{path}: {error}") from error
    if parameters.template is None:
        return model
    if parameters.template.shape != model.template.shape:
        raise ClipError(
            f"{path}: the person's own body has {len(parameters.template)} vertices, {what} {len(model.template)}. "
            "Use the model that it was made with."
        )
    return replace(model, template=parameters.template)


@lru_cache(maxsize=8)
def _loaded(folder: Path, gender: str, family: str) -> BodyModel:
    return load_body_model(folder, gender, family)
