"""The package is `CITY3D_PACKAGE`, a folder on the path, or the installed one."""

import os
import sys

if folder := os.environ.get("CITY3D_PACKAGE"):
    sys.path.insert(0, folder)
