"""Writes clips in InterCap's own layout, for tests."""

import pickle
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from body_writer import write_npz
from hand_components import add_components
from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics import se3
from mesh_writer import export_mesh
from source_people import body_values, moved, parameters_of

SUBJECT, OBJECT, NAME = "03", "07", "chair"
GENDER = "female"
COMPONENTS = 12
# The makers' floor, from their scripts: a point, and the direction downward there.
POINT = np.array([-0.07362306, 1.06334016, 2.88126607])
DOWN = np.array([-0.02645398, 0.98627183, 0.16299712])


def camera_from_world() -> tuple[np.ndarray, np.ndarray]:
    """The rotation and the position that put a world with z up, its floor at z = 0, in front of the camera."""
    looking = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # (x, y, z) with y down to (x, z, -y).
    tilt = Rotation.align_vectors([[0.0, 0, 1]], [looking @ -DOWN])[0].as_matrix()
    height = (tilt @ looking @ POINT)[2]
    back = (tilt @ looking).T
    return back, back @ [0.0, 0.0, height]


def in_camera(clip: Clip) -> Clip:
    """The clip as the camera sees it."""
    turn, shift = camera_from_world()
    return moved(clip, se3.matrix_to_quat(turn), shift)


def results_of(seen: Clip) -> tuple[dict, dict[str, np.ndarray]]:
    """The dictionary of a recording as the makers' last script saves it, and the arrays of its body model."""
    model = body_values(seen.people[:1], "smplx")
    person, track = parameters_of(seen.people[0], "smplx", model), seen.objects[0]
    hands = add_components(model, person, COMPONENTS)
    results = {
        "camera_rotation": np.eye(3)[None],
        "betas": np.zeros((seen.frames, 10)),
        "global_orient": person["root"],
        "body_pose": person["body"].reshape(1, -1),
        "transl": person["translation"],
        "left_hand_pose": hands["left_hand"],
        "right_hand_pose": hands["right_hand"],
        "expression": np.zeros((seen.frames, 10)),
        "ob_pose": list(se3.log(track.quats)),
        "ob_trans": list(track.positions),
    }
    return results, model


def frames_of(results: dict) -> list[dict]:
    """The same as a list with a dictionary for each frame."""
    count = len(results["transl"])
    rows = {name: np.reshape(values, (count, 1, -1)) for name, values in results.items() if name != "camera_rotation"}
    rows |= {name: rows[name][:, 0] for name in ("ob_pose", "ob_trans")}
    return [{name: values[frame] for name, values in rows.items()} for frame in range(count)]


def write_results(root: Path, results, *, subject: str = SUBJECT, thing: str = OBJECT) -> Path:
    """Write `res.pkl` in its folders."""
    path = root / subject / thing / "Seg_1" / "res.pkl"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(results, protocol=2))
    return path


def write_model(root: Path, model: dict[str, np.ndarray]) -> Path:
    """Write the body model, whose folder is returned."""
    write_npz(root / "models" / f"SMPLX_{GENDER.upper()}.npz", model)
    return root / "models"


def write_saved_mesh(path: Path, seen: Clip) -> None:
    """Write the object's mesh as it lies in the first frame, beside `res.pkl`."""
    track = seen.objects[0]
    points = se3.rotate(track.quats[0], track.geometry.points) + track.positions[0]
    export_mesh(path.parent / "Mesh" / "00000_second_obj.ply", points, track.geometry.faces)


def write_mesh(root: Path, clip: Clip, offset: float = 0.0, kind: str = "obj") -> Path:
    """Write the object's mesh in its own frame; its folder is returned."""
    geometry = clip.objects[0].geometry
    return export_mesh(root / "objs" / f"{OBJECT}.{kind}", geometry.points + offset, geometry.faces).parent
