"""Writes pages that play all built-in clips on both robots, and a copy of the editor: `python docs/make_gallery.py`.

`mkdocs build` then has them in the site, in the places of pictures of the viewer, of the editor and of a shared page.
Pictures need EGL (Debian: `apt-get install libegl1 libgl1-mesa-dri`) or a display; without a display, `MUJOCO_GL=egl`.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from hoi_retarget.cli import main
from hoi_retarget.clip.edits import ContactEdits
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.readers.builtin_clips import SCENES, builtin_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.editor.edit_session import EditSession, solved
from hoi_retarget.studio.editor.editor import Editor, SaveTargets

OUT = Path(__file__).parent / "gallery"
ROBOTS = ("unitree_g1", "unitree_h2")
COPY = "This copy of the editor only shows. Where it is installed: hoi-retarget edit builtin:carry_box"


def write(out: Path) -> int:
    """Write the gallery into a folder; return 1 where a motion is missing from it."""
    clips = [f"builtin:{name}" for name in SCENES]
    with TemporaryDirectory() as results:
        failed = [main(["run", *clips, "--robot", robot, "--out", f"{results}/{robot}"]) for robot in ROBOTS]
        failed.append(main(["share", results, "--out", f"{out}/clips", "--title", "The built-in clips on two robots"]))
    (out / "editor.html").write_text(editor_copy("carry_box"), encoding="utf-8")
    return max(failed)


def editor_copy(name: str) -> str:
    """Return the editor's page of a built-in clip, which answers everything by itself."""
    clip, model, config = builtin_clip(name), load_robot(ROBOTS[0]), Config()
    session = EditSession(clip, model, config, solved(clip, model, config, ContactEdits.of(clip)))
    targets = SaveTargets(EditsFiles(Path(f"{name}.edits.toml")), save_result=lambda _: ())
    return Editor(session, model, targets).page(copy=COPY)


if __name__ == "__main__":
    sys.exit(write(Path(sys.argv[1]) if len(sys.argv) > 1 else OUT))
