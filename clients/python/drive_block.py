"""Sets up a car, sends it once around the block between Second Avenue, East Street, Main Boulevard and Centre
Street of the map ids3c, and tells where it came by.

    city3d serve roundabout --headless &
    python3 drive_block.py [PORT [KEY_FILE]]
"""

import json
import math
import sys

from city3d_link import City

SPEED = 0.2  # m/s of the laboratory
BRAKING = 0.1  # m/s2, at the end of the way
RADIUS = 0.2  # of the corners
CORNERS = [(1.974, 1.793), (1.974, -0.241), (0.071, -0.241), (0.071, 1.793)]
START = (0.5, 1.793)
FRONT_AXLE = 0.06  # ahead of the middle of the outline


def block():
    """Pieces of the way: (x, y, yaw, length, curvature)."""
    pieces, x, y = [], *START
    for k, (corner_x, corner_y) in enumerate(CORNERS):
        yaw = -k * math.pi / 2
        length = math.hypot(corner_x - x, corner_y - y) - RADIUS
        pieces.append((x, y, yaw, length, 0.0))
        x, y = x + length * math.cos(yaw), y + length * math.sin(yaw)
        pieces.append((x, y, yaw, RADIUS * math.pi / 2, -1 / RADIUS))
        x = x + RADIUS * (math.cos(yaw) + math.sin(yaw))
        y = y + RADIUS * (math.sin(yaw) - math.cos(yaw))
    pieces.append((x, y, 0.0, START[0] - x, 0.0))
    return pieces


def at(pieces, s):
    """Position and heading at a distance along the way."""
    for x, y, yaw, length, curvature in pieces:
        if s <= length or (x, y, yaw, length, curvature) == pieces[-1]:
            turned = yaw + curvature * s
            if curvature == 0.0:
                return x + s * math.cos(yaw), y + s * math.sin(yaw), turned
            return (x + (math.sin(turned) - math.sin(yaw)) / curvature,
                    y - (math.cos(turned) - math.cos(yaw)) / curvature, turned)
        s -= length


def plan(way, now):
    """How far along the way, and how fast, the car shall be at a time."""
    braking_s = SPEED / BRAKING
    begin_s = way / SPEED - braking_s / 2
    late = min(max(now - begin_s, 0.0), braking_s)
    return SPEED * min(now, begin_s) + SPEED * late - BRAKING * late * late / 2, SPEED - BRAKING * late


def main():
    if len(sys.argv) > 1 and not sys.argv[1].isdecimal():
        sys.exit(__doc__)
    key = open(sys.argv[2], "rb").read().strip() if len(sys.argv) > 2 else None
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 9870
    try:
        city = City(port=port, key=key)
    except TimeoutError as error:
        sys.exit(f"port {port}: {error}; start one with: city3d serve roundabout --headless")
    pieces = block()
    way = sum(piece[3] for piece in pieces)
    city.setup(1, "courier", START[0] - FRONT_AXLE, START[1], 0.0, speed=SPEED, algorithm="drive_block")
    city.subscribe(every_ticks=2)
    began, said = False, None
    for poses in city.poses(wait=30.0):
        pose, now = poses.vehicles[1], poses.time
        points = []
        for k in range(13):
            s, speed = plan(way, now + 0.25 * k)
            points.append((now + 0.25 * k, *at(pieces, s), speed))
        city.trajectory(1, points, finished=points[0][4] <= 0.0)
        if not began:
            city.start()
            began = True
        if poses.tick % 100 == 0 or pose.status != said:
            said = pose.status
            print(json.dumps({"t": now, "x": pose.x, "y": pose.y, "status": pose.status}), flush=True)
        if pose.status in ("finished", "collided") and now > way / SPEED + 3.0:
            break
    city.pause()


main()
