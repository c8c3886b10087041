"""Humanoids as MJCF, random in all that makers choose differently, with what is true of them."""

from dataclasses import dataclass, field

import numpy as np

from hoi_retarget.numerics import se3

X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Choices:
    """What a maker decides, beside lengths."""

    seed: int
    root: str = "pelvis"
    """Which link is the root: pelvis or torso."""
    waist: int = 3
    """Joints between them."""
    wrist: int = 3
    """Joints after the elbow."""
    ankle: int = 2
    fingers: int = 0
    spread: bool = False
    """Whether the arms are spread in the zero pose."""
    knee_zero: float = 0.0
    """Flexion at zero [rad]."""
    elbow_zero: float = 0.0
    scrambled: bool = False
    """Whether names tell nothing."""
    yaw: float = 0.0
    """Which way it looks in the zero pose, from x towards y [rad]."""


@dataclass(frozen=True, eq=False)
class Humanoid:
    """A description, and what is true of it; places are in the zero pose, in axes ahead, left, up about the hips."""

    mjcf: str
    joints: dict[str, str]
    """What `left_knee` and the like are called."""
    places: dict[str, np.ndarray]
    held: tuple[str, ...]
    order: tuple[str, ...]
    turn: np.ndarray
    """From those axes to the world's."""


@dataclass
class _Link:
    place: np.ndarray
    parent: "str | None"
    joints: list[tuple[str, np.ndarray, np.ndarray, float, float]] = field(default_factory=list)
    shapes: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)
    mass: float = 1.0


def humanoid(choices: Choices) -> Humanoid:
    """Return a humanoid of random lengths."""
    return _Maker(choices).made()


