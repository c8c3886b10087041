"""The moment in which a motion is at its worst."""

from hoi_retarget.motion.motion import Motion
from hoi_retarget.viewers.offscreen.thumbnail import representative_frame


def worst_frame(motion: Motion) -> int:
    """Return the middle of the longest unreached contact or orientation flip, else that of the longest contact."""
    report = motion.report
    found = [*(report.orientation_flips or ()), *(report.unreached_contacts or ())]
    stretches = [(item.first_frame, item.last_frame) for item in found]
    if not stretches:
        return representative_frame(motion)
    return sum(max(stretches, key=lambda segment: segment[1] - segment[0])) // 2
