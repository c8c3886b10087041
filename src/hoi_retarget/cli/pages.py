"""Pages: `view` and `edit` serve them until the user ends it, `share` writes a folder of them."""

import os
import shlex
import sys
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from functools import partial
from getpass import getuser
from pathlib import Path
from threading import Event

from hoi_retarget.cli.commands import Edit, RecordingOptions, Run, Share, SolveOptions, View
from hoi_retarget.cli.open_results import clip_or_warning, gallery_entry_of, load_motion
from hoi_retarget.cli.output_checks import check_writable
from hoi_retarget.cli.run import check_clip_kept
from hoi_retarget.cli.run_options import arguments_of, config_of, to_argv
from hoi_retarget.cli.scores import score
from hoi_retarget.cli.terminal import Working, fail, program, say, warn, with_file
from hoi_retarget.clip.edits import ContactEdits, load
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.errors import HoiRetargetError, WriteError
from hoi_retarget.evaluation.thresholds import known_figures
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import clip_of, open_clip, result_stem
from hoi_retarget.retargeting.retarget import result_paths, write
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.editor.edit_session import EditSession, EditState, solved
from hoi_retarget.studio.editor.editor import Editor, SaveTargets
from hoi_retarget.studio.report.discover import files_of
from hoi_retarget.studio.scene.scene import SceneItem, group_people, shared_objects
from hoi_retarget.studio.scene.subplots import names_together, title_together, titles_of
from hoi_retarget.studio.share.clip_page import Detail, make_clip_page, notices_page
from hoi_retarget.studio.share.gallery import GalleryEntry
from hoi_retarget.studio.share.load_results import load_results
from hoi_retarget.studio.share.page_server import OnePageServer
from hoi_retarget.studio.share.share import check_replaceable, gallery_in

_DETAIL = Detail(frames=20_000, points=3000)


def execute_view(command: View) -> int:
    """Serve the viewer until Ctrl-C; return 1 when no result can be read."""
    with serve(command) as server:
        if server is None:
            return 1
        _wait_for_interrupt(server.address, server.port)
    return 0


@contextmanager
def serve(command: View) -> Iterator[OnePageServer | None]:
    """Serve the page of results while the block runs; None where no result can be read."""
    page = _ResultsPage(command)
    if not page.results:
        yield None
        return
    server = OnePageServer(page.current, host=command.host, port=command.port)
    try:
        yield server
    finally:
        server.stop()


class _ResultsPage:
    """The page of results, made anew where their files changed; each notice is printed once."""

    def __init__(self, command: View) -> None:
        self._command = command
        self._printed: set[str] = set()
        self._make()

    def current(self) -> str:
        """Return the page of the files as they are now."""
        if self._file_states() != self._states:
            self._make()
        return self._text

    def _make(self) -> None:
        command, notices = self._command, list[str]()
        self._states = self._file_states()
        self.results = load_results(
            command.results,
            notices.append,
            find_clip=partial(clip_of, name=command.clip, objects=command.objects),
            load_motion=partial(load_motion, robot=command.robot, warn=self._notify),
        )
        for notice in notices:
            self._notify(notice, warn if self.results else fail)
        if not self.results:
            self._text = notices_page(notices)
            return
        results = []
        for path, motion, shown in self.results:
            assert shown.model is not None, "results have their robots"
            results.append((gallery_entry_of(motion, shown.model, known_figures(motion, path)), shown))
        title = ", ".join(dict.fromkeys(path.stem for path, _, _ in self.results))
        self._text = make_clip_page(title, results, notices=notices, detail=_DETAIL).text

    def _notify(self, notice: str, say: Callable[[str], None] = warn) -> None:
        if notice not in self._printed:
            self._printed.add(notice)
            say(notice)

    def _file_states(self) -> list[tuple[int, int] | None]:
        """Return time of change [ns] and size of each file, by which a change is seen; None where one is not there."""
        states: list[tuple[int, int] | None] = []
        for path in self._command.results:
            try:
                status = path.stat()
            except (OSError, ValueError):
                states.append(None)
            else:
                states.append((status.st_mtime_ns, status.st_size))
        return states


def execute_edit(command: Edit) -> int:
    """Serve the editor until Ctrl-C."""
    config, model = replace(config_of(command), figures="all"), load_robot(command.robot)
    stem = result_stem(command.clip)
    path = command.edits or Path(f"{stem}.edits.toml")
    check_writable("--edits", path.parent)
    check_writable("--out", command.out)
    check_clip_kept(command.clip, command.out)
    clip = open_clip(command.clip, command)
    edits = load(path) if os.path.lexists(path) else ContactEdits.of(clip)
    with Working("retargeting", None):
        start = solved(clip, model, config, edits)

    settings = arguments_of(_as_run(command, path))

    def save_result(edited: EditState) -> tuple[Path, ...]:
        paths = result_paths(clip, stem, command.out)
        write([motion.with_report(command=settings) for motion in edited.motions], paths)
        return paths

    count = len(edits.edits)
    say(f"Edits are saved to {path}{f', which has {count} already' if count else ''}; then:")
    say(f"  {program()} {shlex.join(to_argv(settings, config.as_json()))}")
    files = EditsFiles(path)
    if os.path.lexists(files.unsaved):
        say(f"Edits that were not saved last time are in {files.unsaved}; the page offers them.")
    editor = Editor(EditSession(clip, model, config, start), model, SaveTargets(files, save_result))
    server = OnePageServer(editor.page, editor.answer, host=command.host, port=command.port)
    try:
        _wait_for_interrupt(server.address, server.port)
    finally:
        server.stop()
    return 0


