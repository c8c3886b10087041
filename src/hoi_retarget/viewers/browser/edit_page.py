"""The editor's page: every browser that opens it edits on its own, from what was saved last."""

from hoi_retarget.clip.clip import Clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.browser.client_sessions import serve_sessions
from hoi_retarget.viewers.browser.editing import Edited, Editing
from hoi_retarget.viewers.browser.editor import Editor, Places
from hoi_retarget.viewers.browser.server import PageServer


def serve_editor(  # noqa: PLR0913, PLR0917 - what an editor needs
    server: PageServer, recorded: Clip, model: RobotModel, config: Config, start: Edited, places: Places
) -> None:
    """Let a server edit the contacts of a clip; nothing of a browser's work outlives it but what it saved."""
    latest = start

    def keep(saved: Edited) -> None:
        nonlocal latest
        latest = saved

    serve_sessions(server, lambda client: Editor(client, Editing(recorded, model, config, latest), model, places, keep))
