"""The digital twin of a 1:25 scaled smart city for connected and automated vehicles.

`World` is a city that is simulated in this process: step it, read the states of its vehicles as arrays, draw what
cameras see, drive vehicles by arrays of actions or by a class of your own. `read` reads the log of a run. `city3d.envs` has environments of Gymnasium and
PettingZoo. All lengths are full-scale metres, but those of drivers and coordinators: they work in the laboratory's metres, 1:25.
"""

import os
import sys

from ._native import (
    ACTIONS,
    CLASSES,
    COLUMNS,
    SCENARIOS,
    STATUSES,
    Animation,
    Camera,
    Figure,
    Log,
    Plan,
    Request,
    SavedWorld,
    Table,
    World,
    ZoneView,
    __version__,
    picture_worlds,
    read,
    run_program,
    step_worlds,
)

__all__ = [
    "ACTIONS",
    "CLASSES",
    "COLUMNS",
    "SCENARIOS",
    "STATUSES",
    "Animation",
    "Camera",
    "Figure",
    "Log",
    "Plan",
    "Request",
    "SavedWorld",
    "Table",
    "World",
    "ZoneView",
    "__version__",
    "main",
    "picture_worlds",
    "read",
    "run_program",
    "step_worlds",
]


def main() -> None:
    """The program's command: `city3d run roundabout`, and all others."""
    if hasattr(os, "getuid"):
        # As the program has it for itself: libwayland complains where it looks for a display without this folder.
        os.environ.setdefault("XDG_RUNTIME_DIR", f"/run/user/{os.getuid()}")
    sys.exit(run_program(["city3d", *sys.argv[1:]]))
