"""Change one place of the core modules at a time and see whether the nearest tests fail.

    python tools/mutate.py --seed 0 --count 80

Places are drawn at random; cosmic-ray's operators change them, in a copy of the sources. A survivor is equivalent to
the original, or a test is missing. A mutant takes as long as its tests, some ten seconds.
"""

import argparse
import ast
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src/hoi_retarget"
CORE = [
    *("numerics/*.py", "retargeting/trajopt/*.py", "retargeting/trajopt/*/*.py", "objects/*.py"),
    *(f"retargeting/{name}.py" for name in ("targets", "feet", "site_pins", "mobile_base_path", "local_resolve")),
    *("retargeting/orientation_flips.py", "human/skeleton.py", "human/person.py", "human/rotation_jumps.py"),
    *(f"clip/{name}.py" for name in ("floor", "infer_contacts", "augment")),
    *("evaluation/*.py", "motion/*.py", "motion/check/*.py", "motion/formats/*.py"),
]
NEAREST = {
    "kernels/shape.py": "skin",
    "numerics/filters.py": "feet",
    "numerics/point_tree.py": "surface_distances",
    "retargeting/trajopt/*.py": "terms solver self_clearance upper_body",
    "retargeting/trajopt/solvers/*.py": "solver",
    "retargeting/trajopt/terms/*.py": "terms solver",
    "retargeting/trajopt/terms/pinned.py": "site_pins",
    "retargeting/targets.py": "site_pins multi_robot",
    "retargeting/mobile_base_path.py": "upper_body",
    "evaluation/*.py": "figures",
    "evaluation/contact_figures.py": "figures",
    "evaluation/hand_slip.py": "contact_figures figures",
    "evaluation/penetration.py": "figures surface_distances",
    "evaluation/physics_figures.py": "figures motion contact_forces",
    "evaluation/figures.py": "thresholds",
    "motion/*.py": "motion",
    "motion/contact_arrays.py": "write_export",
    "motion/performance.py": "motion certificate",
    "motion/result.py": "result_file motion",
    "motion/check/*.py": "finding check_motion",
    "motion/formats/*.py": "formats csv write_export",
    "human/skeleton.py": "person body_model",
    "clip/floor.py": "infer_contacts",
    "objects/track.py": "clip own_layout",
}
"""Names of tests beside `test_<module>.py`, where that exists; the last pattern that fits counts."""
LIMIT_S = 90  # Of processor time, for the tests of one mutant: a busy machine is not a slow test.
OPERATORS = [
    *("AddNot", "NumberReplacer", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ZeroIterationForLoop"),
    *("ReplaceAndWithOr", "ReplaceOrWithAnd", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak"),
    *(f"ReplaceUnaryOperator_{change}" for change in ("USub_UAdd", "Delete_Not", "Delete_Invert")),
    *(f"ReplaceBinaryOperator_{change}" for change in ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Mul")),
    *(f"ReplaceBinaryOperator_{change}" for change in ("Mod_Mul", "Pow_Mul", "BitAnd_BitOr", "BitOr_BitAnd")),
    *(f"ReplaceComparisonOperator_{change}" for change in ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt")),
    *("ReplaceComparisonOperator_Eq_NotEq", "ReplaceComparisonOperator_NotEq_Eq"),
]
"""Plausible slips: others, such as of `+` to `>>`, fail at once."""


def places(module: Path, source: str) -> dict[tuple[Path, int, int], list[tuple[str, int]]]:
    """Return operators with their occurrences by module, line and column; none of annotations and messages."""
    skipped: list[ast.expr | ast.stmt] = []
    for node in ast.walk(ast.parse(source)):
        skipped += [node] if isinstance(node, ast.JoinedStr | ast.Raise | ast.Assert) else []
        skipped += [part for name in ("annotation", "returns") if (part := getattr(node, name, None)) is not None]
        skipped += getattr(node, "decorator_list", ())
    spans = [((part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)) for part in skipped]
    found: dict[tuple[Path, int, int], list[tuple[str, int]]] = {}
    nodes = list(ast_nodes(get_ast(source)))
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        starts = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for occurrence, start in enumerate(starts):
            if not any(first <= start < last for first, last in spans):
                found.setdefault((module, *start), []).append((name, occurrence))
    return found


def limited() -> None:
    """End a process that computes for more than `LIMIT_S` [s]."""
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_S, LIMIT_S))


def outcome(sources: Path, module: Path, code: str) -> str:
    """Return `killed`, `slow` or `survived`, by the nearest tests of a changed module in a copy of the sources."""
    nearest = next((names for pattern, names in reversed(NEAREST.items()) if module.match(pattern)), "")
    paths = [ROOT / f"tests/test_{name}.py" for name in (module.stem, *nearest.split())]
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *filter(Path.exists, paths)]
    environment = {**os.environ, "PYTHONPATH": str(sources), "PYTHONDONTWRITEBYTECODE": "1"}
    (sources / "hoi_retarget" / module).write_text(code)
    try:
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False, preexec_fn=limited)
        return "survived" if done.returncode == 0 else "slow" if done.returncode < 0 else "killed"
    finally:
        shutil.copy(PACKAGE / module, sources / "hoi_retarget" / module)


def main() -> None:
    """Draw places, change each, and print the outcomes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=80)
    parser.add_argument("--only", default="", help="part of the paths of modules")
    options = parser.parse_args()
    found = {}
    for path in (path for pattern in CORE for path in PACKAGE.glob(pattern) if options.only in str(path)):
        found |= places(path.relative_to(PACKAGE), path.read_text())
    rng, outcomes = random.Random(options.seed), []
    drawn = [(place, rng.choice(found[place])) for place in rng.sample(sorted(found), options.count)]
    with tempfile.TemporaryDirectory() as folder:
        sources = Path(shutil.copytree(ROOT / "src", Path(folder) / "src"))
        for (module, line, column), (name, occurrence) in sorted(drawn):
            source = (PACKAGE / module).read_text()
            code = mutate_code(source, get_operator(f"core/{name}")(), occurrence)
            outcomes.append(outcome(sources, module, code))
            changed = next(new for old, new in zip(source.split("\n"), code.split("\n"), strict=False) if old != new)
            print(f"{outcomes[-1]:8} {module}:{line}:{column} {name}: {changed.strip()}", flush=True)
    print(", ".join(f"{outcomes.count(kind)} {kind}" for kind in ("killed", "slow", "survived")))


if __name__ == "__main__":
    main()
