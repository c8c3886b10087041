"""`motion.npz` of BeyondMimic's whole_body_tracking: joints and bodies in Isaac Lab's order."""

from hoi_retarget.motion.formats import tracking
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import Convention
from hoi_retarget.motion.links import breadth_first
from hoi_retarget.motion.resample import ResampledMotion


def write(motion: ResampledMotion) -> Written:
    """Return one motion in Isaac Lab's order."""
    bodies, joints = breadth_first(motion.model)
    return tracking.write(motion, FORMAT.linear_velocity_of, motion.rate, bodies=bodies, joints=joints)


FORMAT = Format(
    name="beyondmimic",
    convention=Convention("beyondmimic", order="breadth_first"),
    holds=tracking.holds,
    read=tracking.read,
    write=write,
    title="BeyondMimic, whole_body_tracking (Isaac Lab)",
    fps=50.0,
    contacts_inside=True,
    # The file has no names, and how Isaac Lab orders the joints is known for the G1 alone.
    robots=("unitree_g1",),
    linear_velocity_of="centres of mass",
)
