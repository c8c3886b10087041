"""Makes the built-in clips' files from the scenes of the tests; numbers are stored as float32."""

import sys
import tempfile
from pathlib import Path

import numpy as np

from hoi_retarget.readers.builtin_clips import FOLDER, SCENES
from hoi_retarget.readers.own_layout import write

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from synthetic import make

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        for scene in SCENES:
            path = Path(folder) / f"{scene}.npz"
            write(make(scene), path)
            with np.load(path) as arrays:
                single = {
                    name: array.astype(np.float32) if array.dtype == float and array.ndim else array
                    for name, array in arrays.items()
                }
            np.savez_compressed(FOLDER / path.name, **single)
