"""A manufacturer's URDF or MJCF, read as data: its tree, its limits and its meshes, everything else left out.

Nothing in it is executed, and no path in it is followed: meshes are found by name below its own folder.
"""

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

from hoi_retarget.errors import ReadError, RobotError
from hoi_retarget.files.reading import LFS_ADVICE, parse_xml, read_bytes
from hoi_retarget.robots.adding.findings import RobotFinding
from hoi_retarget.robots.adding.mesh_files import SUFFIXES, Colour, Mesh, MeshFolder, joined_stl, mesh_folder, read_mesh
from hoi_retarget.robots.mjcf import quiet
from hoi_retarget.robots.spec import HeldJoint

DEFAULT_SPEED = 20.0  # Of joints of which no file says a speed limit [rad/s].
_LAST_DRAWN = 2  # MuJoCo's viewers draw no later group of shapes unless they are told to.
_MAX_SPEED = 200.0
_FULL_TURN = 6.28  # Of a joint without an end [rad].
_MAX_BYTES = 16 << 20
_MAX_INCLUDES, _MAX_LINKS, _MAX_ELEMENTS = 200, 1_000, 50_000
_COMPILER = {
    "strippath": "false",
    "fusestatic": "false",
    "discardvisual": "false",
    "balanceinertia": "true",
    "boundmass": "1e-6",
    "boundinertia": "1e-9",
    "angle": "radian",
}
_TURNED_DISTANCE = 0.7  # Of meshes that are turned: so much nearer to the centres of mass.
_GREY = "0.5 0.5 0.5 1"
_SETTINGS = ("custom", "visual", "statistic", "size")
_LEFT_OUT = (*_SETTINGS, "keyframe", "sensor", "tendon", "contact", "deformable", "extension")
"""Sections of an MJCF without which the tree is the same."""
_NO_SURFACE = ("hfield", "skin", "texture", "plugin", "flexcomp", "composite", "light", "camera")


@dataclass(frozen=True, eq=False)
class Description:
    """The facts in a file about a robot."""

    path: Path
    sha256: str  # Of the file.
    licence: str  # File name of a licence beside it; empty where there is none.
    compiled: mujoco.MjModel
    speeds: Mapping[str, float]  # Speed limits [rad/s] by joint, where a file has them.
    torques: Mapping[str, float]  # Torque limits [N m] by joint, where the file has them.
    couplings: tuple[HeldJoint, ...]
    passive: tuple[str, ...]  # Joints that the file gives no drive while it gives one to most.
    findings: tuple[RobotFinding, ...]


def read_description(path: Path, meshes: Path | None = None) -> Description:
    """Read a URDF or an MJCF, with its meshes in the same folder or in `meshes`.

    Raises `RobotError` where the file cannot be read, is no description, or cannot be compiled.
    """
    root, content = _parsed(path)
    folder = mesh_folder(path, meshes)
    findings: list[RobotFinding] = []
    if root.tag not in {"robot", "mujoco"}:
        raise RobotError(f"{path}: it is neither a URDF nor an MJCF: its outermost element is <{root.tag}>.")
    if root.tag == "mujoco":
        root = _with_includes(root, path)
    _check_size(path, root)
    speeds: dict[str, float] = {}
    couplings: list[HeldJoint] = []
    torques: dict[str, float] = {}
    passive: tuple[str, ...] = ()
    if root.tag == "robot":
        speeds, couplings, passive = dict(_urdf_speeds(root)), list(_urdf_couplings(root)), _urdf_passive(root)
        findings += _with_limits(root)
        compiled = _compiled_urdf(path, root, folder, findings)
    else:
        assets = _Assets(folder)
        description = _described(path, _with_mjcf_meshes(root, assets), assets)
        findings += assets.findings()
        speeds = _speeds_of_siblings(path, folder)
        couplings += _mjcf_couplings(description, findings)
        torques = _actuator_torques(description)
        compiled = _compiled(path, description, findings)
    torques |= {
        compiled.joint(k).name: float(compiled.jnt_actfrcrange[k, 1])
        for k in range(compiled.njnt)
        if compiled.jnt_actfrclimited[k] and compiled.jnt_actfrcrange[k, 1] > 0
    }
    licence = next(
        (file.name for top in (path.parent, path.parent.parent) for file in sorted(top.glob("LICEN[SC]E*"))), ""
    )
    return Description(
        path,
        hashlib.sha256(content).hexdigest(),
        licence,
        compiled,
        speeds,
        torques,
        tuple(couplings),
        passive,
        tuple(findings),
    )


