"""`hoi-retarget demo`: a built-in clip, from nothing to figures."""

import shlex

from hoi_retarget.cli.commands import Demo
from hoi_retarget.cli.figures import show_figures
from hoi_retarget.cli.jobs import check_writable, describe_result, score
from hoi_retarget.cli.terminal import Working, program, say
from hoi_retarget.retargeting.multi_person import retarget_people, write
from hoi_retarget.robots import load_robot
from hoi_retarget.synthetic import make

SCENE = "carry_box"


def execute(command: Demo) -> int:
    """Retarget the built-in clip and say what to try next."""
    model = load_robot(command.robot)
    check_writable("--out", command.out)
    path = command.out / f"{SCENE}.npz"
    clip = make(SCENE)
    say(f"A built-in clip: a person of {clip.people[0].height:.2f} m walks to a box, lifts it, carries it round a")
    say(f"turn and sets it down ({clip.frames} frames). Now the same by a {model.spec.title}:")
    with Working("retargeting", None):
        (motion,) = retarget_people(clip, [model])
        (motion,) = write([motion], [path])
    describe_result(motion, path)
    say()
    show_figures([score(motion, path)])
    say()
    say("The figures are explained in docs/metrics.md. Next:")
    say(f"  {program()} view {shlex.quote(str(path))}   # see it in a browser")
    say(f"  {program()} edit builtin:{SCENE}   # drag its contacts, and see what follows")
    say(f"  {program()} inspect {shlex.quote(str(path))}   # what the file holds")
    say(f"  {program()} sample sample   # two real recordings (downloads 102 MB)")
    say(f"  {program()} run sample/sub3_largebox_003.pt --objects sample/objects --out results")
    return 0
