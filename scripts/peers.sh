#!/usr/bin/env bash
# Long checks against other people's programs, which the test suite has in short.
#
#   scripts/peers.sh rosbridge [SECONDS]   the roundabout over rosbridge, 120 s unless told otherwise: a server of Autobahn,
#                                          Twisted and rospy (what rosbridge_suite is made of) under a roscore of its own
#   scripts/peers.sh web [FOLDER]          the web page in Debian's Chromium: plan, table, preview, start, drive, reconnect,
#                                          twenty pages; pictures of it go to FOLDER, out/web unless told otherwise
#   scripts/peers.sh foxglove [FOLDER]     a served city with Foxglove's own client of its protocol and its readers of ROS 2
#                                          messages (npm), and its definitions of messages (PyPI); a picture goes to
#                                          FOLDER, out/foxglove unless told otherwise
#
# To check against rosbridge_suite itself, where it is installed: ROSBRIDGE=ws://127.0.0.1:9090 scripts/peers.sh rosbridge.
# Another program than that of this folder: CITY3D=/usr/bin/city3d scripts/peers.sh rosbridge.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh

folder=$(mktemp -d)
processes=()

end() {
    # What has ended already needs no signal.
    for process in "${processes[@]}"; do kill -INT "$process" 2>/dev/null || true; done
    for process in "${processes[@]}"; do wait "$process" 2>/dev/null || true; done
    rm -rf "$folder"
}
trap end EXIT

free_port() { /usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'; }

# Waits until a file has a line that matches.
wait_for() {
    for _ in $(seq 600); do
        grep -q "$2" "$1" 2>/dev/null && return
        sleep 0.1
    done
    die "nothing like \"$2\" in: $(cat "$1")"
}

start_server() {
    local port
    port=$(free_port)
    export ROS_MASTER_URI="http://127.0.0.1:$port" ROS_IP=127.0.0.1 ROS_HOME="$folder" ROS_LOG_DIR="$folder/log"
    # Processes in the background of a script ignore Ctrl-C unless they are told otherwise.
    (trap - INT; exec roscore -p "$port") >"$folder/roscore" 2>&1 &
    processes+=($!)
    wait_for "$folder/roscore" "started core service"
    mkfifo "$folder/input"
    /usr/bin/python3 tests/peers/rosbridge.py --ros <"$folder/input" >"$folder/server" &
    server=$!
    exec 9>"$folder/input"
    wait_for "$folder/server" '^[0-9]'
    uri="ws://127.0.0.1:$(head -1 "$folder/server")"
}

rosbridge() {
    local seconds=${1:-120} uri=${ROSBRIDGE:-} server= city3d=${CITY3D:-}
    [[ -n "$uri" ]] || start_server
    if [[ -z "$city3d" ]]; then
        cargo build --release --locked
        city3d="${CARGO_TARGET_DIR:-target}/release/city3d"
    fi
    local length=(roundabout --duration "$seconds" "--rosbridge=$uri")
    (trap - INT; exec "$city3d" serve "${length[@]}" --headless --bind 127.0.0.1:0 --out "$folder/city") \
        >"$folder/city.out" 2>"$folder/city.err" &
    processes+=($!)
    wait_for "$folder/city.out" "is served on udp"
    local address
    address=$(sed -n 's/.*on udp \([0-9.:]*\).*/\1/p' "$folder/city.out")
    say "$seconds s of the roundabout over $uri"
    "$city3d" mainframe "${length[@]}" --city "$address" --out "$folder/mainframe" 2>"$folder/mainframe.err"
    wait "${processes[-1]}"
    unset 'processes[-1]'
    if [[ -n "$server" ]]; then
        exec 9>&-
        wait "$server"
    fi
    cat "$folder/city.err" "$folder/mainframe.err" >&2
    /usr/bin/python3 tests/peers/rosbridge_report.py "$folder" "$seconds"
}

# serve_city OPTION LINE: serves the roundabout with an option and waits for its line; a mainframe brings the vehicles.
serve_city() {
    # Of a city before: its lines are not those that are waited for.
    rm -f "$folder/city.out"
    (trap - INT; exec "$city3d" serve roundabout --headless --bind 127.0.0.1:0 "$1") \
        >"$folder/city.out" 2>"$folder/city.err" &
    city=$!
    wait_for "$folder/city.out" "$2"
    local address
    address=$(sed -n 's/.*on udp \([0-9.:]*\).*/\1/p' "$folder/city.out")
    (trap - INT; exec "$city3d" mainframe roundabout --city "$address") >"$folder/mainframe.out" 2>&1 &
    mainframe=$!
    processes=("$city" "$mainframe")
}

web() {
    local pictures=${1:-out/web} city3d=${CITY3D:-} port city mainframe
    install_packages chromium
    install_packages python3-venv
    make_venv target/web-peer tests/peers/web-requirements.txt
    if [[ -z "$city3d" ]]; then
        cargo build --release --locked
        city3d="${CARGO_TARGET_DIR:-target}/release/city3d"
    fi
    port=$(free_port)
    serve_city "--web=127.0.0.1:$port" "web page is at"
    mkfifo "$folder/restart"
    say "the web page in Chromium"
    target/web-peer/bin/python tests/peers/web.py chromium "$(grep -o 'http://.*' "$folder/city.out")" "$pictures" \
        "$folder/restart" &
    local browser=$!
    # The browser asks for another city at the same address; where it fails, it closes the pipe.
    if read -r _ <"$folder/restart"; then
        kill -INT "$city" "$mainframe"
        wait "$city" "$mainframe" || true
        serve_city "--web=127.0.0.1:$port" "web page is at"
    fi
    wait "$browser"
}

foxglove() {
    local pictures=${1:-out/foxglove} city3d=${CITY3D:-} city mainframe url node=target/foxglove-peer/node
    command -v npm >/dev/null || install_packages nodejs npm
    install_packages python3-venv
    make_venv target/foxglove-peer/python tests/peers/foxglove/requirements.txt
    if ! cmp -s tests/peers/foxglove/package.json "$node/package.json"; then
        say "installing tests/peers/foxglove/package.json into $node"
        rm -rf "$node" && mkdir -p "$node"
        cp tests/peers/foxglove/package.json "$node/package.json"
        (cd "$node" && npm install --no-audit --no-fund --ignore-scripts) ||
            { rm -rf "$node"; die "npm cannot install Foxglove's client"; }
    fi
    if [[ -z "$city3d" ]]; then
        cargo build --release --locked
        city3d="${CARGO_TARGET_DIR:-target}/release/city3d"
    fi
    serve_city --foxglove=127.0.0.1:0 "Foxglove connects to"
    url=$(grep -o 'ws://.*' "$folder/city.out")
    mkdir -p "$pictures"
    say "Foxglove's definitions of messages"
    target/foxglove-peer/python/bin/python tests/peers/foxglove/scene.py "$url" "$pictures/windscreen.jpg"
    say "Foxglove's client and its readers"
    # Modules are looked for beside the script.
    cp tests/peers/foxglove/client.mjs "$node/client.mjs"
    node "$node/client.mjs" "$url"
}

case "${1:-}" in
    foxglove)
        set_up
        shift
        foxglove "$@"
        ;;
    web)
        set_up
        shift
        web "$@"
        ;;
    rosbridge)
        set_up_tests
        shift
        rosbridge "$@"
        ;;
    *) die "usage: scripts/peers.sh rosbridge [SECONDS], web [FOLDER] or foxglove [FOLDER]" ;;
esac