def _parsed(path: Path) -> tuple[ET.Element, bytes]:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise RobotError(f"{path}: larger than {_MAX_BYTES >> 20} MiB: no description of a robot.")
    except OSError as error:
        raise RobotError(f"{path}: cannot be read ({error.strerror or error}).") from error
    try:
        content = read_bytes(path)
    except ReadError as error:
        raise RobotError(str(error)) from error
    try:
        return parse_xml(content), content
    except ValueError as error:
        raise RobotError(f"{path}: {error}") from error


def _with_includes(root: ET.Element, path: Path) -> ET.Element:
    """Return an MJCF with the contents of the files that it includes, which are in its folder or below.

    As in MuJoCo, an included file's own includes are beside it; or beside the outermost file.
    """
    top = path.resolve().parent
    count = 0

    def whole(tree: ET.Element, own: Path) -> ET.Element:
        nonlocal count
        for parent in [one for one in tree.iter() if one.find("include") is not None]:
            for index, child in reversed(list(enumerate(parent))):
                if child.tag != "include":
                    continue
                places = [(folder / child.get("file", "")).resolve() for folder in (own, top)]
                file = next((place for place in places if place.is_file()), places[0])
                if not file.is_relative_to(top):
                    raise RobotError(f"{path}: it includes {child.get('file', '')!a}, which is not in its folder.")
                count += 1
                if count > _MAX_INCLUDES:
                    raise RobotError(f"{path}: it includes more than {_MAX_INCLUDES} files, or one in itself.")
                parent[index : index + 1] = list(whole(_parsed(file)[0], file.parent))
        return tree

    return whole(root, top)


def _check_size(path: Path, root: ET.Element) -> None:
    """Raise `RobotError` for more links or elements than any robot has, repeated ones counted as often as they are."""
    links = elements = 0
    pending = [(root, 1)]
    while pending:
        element, times = pending.pop()
        if element.tag == "attach":
            raise RobotError(f"{path}: it attaches models of other files, which are not read. Save it as one file.")
        if element.tag == "replicate":
            times *= max(int(_number(element.get("count"), 1.0)), 1)
        elements += times
        links += times if element.tag in {"body", "link"} else 0
        if links > _MAX_LINKS or elements > _MAX_ELEMENTS:
            raise RobotError(f"{path}: it has more than {_MAX_LINKS} links or {_MAX_ELEMENTS} elements: no robot.")
        pending += [(child, times) for child in element]


def _compiled_urdf(path: Path, root: ET.Element, folder: MeshFolder, findings: list[RobotFinding]) -> mujoco.MjModel:
    """Return a URDF with its meshes; where files say that another axis is up, turned if that places them better."""
    assets = _Assets(folder)
    compiled = _compiled(path, _described(path, _with_urdf_meshes(deepcopy(root), assets), assets), findings)
    findings += assets.findings()
    if assets.other_up:
        turned = _Assets(folder, upright=True)
        upright = _compiled(path, _described(path, _with_urdf_meshes(deepcopy(root), turned), turned), [])
        before, after = 1000 * _off_masses(compiled), 1000 * _off_masses(upright)
        if after < _TURNED_DISTANCE * before:
            what = (
                f"turned by the up_axis of the .dae files, which rviz leaves out: centres of links are {after:.0f} mm "
                f"from their centres of mass, {before:.0f} mm otherwise"
            )
            findings.append(RobotFinding("warn", "meshes", what, "--meshes DIR"))
            return upright
    return compiled


def _off_masses(compiled: mujoco.MjModel) -> float:
    """Return the mean distance between the centres of meshes and the centres of mass of their links [m]."""
    meshes = compiled.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    away = compiled.geom_pos[meshes] - compiled.body_ipos[compiled.geom_bodyid[meshes]]
    return float(np.linalg.norm(away, axis=1).mean()) if len(away) else 0.0


def _with_urdf_meshes(root: ET.Element, assets: "_Assets") -> ET.Element:
    colours = {material.get("name"): material.find("color") for material in root.findall("material")}
    for tag in ("transmission", "gazebo", "ros2_control", "mujoco", "material"):
        for element in root.findall(tag):
            root.remove(element)
    if any("${" in value for element in root.iter() for value in element.attrib.values()):
        raise RobotError("it is a xacro file. Expand it first: xacro FILE > robot.urdf")
    for parent in list(root.iter()):
        for child in list(parent):
            # What only other programs read, and couplings, which are known by now.
            if not isinstance(child.tag, str) or child.tag.startswith("{") or child.tag == "mimic":
                parent.remove(child)
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            shape.attrib.pop("name", None)
            _colour(shape, colours)
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            parts = assets.parts_of(mesh.get("filename", ""))
            at = list(link).index(shape)
            link[at : at + 1] = [_part(shape, name, colour) for name, colour in parts]
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", _COMPILER)
    return root


