#!/usr/bin/env bash
# What the ends cost a city: how late its ticks begin, with none and with all of them attached, in turns.
#
#   scripts/ends_lateness.sh [SECONDS [TURNS]]   60 vehicles in real time, 30 s and 3 turns unless told otherwise; prints a
#                                                line for each run, and the medians
#
# With all: two pages and two clients of Foxglove, one of each stalled (it asks for everything and reads nothing), ROS 2
# with a subscriber to the poses; "with pictures" one page has two pictures, and Foxglove and ROS 2 a camera.
# Another program than that of this folder: CITY3D=/usr/bin/city3d scripts/ends_lateness.sh.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh
set_up

seconds=${1:-30} turns=${2:-3} city3d=${CITY3D:-}
folder=$(mktemp -d)
processes=()
end_all() {
    for process in "${processes[@]}"; do kill -TERM "$process" 2>/dev/null || true; done
    for process in "${processes[@]}"; do wait "$process" 2>/dev/null || true; done
    processes=()
}
trap 'end_all; rm -rf "$folder"' EXIT

install_packages python3-venv
make_venv target/web-peer tests/peers/web-requirements.txt
make_venv target/ros2-peer tests/peers/ros2-requirements.txt
if [[ -z "$city3d" ]]; then
    cargo build --release --locked
    city3d="${CARGO_TARGET_DIR:-target}/release/city3d"
fi
sed 's/^vehicles = .*/vehicles = 60/' scenarios/city.toml >"$folder/crowd.toml"

# measure NAME [OPTION...]: one run; its line is NAME p50 p99 max, milliseconds.
measure() {
    local name=$1 address domain=$((100 + RANDOM % 100))
    shift
    local options=("${@/DOMAIN/$domain}")
    rm -rf "$folder/out"
    (trap - INT; exec "$city3d" serve "$folder/crowd.toml" --headless --bind 127.0.0.1:0 --out "$folder/out" \
        --duration "$seconds" "${options[@]}") >"$folder/city.out" 2>"$folder/city.err" &
    local city=$!
    processes+=("$city")
    until grep -q "is served on udp" "$folder/city.out" && { [[ $name == none ]] || grep -q "Foxglove connects" "$folder/city.out"; }; do
        kill -0 "$city" 2>/dev/null || die "the city ended: $(cat "$folder/city.err")"
        sleep 0.1
    done
    address=$(sed -n 's/.*on udp \([0-9.:]*\).*/\1/p' "$folder/city.out")
    if [[ $name != none ]]; then
        local page foxglove
        page=$(grep -o 'http://.*' "$folder/city.out") foxglove=$(grep -o 'ws://.*' "$folder/city.out")
        target/web-peer/bin/python tests/peers/ends_clients.py "$page" "$foxglove" "$name" >"$folder/clients" 2>&1 &
        processes+=($!)
        local topic
        topic=$("$city3d" check "$folder/crowd.toml" --json --routes |
            /usr/bin/python3 -c 'import json, sys; print(json.load(sys.stdin)["routes"]["vehicles"][0]["name"])')
        RMW_IMPLEMENTATION=rmw_fastrtps_cpp ROS_DOMAIN_ID=$domain target/ros2-peer/bin/python \
            tests/peers/ros2_listen.py "$seconds" 10 reliable "$topic" >"$folder/ros2" 2>&1 &
        processes+=($!)
        if [[ $name == pictures ]]; then
            RMW_IMPLEMENTATION=rmw_fastrtps_cpp ROS_DOMAIN_ID=$domain target/ros2-peer/bin/python \
                tests/peers/ros2_pictures.py "$topic" windscreen 100000 compressed >"$folder/seen" 2>&1 &
            processes+=($!)
        fi
    fi
    "$city3d" mainframe "$folder/crowd.toml" --city "$address" >"$folder/mainframe.out" 2>&1 &
    processes+=($!)
    wait "$city"
    end_all
    /usr/bin/python3 - "$name" "$folder/out/summary.json" <<'PYTHON' | tee -a "$folder/lines"
import json, sys
summary = json.load(open(sys.argv[2]))
late = summary["link"]["tick_lateness"]
ends = {name: (end["delivered"], end["dropped"]) for name, end in summary["ends"].items()}
print(sys.argv[1], *(f"{late[key]:.2f}" for key in ("p50_ms", "p99_ms", "max_ms")), late["ticks"], "ticks;", ends)
PYTHON
}

ends=(--web=127.0.0.1:0 --foxglove=127.0.0.1:0 --ros2=DOMAIN --ros2-tf)
say "lateness of ticks in ms: p50, p99, most"
for _ in $(seq "$turns"); do
    measure none
    measure all "${ends[@]}"
    measure pictures "${ends[@]}" --ros2-cameras
done
/usr/bin/python3 - "$folder/lines" <<'PYTHON'
import statistics, sys
lines = [line.split() for line in open(sys.argv[1])]
for name in ("none", "all", "pictures"):
    p99 = [float(line[2]) for line in lines if line[0] == name]
    print(f"{name}: p99 {statistics.median(p99):.2f} ms, median of {len(p99)} turns ({min(p99):.2f} to {max(p99):.2f})")
PYTHON
