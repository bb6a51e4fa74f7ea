"""Tells how a run over rosbridge went, by the summaries of both sides and by what the server has counted; arguments are the
folder of scripts/peers.sh and the seconds. Ends with 1 where a connection was lost or poses came too slowly."""

import csv
import json
import pathlib
import sys

folder, seconds = pathlib.Path(sys.argv[1]), float(sys.argv[2])
LEAST_HZ = 95.0
city = json.loads((folder / "city/summary.json").read_text())
mainframe = json.loads((folder / "mainframe/summary.json").read_text())
faults = []

ros = city["link"]["ros"]
print(f"city: {ros['published']} instants published, {ros['dropped']} dropped, connection lost {ros['master_returns']} times")
if ros["master_returns"]:
    faults.append("the city has lost its connection")
if city["collisions"]:
    faults.append(f"{city['collisions']} collisions")

server = (folder / "server").read_text().splitlines()[1:] if (folder / "server").exists() else []
if server:
    told = json.loads(server[0])
    lost = told["clients"] - 2
    print(f"server: {told['clients']} connections, {told['pings']} pings answered, longest backlog {told['longest_backlog']}")
    for name, topic in sorted(told["topics"].items()):
        if name.startswith("/vicon/"):
            rates = f"{topic['hz']:.1f} poses a second came, {topic['delivered_hz']:.1f} went on"
            print(f"  {name}: {rates}, longest gap {1e3 * topic['longest_gap_s']:.0f} ms, {len(topic['wrong'])} wrong")
            if min(topic["hz"], topic["delivered_hz"]) < LEAST_HZ:
                faults.append(f"{name}: {rates}")
    if lost:
        faults.append(f"{lost} connections more than two")
    if told.get("refusals"):
        faults.append(f"{told['refusals']} refusals")

# What the mainframe drove by: instants that it has seen.
with open(folder / "mainframe/vehicles.csv") as table:
    rows = sum(1 for _ in csv.reader(table)) - 1
print(f"mainframe: {mainframe['simulated_s']:.1f} of {seconds:.1f} s, {rows} rows of poses")
stops = {side: sum(v["stops"] for v in summary["vehicles"].values()) for side, summary in (("city", city), ("mainframe", mainframe))}
print(f"stops: {stops['city']} in the city, {stops['mainframe']} as the mainframe has seen it")
for fault in faults:
    print("FAULT:", fault)
sys.exit(bool(faults))