def _part(shape: ET.Element, name: str, colour: Colour | None) -> ET.Element:
    """Return a shape with one part of its mesh, in the mesh's own colour where it has one, as rviz does."""
    part = deepcopy(shape)
    for mesh in part.iter("mesh"):
        mesh.set("filename", name)
    if colour is not None:
        for material in part.iter("color"):
            material.set("rgba", " ".join(map(str, (*colour, 1.0))))
    return part


def _colour(shape: ET.Element, named: Mapping[str | None, ET.Element | None]) -> None:
    """Give a shape the colour of its material: MuJoCo would take one without a colour for the one before it."""
    colour = None
    for material in shape.findall("material"):
        shape.remove(material)
        own = material.find("color")
        colour = named.get(material.get("name")) if own is None else own
    if shape.tag == "visual":
        ET.SubElement(shape, "material", name="").append(ET.Element("color", rgba=_GREY) if colour is None else colour)


def _with_mjcf_meshes(root: ET.Element, assets: "_Assets") -> ET.Element:  # noqa: C901, PLR0912  # one pass over a tree
    for tag in _LEFT_OUT:
        for element in root.findall(tag):
            root.remove(element)
    for parent in list(root.iter()):
        for child in list(parent):
            on_tendon = parent.tag == "actuator" and child.get("joint") is None
            of_others = parent.tag == "asset" and child.tag == "model"
            if child.tag in _NO_SURFACE or on_tendon or of_others:
                parent.remove(child)
            elif child.tag == "material":
                child.attrib.pop("texture", None)
                for layer in child.findall("layer"):
                    child.remove(layer)
    for compiler in root.iter("compiler"):
        for attribute in ("meshdir", "texturedir", "assetdir", "strippath", "discardvisual", "fusestatic"):
            compiler.attrib.pop(attribute, None)
    gone = set()
    for asset in root.iter("asset"):
        for mesh in asset.findall("mesh"):
            file = mesh.get("file")
            if file is None and mesh.get("builtin") is None:
                continue
            file = file or ""
            mesh.set("name", mesh.get("name") or Path(file.replace("\\", "/")).stem)
            parts = assets.parts_of(file)
            if not parts:
                asset.remove(mesh)
                gone.add(mesh.get("name"))
            else:
                mesh.set("file", assets.joined(parts))
                mesh.attrib.pop("content_type", None)
    for parent in list(root.iter()):
        for geom in parent.findall("geom"):
            if geom.get("mesh") in gone:
                parent.remove(geom)
    return root


class _Assets:
    """Contents of mesh files under new names, each file read once."""

    def __init__(self, folder: MeshFolder, *, upright: bool = False) -> None:
        self.folder = folder
        self.upright = upright
        self.other_up = False
        self.contents: dict[str, bytes] = {}
        self._missing: dict[str, None] = {}
        self._unread: dict[str, list[str]] = {}
        """Files by what is wrong with them."""
        self._parts: dict[Path, tuple[tuple[str, Colour | None], ...]] = {}

    def parts_of(self, name: str) -> tuple[tuple[str, Colour | None], ...]:
        """Return the assets that a description's path stands for; none where there is no such file or surface."""
        file = self.folder.find(name)
        if file is None:
            self._missing[name.replace("\\", "/").rsplit("/", 1)[-1]] = None
            return ()
        if file not in self._parts:
            try:
                mesh = read_mesh(file, upright=self.upright)
            except (ValueError, OSError) as error:
                self._unread.setdefault(str(error), []).append(file.name)
                mesh = Mesh((), other_up=False)
            self.other_up |= mesh.other_up
            names = [f"mesh{len(self.contents) + index}.stl" for index in range(len(mesh.parts))]
            self.contents |= {name: content for name, (content, _) in zip(names, mesh.parts, strict=True)}
            self._parts[file] = tuple((name, colour) for name, (_, colour) in zip(names, mesh.parts, strict=True))
        return self._parts[file]

    def joined(self, parts: Sequence[tuple[str, Colour | None]]) -> str:
        """Return the asset of all parts of a file as one, without their colours."""
        first = parts[0][0]
        if len(parts) > 1:
            name = first.replace("mesh", "whole")
            self.contents[name] = joined_stl([self.contents[name] for name, _ in parts])
            return name
        return first

    def findings(self) -> Iterator[RobotFinding]:
        """Yield the findings about missing and unreadable files."""
        for why, names in self._unread.items():
            what = f"{len(names)} cannot be read ({_some(names)}): {why}"
            yield RobotFinding("warn", "meshes", what, "git lfs pull" if why == LFS_ADVICE else "--meshes DIR")
        if not self._missing:
            return
        places = " or ".join(str(top) for top in self.folder.folders)
        endings = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
        what = f"{len(self._missing)} files are not there ({_some(self._missing)}); none is below {places} as {endings}"
        unread = sorted({Path(name).suffix.lower() for name in self._missing} - {*SUFFIXES, ""})
        if unread:
            what += f"; {', '.join(unread)} is not read: convert it, under the same name, with Blender or MeshLab"
        yield RobotFinding("warn", "meshes", what, "--meshes DIR")