class _Maker:
    def __init__(self, choices: Choices) -> None:
        self.choices = choices
        self.rng = np.random.default_rng(choices.seed)
        self.names = np.random.default_rng(choices.seed)
        self.links: dict[str, _Link] = {}
        self.frames: dict[str, np.ndarray] = {}
        self.joints: dict[str, str] = {}
        self.places: dict[str, np.ndarray] = {}
        self.held: list[str] = []
        self.turn = se3.quat_to_matrix(se3.exp(np.array([0.0, 0.0, choices.yaw])))

    def made(self) -> Humanoid:
        self.trunk()
        for side, sign in (("left", 1.0), ("right", -1.0)):
            state = self.rng.bit_generator.state
            self.leg(side, sign)
            self.arm(side, sign)
            if side == "left":
                self.rng.bit_generator.state = state  # The right limbs mirror the left ones.
        # In the zero pose, all bodies' axes are somehow.
        self.frames = {name: se3.quat_to_matrix(se3.exp(self.rng.normal(size=3))) for name in self.links}
        order: list[str] = []
        body = self.body(self.choices.root, order)
        text = f'<mujoco><compiler angle="radian"/><worldbody>{body}</worldbody></mujoco>'
        return Humanoid(text, self.joints, self.places, tuple(self.held), tuple(order), self.turn)

    def called(self, name: str) -> str:
        return f"j{self.names.integers(10**9)}" if self.choices.scrambled else f"{name}_joint"

    def hinge(self, link: str, role: str, anchor, axis, low: float, high: float) -> None:  # noqa: PLR0917
        sign = self.rng.choice([-1.0, 1.0])
        low, high = (low, high) if sign > 0 else (-high, -low)
        name = self.called(role)
        self.joints[role] = name
        self.links[link].joints.append((name, np.array(anchor), sign * np.array(axis), low, high))

    def trunk(self) -> None:
        rng, choices = self.rng, self.choices
        self.hip, self.shoulder = rng.uniform(0.07, 0.13), rng.uniform(0.13, 0.22)
        height = rng.uniform(0.32, 0.5)
        waist = np.array([0.0, 0.0, rng.uniform(0.05, 0.1)])
        self.neck = np.array([0.0, 0.0, height])
        pelvis_first = choices.root == "pelvis"
        self.links["pelvis"] = _Link(np.zeros(3), None if pelvis_first else "torso", mass=6.0)
        self.links["torso"] = _Link(waist, "pelvis" if pelvis_first else None, mass=10.0)
        moved = "torso" if pelvis_first else "pelvis"
        # Where there is no waist, the torso is the pelvis' link in all but name.
        for axis in rng.permutation(3)[: choices.waist]:
            self.hinge(moved, f"waist_{axis}", waist, np.eye(3)[axis], -1.0, 1.0)
        self.box("pelvis", np.zeros(3), (0.06, self.hip, 0.05))
        self.box("torso", 0.5 * (waist + self.neck), (0.08, self.shoulder - 0.05, 0.4 * (height - waist[2])))
        self.links["head"] = _Link(self.neck, "torso", mass=1.0)
        self.hinge("head", "neck", self.neck, Z, -1.0, 1.0)
        self.box("head", self.neck + 0.15 * Z, (0.08, 0.06, 0.1))

    def leg(self, side: str, sign: float) -> None:
        rng, choices = self.rng, self.choices
        thigh, shank, sole = rng.uniform(0.2, 0.45), rng.uniform(0.2, 0.45), rng.uniform(0.04, 0.08)
        bent = 0.5 * choices.knee_zero
        hip = np.array([0.0, sign * self.hip, 0.0])
        knee = hip + thigh * np.array([np.sin(bent), 0.0, -np.cos(bent)])
        ankle = knee + shank * np.array([-np.sin(bent), 0.0, -np.cos(bent)])
        self.links[f"{side}_thigh"] = _Link(hip, "pelvis", mass=4.0)
        axes = rng.permutation(3)
        for axis in axes:
            self.hinge(f"{side}_thigh", f"{side}_hip_{axis}", hip, np.eye(3)[axis], -1.5, 1.5)
        self.links[f"{side}_shank"] = _Link(knee, f"{side}_thigh", mass=3.0)
        self.hinge(f"{side}_shank", f"{side}_knee", knee, Y, -choices.knee_zero - 0.1, 2.3 - choices.knee_zero)
        self.links[f"{side}_sole"] = _Link(ankle, f"{side}_shank", mass=1.0)
        for axis in (Y, X)[: choices.ankle]:
            self.hinge(f"{side}_sole", f"{side}_ankle_{axis.argmax()}", ankle, axis, -0.9, 0.9)
        length, width = 0.3 * (thigh + shank), 0.12 * (thigh + shank)
        heel, toe = ankle - np.array([0.3 * length, 0.0, sole]), ankle + np.array([0.7 * length, 0.0, -sole])
        self.box(f"{side}_sole", 0.5 * (heel + toe) + [0, 0, 0.015], (0.5 * length, 0.5 * width, 0.015))
        self.box(f"{side}_thigh", 0.5 * (hip + knee), (0.04, 0.04, 0.3 * thigh))
        self.box(f"{side}_shank", 0.5 * (knee + ankle), (0.04, 0.04, 0.3 * shank))
        self.places |= {f"{side}_hip": hip, f"{side}_knee": knee, f"{side}_foot": ankle}
        self.places |= {f"{side}_heel": heel, f"{side}_toe_end": toe}

    def arm(self, side: str, sign: float) -> None:
        rng, choices = self.rng, self.choices
        upper, fore, hand = rng.uniform(0.18, 0.32), rng.uniform(0.18, 0.3), rng.uniform(0.12, 0.18)
        # Hanging, looking along x; spread, all of it is turned about the shoulder.
        turn = se3.quat_to_matrix(se3.exp(np.array([sign * 0.5 * np.pi * choices.spread, 0.0, 0.0])))
        shoulder = np.array([0.0, sign * self.shoulder, self.neck[2] - 0.03])
        along = turn @ np.array([np.sin(choices.elbow_zero), 0.0, -np.cos(choices.elbow_zero)])
        bend, side_axis = turn @ -Y, np.cross(along, turn @ -Y)
        elbow = shoulder - upper * turn @ Z
        wrist = elbow + fore * along
        self.links[f"{side}_upper"] = _Link(shoulder, "torso", mass=2.0)
        for axis in (*rng.permutation(2), 2):
            self.hinge(f"{side}_upper", f"{side}_shoulder_{axis}", shoulder, turn @ np.eye(3)[axis], -2.2, 2.2)
        self.links[f"{side}_fore"] = _Link(elbow, f"{side}_upper", mass=1.5)
        self.hinge(f"{side}_fore", f"{side}_elbow", elbow, bend, -choices.elbow_zero - 0.05, 2.4 - choices.elbow_zero)
        self.links[f"{side}_hand"] = _Link(wrist, f"{side}_fore", mass=0.5)
        for name, axis in (("roll", along), ("pitch", bend), ("yaw", side_axis))[: choices.wrist]:
            self.hinge(f"{side}_hand", f"{side}_wrist_{name}", wrist, axis, -1.6, 1.6)
        basis = np.stack([along, bend, side_axis], axis=1)
        self.box(f"{side}_hand", wrist + 0.5 * hand * along, (0.5 * hand, 0.012, 0.03), basis)
        self.box(f"{side}_upper", 0.5 * (shoulder + elbow), (0.03, 0.03, 0.3 * upper), turn)
        self.box(f"{side}_fore", 0.5 * (elbow + wrist), (0.3 * fore, 0.03, 0.03), basis)
        for finger in range(choices.fingers):
            knuckle = wrist + hand * along + 0.02 * (finger - 1) * side_axis
            for number in range(2):
                link, parent = f"{side}_digit{finger}_{number}", f"{side}_digit{finger}_{number - 1}"
                self.links[link] = _Link(knuckle, parent if number else f"{side}_hand", mass=0.02)
                self.hinge(link, link, knuckle, bend, 0.0, 1.5)
                self.held.append(self.joints[link])
                self.box(link, knuckle + 0.01 * along, (0.01, 0.005, 0.005), basis)
                knuckle = knuckle + 0.02 * along
        self.places |= {f"{side}_shoulder": shoulder, f"{side}_elbow": elbow, f"{side}_wrist": wrist}

    def box(self, link: str, middle, size, turn=None) -> None:
        self.links[link].shapes.append((np.array(middle), np.array(size), np.eye(3) if turn is None else turn))

    def body(self, name: str, order: list[str]) -> str:
        link, frame = self.links[name], self.turn @ self.frames[name]
        place, outer = self.turn @ link.place, np.eye(3)
        if link.parent is not None:
            outer = self.turn @ self.frames[link.parent]
            place = self.turn @ (link.place - self.links[link.parent].place)

        def inside(vector: np.ndarray) -> str:
            return _words(frame.T @ self.turn @ vector)

        inertia = link.mass * 0.005
        parts = [f'<inertial pos="0 0 0" mass="{link.mass}" diaginertia="{inertia} {inertia} {inertia}"/>']
        parts += ["<freejoint/>"] if link.parent is None else []
        for joint, anchor, axis, low, high in link.joints:
            order.append(joint)
            parts.append(
                f'<joint name="{joint}" pos="{inside(anchor - link.place)}" '
                f'axis="{inside(axis)}" range="{low} {high}"/>'
            )
        for middle, size, turn in link.shapes:
            quat = _words(se3.matrix_to_quat(frame.T @ self.turn @ turn))
            place_of_box = inside(middle - link.place)
            parts.append(f'<geom type="box" size="{_words(size)}" pos="{place_of_box}" quat="{quat}"/>')
        parts += [self.body(child, order) for child, below in self.links.items() if below.parent == name]
        quat = _words(se3.matrix_to_quat(outer.T @ frame))
        label = f"b{list(self.links).index(name)}" if self.choices.scrambled else name
        return f'<body name="{label}" pos="{_words(outer.T @ place)}" quat="{quat}">{"".join(parts)}</body>'


def _words(numbers: np.ndarray) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
