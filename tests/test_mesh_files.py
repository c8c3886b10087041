"""A mesh written as COLLADA is the same mesh in any other format, whatever its unit, axes, nodes and primitives are."""

import re

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from collada_writer import BOX, SIDES, Written, collada
from hoi_retarget.numerics import se3
from hoi_retarget.robots.adding.description import read_description
from hoi_retarget.robots.adding.mesh_files import read_collada, read_mesh

PRIMITIVES = ("triangles", "polylist", "polygons", "trifans", "tristrips")
MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
lengths = st.floats(-3.0, 3.0)
sizes = st.one_of(st.floats(0.2, 2.0), st.floats(-2.0, -0.2))


@st.composite
def transforms(draw):
    """Return a node's transforms with the matrix that they make."""
    steps, whole = [], np.eye(4)
    for kind in draw(st.lists(st.sampled_from(("translate", "rotate", "scale", "matrix")), max_size=3)):
        step = np.eye(4)
        if kind == "scale":
            values = draw(st.tuples(sizes, sizes, sizes))
            step[:3, :3] = np.diag(values)
        elif kind == "translate":
            values = draw(st.tuples(lengths, lengths, lengths))
            step[:3, 3] = values
        else:
            axis = np.eye(3)[draw(st.integers(0, 2))]
            degrees = draw(st.floats(-180.0, 180.0))
            step[:3, :3] = se3.quat_to_matrix(se3.exp(axis * np.radians(degrees)))
            values = (*2.5 * axis, degrees)
            if kind == "matrix":
                step[:3, 3] = draw(st.tuples(lengths, lengths, lengths))
                values = step.ravel()
        steps.append((kind, values))
        whole = whole @ step
    return steps, whole


@given(
    unit=st.sampled_from((1.0, 0.01, 0.0254)),
    up_axis=st.sampled_from(("X_UP", "Y_UP", "Z_UP")),
    nodes=st.lists(transforms(), min_size=1, max_size=3),
    primitive=st.sampled_from(PRIMITIVES),
)
def test_box_is_the_same_box(unit, up_axis, nodes, primitive):
    """The unit and all nodes count, the up axis does not; faces look outwards even where a node mirrors."""
    place = np.linalg.multi_dot([np.eye(4), np.eye(4), *(whole for _, whole in nodes)])
    (surface,) = read_collada(collada(Written(unit, up_axis, [steps for steps, _ in nodes], primitive))).surfaces
    corners = unit * (BOX @ place[:3, :3].T + place[:3, 3])
    extent = np.ptp(corners, axis=0).max()
    read = trimesh.Trimesh(surface.vertices, surface.faces, process=True)
    read.merge_vertices(digits_vertex=7)
    far = np.linalg.norm(read.vertices[:, None] - corners, axis=2).min(axis=0)
    assert far.max() < 1e-6 * max(extent, np.abs(corners).max())
    assert len(surface.faces) == 12
    assert np.isclose(signed_volume(surface), unit**3 * abs(np.linalg.det(place[:3, :3])), rtol=1e-6)
    assert surface.colour == (0.2, 0.4, 0.6)


def signed_volume(surface):
    """Return the volume of triangles that look outwards; as much less where one looks inwards."""
    one, two, three = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    centre = surface.vertices.mean(axis=0)
    return np.linalg.det(np.stack([one - centre, two - centre, three - centre], axis=1)).sum() / 6


