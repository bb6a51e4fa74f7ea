"""`python -m city3d`: the program's command."""

from . import main

main()
