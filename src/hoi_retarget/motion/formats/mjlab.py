"""`motion.npz` of mjlab's tracking task: joints and bodies in MuJoCo's order, link frames."""

from dataclasses import replace

from hoi_retarget.motion.formats import tracking
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import Convention
from hoi_retarget.motion.resample import ResampledMotion


def write(motion: ResampledMotion) -> Written:
    """Return one motion in MuJoCo's order."""
    fps, as_they_are = float(motion.fps), slice(None)
    written = tracking.write(motion, FORMAT.linear_velocity_of, fps, bodies=as_they_are, joints=as_they_are)
    note = "mjlab does not look at the file's rate: it must be that of the environment, 50 in its tasks."
    return replace(written, notes=(note,))


FORMAT = Format(
    name="mjlab",
    convention=Convention("mjlab", order="depth_first"),
    holds=tracking.holds,
    read=tracking.read,
    write=write,
    title="mjlab, tracking task (MuJoCo Warp)",
    fps=50.0,
    contacts_inside=True,
    linear_velocity_of="link origins",
)