@pytest.fixture
def described(tmp_path):
    """Return what is read of a robot of one box, in a file of some name and content, with colours."""

    def read(name, content, material="", mass_at=(0, 0, 0), scale="0.1 0.2 0.3"):
        (tmp_path / "meshes").mkdir(exist_ok=True)
        (tmp_path / "meshes" / name).write_bytes(content)
        shape = f'<geometry><mesh filename="package://maker/meshes/{name}" scale="{scale}"/></geometry>'
        path = tmp_path / "robot.urdf"
        mass = MASS.replace("<mass", f'<origin xyz="{" ".join(map(str, mass_at))}"/><mass')
        origin = "" if any(mass_at) else '<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>'
        path.write_text(
            f"""<robot name="one"><link name="base">{mass}<visual>{origin}{shape}{material}
            </visual><collision>{shape}</collision></link><link name="arm">{MASS}</link>
            <joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
            <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
        )
        return read_description(path)

    return read


def world(compiled):
    """Return the corners of the first geometry in the world [m], sorted."""
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    corners = compiled.mesh_vert[: compiled.mesh_vertnum[0]] @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    corners = np.unique(corners.round(5), axis=0)
    return corners[np.lexsort(corners.T)]


def test_robot_of_a_box_in_inches_is_that_of_the_box_in_metres(described):
    faces = [corner for a, b, c, d in SIDES for corner in ((a, b, c), (a, c, d))]
    stl = described("box.stl", trimesh.Trimesh(BOX, faces, process=False).export(file_type="stl"))
    dae = described("box.dae", collada(Written(0.0254, "Y_UP", size=1 / 0.0254, primitive="polylist")))
    np.testing.assert_allclose(world(dae.compiled), world(stl.compiled), atol=2e-5)
    assert not dae.findings and not stl.findings


def test_colours_of_a_file_are_seen_before_those_of_the_description(described):
    red = '<material name="red"><color rgba="0.9 0.1 0 1"/></material>'
    own = described("box.dae", collada(Written()), red).compiled.geom_rgba[0]
    pictured = collada(Written(colour='<texture texture="../../../etc/passwd" texcoord="UV"/>'))
    described_one = described("box.dae", pictured, red).compiled.geom_rgba[0]
    np.testing.assert_allclose([own, described_one], [[0.2, 0.4, 0.6, 1], [0.9, 0.1, 0, 1]], atol=1e-6)


def test_parts_of_other_colours_are_shapes_of_their_own(described):
    content = collada(Written(primitive="polylist")).decode()
    end = content.index("</mesh>")
    start = content.index("<polylist")
    plain = content[start:end].replace('material="paint"', 'material="none"')
    compiled = described("box.dae", (content[:end] + plain + content[end:]).encode()).compiled
    assert compiled.ngeom == 4
    np.testing.assert_allclose(compiled.geom_rgba[:2], [[0.2, 0.4, 0.6, 1], [0.5, 0.5, 0.5, 1]], atol=1e-6)
    assert (compiled.mesh_facenum == 12).all()


@pytest.mark.parametrize("applied", [False, True])
def test_other_axis_up_is_applied_where_that_brings_meshes_to_their_masses(described, applied):
    """Most makers place meshes by what rviz shows, without it; some by programs that apply it."""
    content = collada(Written(1.0, "Y_UP", [[("translate", (0.0, 2.0, 0.0))]]))
    centre = (0.5, -0.5, 2.5) if applied else (0.5, 2.5, 0.5)
    description = described("box.dae", content, mass_at=centre, scale="1 1 1")
    np.testing.assert_allclose(description.compiled.geom_pos, [centre, centre], atol=1e-4)
    assert len(description.findings) == applied


def test_ids_may_be_those_of_other_geometries(tmp_path):
    content = collada(Written()).decode()
    start, end = content.index("<geometry "), content.index("</geometry>") + len("</geometry>")
    other = re.sub(r'<geometry id="[^"]*"', '<geometry id="other"', content[start:end])
    other = re.sub(r"(<float_array [^>]*>)[^<]*", r"\1 0 0 0", other)
    assert other != content[start:end]
    meshes = [read_collada(text.encode()) for text in (content, content[:end] + other + content[end:])]
    np.testing.assert_array_equal(*(mesh.surfaces[0].vertices for mesh in meshes))


ENTITIES = (
    b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>'
    b'<COLLADA><asset><unit meter="&b;"/></asset></COLLADA>'
)
DAMAGED = {
    "cut off": (lambda content: content[: len(content) // 2], "no XML"),
    "no XML": (lambda content: b"solid box", "no XML"),
    "entities": (lambda content: ENTITIES, "entities"),
    "other XML": (lambda content: b"<svg/>", "<svg>"),
    "no scene": (lambda content: content.replace(b'id="scene"', b""), "#scene"),
    "number": (lambda content: content.replace(b">0.0 0.0", b">0.0 oops", 1), "oops"),
    "infinite": (lambda content: content.replace(b">0.0 0.0", b">0.0 inf", 1), "no points"),
    "a number less": (lambda content: content.replace(b">0.0 0.0", b">0.0", 1), "reshape"),
    "corner": (lambda content: content.replace(b"0 7", b"0 8"), "8 vertices"),
    "another file": (lambda content: content.replace(b'"#points"', b'"other.dae#points"'), "other.dae#points"),
    "polygons": (lambda content: content.replace(b"<vcount>4", b"<vcount>5"), "corners of its polygons"),
    "empty": (lambda content: content.replace(b"instance_geometry", b"none"), "surface"),
    "unit": (lambda content: content.replace(b'meter="1.0"', b'meter="one"'), "one"),
    "its own node": (
        lambda content: content.replace(b"<node>", b'<node id="own"><instance_node url="#own"/>', 1),
        "nodes",
    ),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_damaged_file_is_one_finding_with_the_reason(described, damage):
    change, says = DAMAGED[damage]
    content = collada(Written(primitive="polylist"))
    assert change(content) != content
    findings = described("box.dae", change(content)).findings
    assert len(findings) == 1 and "box.dae" in findings[0].what
    assert says in findings[0].what, findings[0].what


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n"


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("box.stl", bytes(84), "no surface"),
        ("box.obj", b"# nothing\n", "no surface"),
        ("box.stl", POINTER, "Git LFS pointer"),
        ("box.dae", POINTER, "git lfs pull"),
    ],
)
def test_mesh_without_triangles_is_left_out_and_told(described, name, content, says):
    (finding,) = described(name, content).findings
    assert finding.level == "warn" and name in finding.what and says in finding.what


def test_large_mesh_is_made_coarser_as_a_whole(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=5)
    corners = " ".join(map(str, ball.vertices.ravel()))
    indices = " ".join(f"0 {corner}" for corner in ball.faces.ravel())
    content = collada(Written()).decode()
    content = (
        content[: content.index('<float_array id="numbers"')]
        + (f'<float_array id="numbers">{corners}</float_array>')
        + content[content.index("</float_array>") + len("</float_array>") :]
    )
    content = content[: content.index("<p>")] + f"<p>{indices}</p>" + content[content.index("</p>") + 4 :]
    (tmp_path / "ball.dae").write_text(content)
    ((stl, colour),) = read_mesh(tmp_path / "ball.dae").parts
    assert colour == (0.2, 0.4, 0.6)
    assert 500 < int(np.frombuffer(stl[80:84], dtype="<u4")[0]) <= 2500 < len(ball.faces)