def _as_run(command: Edit, edits: Path) -> Run:
    """Return the `run` that makes the same result."""
    shared = {field.name: getattr(command, field.name) for field in (*fields(RecordingOptions), *fields(SolveOptions))}
    return Run(clips=(command.clip,), out=command.out, edits=edits, **shared)


def _wait_for_interrupt(address: str, port: int) -> None:
    """Open a page where there is a browser, or print the way to it, and wait for Ctrl-C."""
    try:
        say(f"Open {address} in a browser. Ctrl-C ends it.")
        if _has_screen():
            webbrowser.open(address)
        elif "SSH_CONNECTION" in os.environ:
            # The server's own address, as the user's machine reached it.
            machine = os.environ["SSH_CONNECTION"].split()[2:3] or ["HOST"]
            say(f"From another machine, first: ssh -L {port}:localhost:{port} {getuser()}@{machine[0]}")
        Event().wait()
    except KeyboardInterrupt:
        say()


def _has_screen() -> bool:
    """Return whether somebody sits before this machine and has a browser; a remote shell has none."""
    if not sys.stdout.isatty() or "SSH_CONNECTION" in os.environ:
        return False
    if sys.platform.startswith("linux") and not ("DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ):
        return False
    with suppress(webbrowser.Error):
        webbrowser.get()
        return True
    return False


def execute_share(command: Share) -> int:
    """Write the gallery of all results that can be shown; return 1 where some cannot, and write none where none can."""
    check_replaceable(command.out)
    check_writable("--out", command.out.parent)
    paths = tuple(dict.fromkeys(file for path in command.results for file in files_of(path)))
    motions: dict[Path, Motion] = {}
    shared = 0
    with gallery_in(command.out, command.title) as gallery, Working("sharing", len(paths)) as working:
        for path in paths:
            with _failing(path, alone=len(paths) == 1):
                motions[path] = load_motion(path, command.robot)
        for title, members in _together(motions):
            working.describe(title)
            with _failing(*members, alone=len(paths) == 1):
                gallery.add(title, _results(members, motions, command))
                shared += len(members)
            working.advance(len(members))
        if not shared:
            raise HoiRetargetError(f"none of the {len(paths)} results can be shown: no gallery is written.")
    if gallery.without_pictures:
        warn(f"The cards have no pictures. {gallery.without_pictures}")
    say(f"{shared} motion{'s' if shared > 1 else ''} in {command.out}: open {command.out / 'index.html'} in a browser.")
    if failed := len(paths) - shared:
        say(f"{shared} shared, {failed} failed.")
    return 1 if failed else 0


@contextmanager
def _failing(*paths: Path, alone: bool) -> Iterator[None]:
    """Print an error of some files, each of them named; raise it where nothing else is shared."""
    try:
        yield
    except WriteError:
        raise
    except HoiRetargetError as error:
        if alone:
            raise
        for path in paths:
            fail(with_file(path, error))


def _together(motions: dict[Path, Motion]) -> Iterator[tuple[str, list[Path]]]:
    """Yield title and files of each page: robots that move the same objects share one."""
    files = list(motions)
    hosts = group_people([shared_objects(motion) for motion in motions.values()], [m.person for m in motions.values()])
    titles = titles_of(list(motions.items()), shortest=False)
    for host in dict.fromkeys(hosts):
        members = [index for index, other in enumerate(hosts) if other == host]
        yield title_together([titles[index] for index in members]), [files[index] for index in members]


def _results(
    paths: Sequence[Path], motions: dict[Path, Motion], command: Share
) -> list[tuple[GalleryEntry, SceneItem]]:
    models = [load_robot(motions[path].robot) for path in paths]
    names = names_together([(model.spec, motions[path].person) for model, path in zip(models, paths, strict=True)])
    results = []
    for path, model, name in zip(paths, models, names, strict=True):
        motion = motions[path]
        clip = clip_or_warning(path, motion, command, "its page shows the robot without the human.")
        shown = SceneItem(name, motion, model, clip, motion.person)
        scored = score(motion, path) if motion.report.figures else known_figures(motion, path)
        results.append((gallery_entry_of(motion, model, scored), shown))
    return results