def _some(names: Iterable[str]) -> str:
    shown = list(names)
    return ", ".join(shown[:3]) + (", ..." if len(shown) > 3 else "")


def _described(path: Path, root: ET.Element, assets: _Assets) -> mujoco.MjSpec:
    try:
        with quiet():
            description = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"), assets=assets.contents)
    except ValueError as error:
        raise RobotError(f"{path}: MuJoCo cannot read it: {_one_line(error)}") from error
    return description


def _compiled(path: Path, description: mujoco.MjSpec, findings: list[RobotFinding]) -> mujoco.MjModel:
    for kind in ("actuators", "equalities"):
        for element in list(getattr(description, kind)):
            description.delete(element)
    flat = [geom for geom in description.geoms if _is_nothing(geom)]
    for geom in flat:
        description.delete(geom)
    if flat:
        findings.append(RobotFinding("ok", "shapes", f"{len(flat)} without extent are left out"))
    for geom in description.geoms:
        # Visible shapes get a group of their own, and no contacts, which would need hulls. Shapes in groups that
        # viewers do not draw are not visible, whether they collide or not.
        geom.group = 0 if geom.contype or geom.conaffinity or geom.group > _LAST_DRAWN else 1
        geom.contype = geom.conaffinity = 0
    for mesh in description.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    for index, joint in enumerate(description.joints):
        joint.name = joint.name or f"joint{index}"
    for index, body in enumerate(description.bodies):
        body.name = body.name or f"body{index}"
    compiler = description.compiler
    compiler.fusestatic, compiler.discardvisual = False, False
    compiler.balanceinertia, compiler.boundmass, compiler.boundinertia = True, 1e-6, 1e-9
    try:
        with quiet():
            return description.compile()
    except ValueError as error:
        raise RobotError(f"{path}: MuJoCo cannot compile it: {_one_line(error)}") from error


def _is_nothing(geom: mujoco.MjsGeom) -> bool:
    """Return whether a primitive has a size that is zero, negative or no number."""
    kind = mujoco.mjtGeom(geom.type)
    is_long = np.isfinite(geom.fromto[0])
    needed = {mujoco.mjtGeom.mjGEOM_SPHERE: 1, mujoco.mjtGeom.mjGEOM_BOX: 3, mujoco.mjtGeom.mjGEOM_ELLIPSOID: 3}
    needed |= dict.fromkeys((mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER), 1 if is_long else 2)
    return not geom.meshname and kind in needed and not (geom.size[: needed[kind]] > 0.0).all()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


def _urdf_speeds(root: ET.Element) -> Iterator[tuple[str, float]]:
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        speed = _number(None if limit is None else limit.get("velocity"), 0.0)
        if 0.0 < speed < _MAX_SPEED:
            yield joint.get("name", ""), speed


