"""Says what came of a served city over ROS 2: arguments are its folder, what it had to do (`drive`: all vehicles drive, none collides;
`measure`: a vehicle is measured; `garbage`: likewise, among messages that are dropped; `lead`: trajectories are heard; `nothing`: nobody
is heard) and vehicles' numbers. Fails where it is not so."""

import json
import sys

folder, task, numbers = sys.argv[1], sys.argv[2], sys.argv[3:]
summary = json.load(open(f"{folder}/summary.json"))
vehicles, link, end = summary["vehicles"], summary["link"]["ros"], summary["ends"]["ros2"]
print(json.dumps({"collisions": summary["collisions"], "link": link, "end": end}))
assert end["dropped"] == 0 and end["failures"] == 0, end
for number in numbers:
    way = vehicles[number]["distance_m"]
    print(number, vehicles[number]["status"], round(way, 1), "m")
    assert way > (60.0 if task == "drive" else 5.0), f"vehicle {number} has driven {way} m"
if task == "drive":
    assert summary["collisions"] == 0, "vehicles collided"
assert (link["heard"] == 0) == (task == "nothing") and (link["invalid"] > 0) == (task == "garbage"), link
