"""Draws a small map with ezdxf: a closed loop of lanes, a branch, a stop line and a tree.

usage: draw_map.py FILE.dxf
"""

import sys

import ezdxf
from ezdxf import units

RADIUS = 0.5


def draw(path):
    document = ezdxf.new("R2000")
    document.units = units.M
    space = document.modelspace()

    def line(layer, start, end):
        space.add_line(start, end, dxfattribs={"layer": layer})

    def arc(layer, centre, radius, start_angle, end_angle):
        # Always counter-clockwise; the direction of travel comes from the lines it is joined to.
        space.add_arc(centre, radius, start_angle, end_angle, dxfattribs={"layer": layer})

    def text(layer, words, place):
        space.add_text(words, height=0.05, dxfattribs={"layer": layer}).set_placement(place)

    # A loop, driven counter-clockwise: east along the south, west along the north.
    line("LANES", (0, 0), (2, 0))
    arc("LANES", (2, RADIUS), RADIUS, -90, 90)
    line("LANES", (2, 2 * RADIUS), (0, 2 * RADIUS))
    arc("LANES", (0, RADIUS), RADIUS, 90, 270)
    text("NAMES", "loop", (1.0, 1.02))
    text("SPEEDS", "0.25 m/s", (2 + RADIUS, RADIUS))
    line("STOP_LINES", (1.8, -0.07), (1.8, 0.07))

    # A branch that leaves the southern straight at x = 1 to the right and runs south.
    arc("CONNECTORS", (1, -0.3), 0.3, 0, 90)
    line("LANES", (1.3, -0.3), (1.3, -1))
    text("NAMES", "branch", (1.3, -0.6))

    space.add_circle((1, 0.5), 0.1, dxfattribs={"layer": "SCENERY_TREE"})
    document.saveas(path)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    draw(sys.argv[1])