def _with_limits(root: ET.Element) -> Iterator[RobotFinding]:
    """Give a URDF's joints the ranges that it states, and yield findings about joints without one."""
    kept = []
    for joint in root.findall("joint"):
        name, limit = joint.get("name", ""), joint.find("limit")
        texts = [None if limit is None else limit.get(end, "0") for end in ("lower", "upper")]
        lower, upper = (_number(text, math.nan) for text in texts)
        if joint.get("type") == "continuous" and 0.0 < upper - lower < _FULL_TURN:
            joint.set("type", "revolute")
            kept.append(name)
        elif joint.get("type") == "revolute" and not lower < upper:
            what = f"{name} goes from {texts[0]} to {texts[1]} rad: "
            if lower > upper and limit is not None:
                limit.attrib |= {"lower": str(upper), "upper": str(lower)}
                what += "taken the other way round"
            else:
                joint.set("type", "continuous")
                what += "no range; -180 to 180 deg is taken"
            yield RobotFinding("warn", "ranges", what, f"range.{name} = [LOWER, UPPER]")
    if kept:
        what = f"{len(kept)} joints called continuous keep the limits that they state ({_some(kept)})"
        yield RobotFinding("ok", "ranges", what, "range.JOINT = [LOWER, UPPER]")


def _urdf_passive(root: ET.Element) -> tuple[str, ...]:
    """Return the joints whose effort is zero in a file in which that of most others is not."""
    moving = [joint for joint in root.findall("joint") if joint.get("type") in {"revolute", "continuous"}]
    efforts = {
        joint.get("name", ""): _number(limit.get("effort"), 1.0)
        for joint in moving
        if (limit := joint.find("limit")) is not None and joint.find("mimic") is None
    }
    passive = tuple(name for name, effort in efforts.items() if effort == 0.0)
    return passive if 2 * len(passive) < len(efforts) else ()


def _speeds_of_siblings(path: Path, folder: MeshFolder) -> dict[str, float]:
    """Return speed limits that URDFs beside an MJCF have for joints of the same names."""
    speeds: dict[str, float] = {}
    for file in sorted({*path.parent.glob("*.urdf"), *(folder.folders[-1]).glob("*/*.urdf")}):
        try:
            root, _ = _parsed(file)
        except RobotError:
            continue
        speeds = dict(_urdf_speeds(root)) | speeds
    return speeds


def _urdf_couplings(root: ET.Element) -> Iterator[HeldJoint]:
    for joint in root.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            ratio, offset = _number(mimic.get("multiplier"), 1.0), _number(mimic.get("offset"), 0.0)
            yield HeldJoint(joint.get("name", ""), mimic.get("joint", ""), ratio, offset)


def _mjcf_couplings(description: mujoco.MjSpec, findings: list[RobotFinding]) -> Iterator[HeldJoint]:
    loops = 0
    for equality in description.equalities:
        if not equality.active:
            continue
        if equality.type == mujoco.mjtEq.mjEQ_JOINT:
            offset, ratio = float(equality.data[0]), float(equality.data[1])
            yield HeldJoint(equality.name1, equality.name2 or "", ratio if equality.name2 else 0.0, offset)
        else:
            loops += 1
    if loops:
        what = f"{loops} constraints that close loops are left out; joints in such loops move on their own"
        findings.append(RobotFinding("warn", "closed loops", what, 'lock = ["JOINT", ...]'))


def _actuator_torques(description: mujoco.MjSpec) -> dict[str, float]:
    """Return the torque limits of an MJCF's drives [N m] by joint."""
    torques: dict[str, float] = {}
    for actuator in description.actuators:
        ranged = actuator.forcerange if actuator.forcerange[1] > 0 else None
        if ranged is None and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE and actuator.ctrlrange[1] > 0:
            ranged = actuator.ctrlrange * actuator.gainprm[0]
        if ranged is not None and actuator.target:
            torques[actuator.target] = abs(float(ranged[1] * (actuator.gear[0] or 1.0)))
    return torques


def _number(text: str | None, otherwise: float) -> float:
    try:
        value = float(text) if text is not None else otherwise
    except ValueError:
        return otherwise
    return value if math.isfinite(value) else otherwise


def with_ranges(description: Description, ranges: Mapping[str, tuple[float, float]]) -> Description:
    """Return a description with other ranges [rad] of some joints."""
    if not ranges:
        return description
    compiled = copy(description.compiled)
    for name, ends in ranges.items():
        joint = compiled.joint(name)
        joint.limited, joint.range = True, ends
    stated = tuple(f"range.{name} = " for name in ranges)
    findings = tuple(finding for finding in description.findings if not finding.hint.startswith(stated))
    return replace(description, compiled=compiled, findings=findings)


def finite_range(compiled: mujoco.MjModel, joint: int) -> tuple[float, float] | None:
    """Return a joint's range [rad]; None where it has none."""
    lower, upper = compiled.jnt_range[joint].tolist()
    limited = bool(compiled.jnt_limited[joint]) and np.isfinite([lower, upper]).all() and upper - lower > 1e-6
    return (lower, upper) if limited else None
