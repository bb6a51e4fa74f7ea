"""The digital twin of a 1:25 scaled smart city for connected and automated vehicles.

`World` is a city that is simulated in this process: step it, read the states of its vehicles as arrays, draw what
cameras see, drive vehicles by pedals or by a class of your own. `city3d.envs` has environments of Gymnasium and
PettingZoo. All lengths are full-scale metres, but those of drivers: they work in the laboratory's metres, 1:25.
"""

import sys

from ._native import (
    CLASSES,
    COLUMNS,
    SCENARIOS,
    STATUSES,
    Camera,
    SavedWorld,
    World,
    __version__,
    run_program,
    step_worlds,
)

__all__ = [
    "CLASSES",
    "COLUMNS",
    "SCENARIOS",
    "STATUSES",
    "Camera",
    "SavedWorld",
    "World",
    "__version__",
    "main",
    "run_program",
    "step_worlds",
]


def main() -> None:
    """The program's command: `city3d run roundabout`, and all others."""
    sys.exit(run_program(["city3d", *sys.argv[1:]]))
