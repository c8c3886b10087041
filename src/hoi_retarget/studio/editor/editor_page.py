"""The editor's page: the player of shared pages, and a panel beside it."""

import json
from dataclasses import replace
from typing import Any

import numpy as np

from hoi_retarget.retargeting.targets import pinned_sites
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.studio.editor.edit_session import EditState
from hoi_retarget.studio.editor.editor_state import part_name
from hoi_retarget.studio.html import render
from hoi_retarget.studio.scene.camera import fit_camera, fit_each
from hoi_retarget.studio.scene.curves import all_curves, bar_rows, chart_html
from hoi_retarget.studio.scene.scene import SceneItem
from hoi_retarget.studio.scene.subplots import make_subplots, on_one_floor
from hoi_retarget.studio.share.clip_page import CHART_HEIGHT_PX, PLAYER
from hoi_retarget.studio.share.packed_scene import pack

_SCRIPT = (*PLAYER, "studio/editor/page/handles.js", "studio/editor/page/editor.js")
_DIGITS = 5


class EditorScene:
    """Scene and curves of the states of one work, under one camera."""

    def __init__(self, model: RobotModel, first: EditState) -> None:
        self._model = model
        items = self._items(first, first)
        subplots = make_subplots(items)
        self._floor = fit_camera(on_one_floor(subplots), items[0].ahead)
        self._each = fit_each(subplots, self._floor)

    def packed(self, now: EditState, saved: EditState, *, shown_alone: bool = False) -> str:
        """Return the scene of a state with the last saved one as a ghost; `shown_alone` leaves hidden layers empty."""
        subplots = make_subplots(self._items(now, saved))
        if shown_alone:
            subplots = subplots.with_layers(lambda layer: layer if layer.shown else replace(layer, parts=()))
        return pack(subplots, self._floor, self._each)

    def chart(self, now: EditState, saved: EditState, *, compared: bool) -> str:
        """Return the curves of a state as HTML; if `compared`, those of the last saved one, too."""
        shown = list(zip(_titles(now), now.motions, strict=True))
        rows = bar_rows(shown, contacts=False)  # The page has bars of contacts, which can be dragged.
        if compared:  # First, so that today's curves are drawn over them.
            shown = [(f"{title}, before", motion) for title, motion in zip(_titles(now), saved.motions, strict=True)]
            shown += zip(_titles(now), now.motions, strict=True)
        return chart_html(
            [(title, all_curves(motion, self._model, now.clip)) for title, motion in shown],
            now.clip.fps,
            rows=rows,
            chart_height_px=CHART_HEIGHT_PX,
            operable=True,
        )

    def _items(self, now: EditState, saved: EditState) -> list[SceneItem]:
        return [
            SceneItem(title, motion, self._model, now.clip, person, baseline=before)
            for person, (title, motion, before) in enumerate(zip(_titles(now), now.motions, saved.motions, strict=True))
        ]


def _titles(now: EditState) -> list[str]:
    people = now.clip.people
    return [person.name if len(people) > 1 else now.clip.name for person in people]


def editor_page(now: EditState, model: RobotModel, scene: str, chart: str, state: dict[str, Any]) -> str:
    """Return the whole page.

    Args: `now`: the current state; `model`: the robot; `scene`: of `EditorScene.packed`; `chart`: of
    `EditorScene.chart`; `state`: of `state_of`, and what else the page's script is told.
    """
    clip, motion = now.clip, now.motions[0]
    several = len(clip.people) > 1
    fixed = {
        "fps": clip.fps,
        "frames": clip.frames,
        "names": [track.name for track in clip.objects],
        "objects": [
            {
                "scale": float(motion.object_scale[index]),
                "positions": np.round(motion.object_pos[:, index], _DIGITS).tolist(),
                "quats": np.round(motion.object_quat[:, index], _DIGITS + 1).tolist(),
            }
            for index in range(len(clip.objects))
        ],
        **{
            key: [
                {"person": person, "part": part, "name": part_name(person, part, several)}
                for person in range(len(clip.people))
                for part in parts
            ]
            for key, parts in {"touching": model.spec.contact_sites, "pinned": pinned_sites(model)}.items()
        },
    }
    return render(
        "studio/editor/page/editor.html.j2",
        player_files=_SCRIPT,
        panel="studio/editor/page/panel.html.j2",
        title=f"Contacts of {clip.name}",
        scene=scene,
        curves=chart,
        work=json.dumps({"fixed": fixed, "state": state}, allow_nan=False).replace("<", "\\u003c"),
    )
