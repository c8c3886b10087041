"""Solves a clip again after its contacts or pins changed, but only around the frames in which they did.

Contacts and pins enter the trajectory's optimization alone: targets of the body and inverse kinematics stay as
they are. The frames around a change are solved again between pinned ones, which takes as long as the
change is, not as the clip is. What comes out is a preview: the whole clip solved at once may differ by
what the optimum gains from moving the pinned frames too, and by where its solve ends: where parts are pinned, by
centimetres.
"""

from dataclasses import replace

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool

from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.retargeting.config import PINNED, Config
from hoi_retarget.retargeting.holds.grasps import with_grasps
from hoi_retarget.retargeting.holds.held_targets import with_holds
from hoi_retarget.retargeting.holds.hold_choice import Hold
from hoi_retarget.retargeting.solve import Solution, on_surfaces, one_thread, solve_trajectory
from hoi_retarget.retargeting.targets import Targets, with_contacts_of, with_pins
from hoi_retarget.retargeting.trajopt.windows import FrameRange

MARGIN_SECONDS = 1.0  # On either side of a change: what an arm needs to get from one place to another.
_WHOLE_CLIP_FACTOR = 4
"""Times as many frames as are around a change: no longer clips are solved whole when pins change."""


def resolve_locally(before: Solution, clip: Clip, config: Config, *, quickly: bool = False) -> Solution:
    """Return the solution for a clip that equals the one before but for its contacts and pins.

    Raises `SolveError` where the frames around a change end without a usable trajectory.

    `before`: of the clip before the change; `clip`: after it; `config`: the configuration of the solution; `quickly`:
    hands go to their holds in one rough pass. Otherwise surfaces touch, and pins that change in a short clip make the
    solution that of `solve`, to the bit.
    """
    model, ik_qpos = before.model, before.stages[0].qpos
    with one_thread():
        unpinned = before.targets.unpinned or before.targets
        targets = with_contacts_of(unpinned, clip, model, person=before.person)
        targets = with_pins(targets, clip, model, ik_qpos, person=before.person)
        holds: tuple[Hold, ...] = ()
        if on_surfaces(targets, config):
            path = before.targets.object_pos, before.targets.object_quat
            targets = replace(targets, object_pos=path[0], object_quat=path[1])  # It may have given way.
            contacts = [track for track in clip.contacts if track.person == before.person]
            targets, holds = with_holds(targets, model, ik_qpos, config.physics, contacts=contacts)
            ik_qpos = with_grasps(model, targets, clip.people[before.person], holds, ik_qpos)
        qpos = before.motion.qpos.copy()
        whole = targets.contact_links != before.targets.contact_links  # A part rests that never did, or no longer.
        pieces = () if whole else pieces_around(changed_frames(before.targets, targets), targets.fps)
        if not whole and not quickly and _pins_changed(before.targets, targets).any():
            whole = len(qpos) <= _WHOLE_CLIP_FACTOR * sum(stop - first for first, stop in pieces)
        if whole or any(stop - first > config.horizon.length for first, stop in pieces):
            qpos = solve_trajectory(model, targets, ik_qpos, config)[0]
        else:
            for first, stop in pieces:
                window = FrameRange.within(first, stop, len(qpos)).alone
                piece, start = targets.window(first, stop), qpos[first:stop]
                qpos[first:stop], _ = solve_trajectory(
                    model,
                    piece,
                    ik_qpos[first:stop],
                    config,
                    windows=(window,),
                    start=start,
                    first_frame=first,
                    roughly=quickly,
                )
        motion = before.motion.with_report(holds=tuple(hold.note(targets) for hold in holds))
        motion = replace(
            motion.with_qpos(qpos),
            contact_links=targets.contact_links,
            contact_flags=targets.contact_flags,
            contact_object=targets.contact_object,
            contact_points=targets.contact_points,
        )
        return Solution.of(clip, before.person, targets, motion, model)


def pieces_around(changed: Bool[np.ndarray, "T"], fps: float) -> tuple[tuple[int, int], ...]:
    """Return the runs of changed frames, each with a margin on either side, as (first, one past the last)."""
    margin = seconds_to_frames(MARGIN_SECONDS, fps) + PINNED
    return runs(scipy.ndimage.binary_dilation(changed, np.ones(2 * margin + 1)))


def changed_frames(before: Targets, after: Targets) -> np.ndarray:
    """Return whether contacts or pins changed in each frame, T booleans."""
    active = (before.contact_weights > 0) | (after.contact_weights > 0)
    moved = (before.carried_contact_points != after.carried_contact_points).any(axis=2)
    moved |= (before.contact_quats != after.contact_quats).any(axis=(1, 2))[:, None]
    exchanged = before.carried_contact_object != after.carried_contact_object
    reweighted = before.contact_weights != after.contact_weights
    turned = before.contact_rotation_weights != after.contact_rotation_weights
    return ((active & (moved | exchanged)) | reweighted | turned).any(axis=1) | _pins_changed(before, after)


def _pins_changed(before: Targets, after: Targets) -> np.ndarray:
    changed = (before.foot_positions != after.foot_positions).any(axis=(1, 2))
    changed |= (before.foot_quats != after.foot_quats).any(axis=(1, 2))
    old, new = ({pin.site: pin for pin in targets.pins} for targets in (before, after))
    for site in old | new:
        one, other = old.get(site), new.get(site)
        if one is None or other is None:
            changed |= (one or new[site]).weights > 0
            continue
        active = (one.weights > 0) | (other.weights > 0)
        moved = (one.positions != other.positions).any(axis=1) | (one.quats != other.quats).any(axis=1)
        changed |= (active & moved) | (one.weights != other.weights) | (one.turn_weights != other.turn_weights)
    return changed
