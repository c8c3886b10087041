"""COLLADA files as other programs write them: any unit, axes, transforms of nodes, kinds of primitives and colours."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Node = Sequence[tuple[str, Sequence[float]]]
"""Names and numbers of a node's transforms, outermost first."""
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
"""Corners of a box."""
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Of the box, each wound outwards."""
STRIPS = ((0, 1, 2, 3), (4, 6, 5, 7), (0, 4, 1, 5), (2, 3, 6, 7), (0, 2, 4, 6), (1, 5, 3, 7))


@dataclass(frozen=True)
class Written:
    """A box in a file."""

    unit: float = 1.0
    up_axis: str = "Z_UP"
    nodes: Sequence[Node] = ((),)
    """One in the other; the box is in the last."""
    primitive: str = "triangles"
    colour: str = "<color>0.2 0.4 0.6 1</color>"
    size: float = 1.0
    """Of the box, in the file's unit."""


def collada(written: Written) -> bytes:
    """Return a file with one box."""
    inner = (
        '<instance_geometry url="#box"><bind_material><technique_common><instance_material symbol="paint" '
        'target="#painted"/></technique_common></bind_material></instance_geometry>'
    )
    for transforms in reversed(written.nodes):
        inner = (
            "<node>" + "".join(f"<{kind}>{_text(values)}</{kind}>" for kind, values in transforms) + inner + "</node>"
        )
    return f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="own" meter="{written.unit!r}"/><up_axis>{written.up_axis}</up_axis></asset>
<library_effects><effect id="effect"><profile_COMMON><technique sid="common"><phong>
<diffuse>{written.colour}</diffuse></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="painted"><instance_effect url="#effect"/></material></library_materials>
<library_geometries><geometry id="box"><mesh>
<source id="points"><float_array id="numbers" count="24">{_text((written.size * BOX).ravel())}</float_array>
<technique_common><accessor source="#numbers" count="8" stride="3"/></technique_common></source>
<source id="normals"><float_array id="more" count="3">0 0 1</float_array>
<technique_common><accessor source="#more" count="1" stride="3"/></technique_common></source>
<vertices id="vertices"><input semantic="POSITION" source="#points"/></vertices>
{_primitive(written.primitive)}</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="scene">{inner}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene></COLLADA>""".encode()


def _primitive(kind: str) -> str:
    inputs = '<input semantic="NORMAL" source="#normals" offset="0"/>'
    inputs += '<input semantic="VERTEX" source="#vertices" offset="1"/>'
    runs: Sequence[Sequence[int]] = STRIPS if kind == "tristrips" else SIDES
    if kind == "triangles":
        runs = [[corner for a, b, c, d in SIDES for corner in (a, b, c, a, c, d)]]
    if kind == "polylist":
        inputs += "<vcount>4 4 4 4 4 4</vcount>"
        runs = [[corner for side in SIDES for corner in side]]
    indices = "".join(f"<p>{' '.join(f'0 {corner}' for corner in run)}</p>" for run in runs)
    return f'<{kind} material="paint" count="6">{inputs}{indices}</{kind}>'


def _text(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
