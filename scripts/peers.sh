#!/usr/bin/env bash
# Long checks against other people's programs, which the test suite has in short.
#
#   scripts/peers.sh rosbridge [SECONDS]   the roundabout over rosbridge, 120 s unless told otherwise: a server of Autobahn,
#                                          Twisted and rospy (what rosbridge_suite is made of) under a roscore of its own
#   scripts/peers.sh web [FOLDER]          the web page in Debian's Chromium: plan, table, preview, start, drive, guests, H.264,
#                                          reconnect, twenty pages; pictures of it go to FOLDER, out/web unless told otherwise
#   scripts/peers.sh foxglove [FOLDER]     a served city with Foxglove's own client of its protocol and its readers of ROS 2
#                                          messages (npm), and its definitions of messages (PyPI); a picture goes to
#                                          FOLDER, out/foxglove unless told otherwise
#   scripts/peers.sh ros2 [SECONDS]        ROS 2 over DDS: rclpy (Fast DDS) as mainframe and as motion capture, the node of
#                                          clients/ros2, Cyclone DDS, hostile participants; as root, a second network
#                                          namespace; 60 vehicles for 60 s unless told otherwise
#   scripts/peers.sh zenoh [SECONDS]       ROS 2 over Zenoh (feature zenoh): zenoh-ros2 and eclipse-zenoh with the hashes and
#                                          messages of rosbags (PyPI); 60 vehicles for 60 s unless told otherwise
#
# To check against rosbridge_suite itself, where it is installed: ROSBRIDGE=ws://127.0.0.1:9090 scripts/peers.sh rosbridge.
# Another program than that of this folder: CITY3D=/usr/bin/city3d scripts/peers.sh rosbridge.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh

folder=$(mktemp -d)
processes=()

end_all() {
    # What has ended already needs no signal.
    for process in "${processes[@]}"; do kill -INT "$process" 2>/dev/null || true; done
    for process in "${processes[@]}"; do wait "$process" 2>/dev/null || true; done
    processes=()
}

end() {
    end_all
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

# serve_city OPTION LINE: serves the roundabout with an option and waits for its line; a mainframe brings the vehicles, for longer
# than the checks take.
serve_city() {
    # Of a city before: its lines are not those that are waited for.
    rm -f "$folder/city.out"
    (trap - INT; exec "$city3d" serve roundabout --headless --bind 127.0.0.1:0 --guests 1 "$1") \
        >"$folder/city.out" 2>"$folder/city.err" &
    city=$!
    wait_for "$folder/city.out" "$2"
    local address
    address=$(sed -n 's/.*on udp \([0-9.:]*\).*/\1/p' "$folder/city.out")
    (trap - INT; exec "$city3d" mainframe roundabout --duration 600 --city "$address") >"$folder/mainframe.out" 2>&1 &
    mainframe=$!
    processes=("$city" "$mainframe")
}

web() {
    local pictures=${1:-out/web} city3d=${CITY3D:-} port city mainframe
    # openh264 is C++.
    install_packages chromium
    install_packages python3-venv g++
    make_venv target/web-peer tests/peers/web-requirements.txt
    if [[ -z "$city3d" ]]; then
        cargo build --release --locked --features h264
        export CITY3D_HAS_H264=1
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
    end_all
    if [[ -n "${CITY3D_HAS_H264:-}" ]]; then
        say "lints of the feature h264, and its frames, decoded by openh264"
        cargo clippy --locked --no-default-features --features h264 -- -D warnings
        cargo test --release --locked -p city3d-web -p city3d --features city3d/h264 --lib h264
    fi
    say "a log on the page"
    "$city3d" run roundabout --duration 20 --out "$folder/run" --json >"$folder/run.json"
    (trap - INT; exec "$city3d" replay "$folder/run" --web=127.0.0.1:0) >"$folder/log.out" 2>"$folder/log.err" &
    processes+=($!)
    wait_for "$folder/log.out" "web page is at"
    target/web-peer/bin/python tests/peers/web.py chromium "$(grep -o 'http://.*' "$folder/log.out")" "$pictures" --log
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
    end_all
    say "pictures of a run"
    (trap - INT; exec "$city3d" run roundabout --speed 1 --duration 120 --foxglove=127.0.0.1:0 --out "$folder/seen") \
        >"$folder/run.out" 2>"$folder/run.err" &
    processes+=($!)
    wait_for "$folder/run.out" "Foxglove connects to"
    target/foxglove-peer/python/bin/python tests/peers/foxglove/scene.py "$(grep -o 'ws://.*' "$folder/run.out")" "$pictures/run.jpg" --look
}

# serve_ros2 NAME ARGUMENTS: serves a city over ROS 2 in the background; its files go to $folder/NAME.
serve_ros2() {
    local name=$1
    shift
    (trap - INT; exec "$city3d" serve "$@" --headless --bind 127.0.0.1:0 --out "$folder/$name") \
        >"$folder/$name.out" 2>"$folder/$name.err" &
    processes+=($!)
    wait_for "$folder/$name.out" "is served on udp"
    address=$(sed -n 's/.*on udp \([0-9.:]*\).*/\1/p' "$folder/$name.out")
}

# Waits for the last city, which ends by itself, and says what it came to.
end_ros2() {
    wait "${processes[-1]}" || die "the city failed: $(cat "$folder/$1.err")"
    unset 'processes[-1]'
    cat "$folder/$1.err" >&2
    python3 tests/peers/ros2_report.py "$folder/$@"
}

# A second machine: a network namespace behind a pair of virtual Ethernet devices.
far_machine() {
    (trap - INT; exec unshare -n sleep 600) &
    far=$!
    processes+=("$far")
    until [[ "$(readlink "/proc/$far/ns/net")" != "$(readlink /proc/self/ns/net)" ]]; do sleep 0.1; done
    ip link add city3d0 type veth peer name city3d1 netns "$far"
    ip address add 10.207.0.1/24 dev city3d0
    ip link set city3d0 up
    nsenter -t "$far" -n sh -c 'ip link set lo up; ip address add 10.207.0.2/24 dev city3d1; ip link set city3d1 up;
        ip route add 224.0.0.0/4 dev city3d1'
}

elsewhere() {
    local cyclone='<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="10.207.0.2"/></Interfaces></General>
        <Discovery><Peers><Peer address="10.207.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
    CYCLONEDDS_URI=$cyclone nsenter -t "$far" -n "$@"
}

across_namespaces() {
    local far topic=rt/vicon/path1_a/path1_a
    far_machine
    say "from another machine: nothing is seen, and nothing comes in"
    serve_ros2 alone mixed "--ros2=$domain" --ros2-control --duration 8
    if elsewhere "$python" tests/peers/ros2_topics.py "$domain" "$topic"; then die "the city is seen"; fi
    elsewhere "$python" tests/peers/ros2_measure.py path1_b 0 0 0.1 4 path1_a
    kill -INT "${processes[-1]}"
    end_ros2 alone nothing
    say "with --ros2-network it is seen, and hears"
    serve_ros2 open mixed "--ros2=$domain" --ros2-network 10.207.0.1 --ros2-control --duration 6
    elsewhere "$python" tests/peers/ros2_topics.py "$domain" ros_discovery_info "$topic"
    elsewhere "$python" tests/peers/ros2_measure.py path1_b -0.9 1.793 0.2 8 path1_a
    end_ros2 open measure 2
}

ros2() {
    local seconds=${1:-60} city3d=${CITY3D:-} domain=$((100 + RANDOM % 100)) address
    local python=$PWD/target/ros2-peer/bin/python
    local loopback='<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces></General></Domain></CycloneDDS>'
    make_venv target/ros2-peer tests/peers/ros2-requirements.txt
    export RMW_IMPLEMENTATION=rmw_fastrtps_cpp ROS_DOMAIN_ID=$domain
    if [[ -z "$city3d" ]]; then
        cargo build --release --locked
        city3d="${CARGO_TARGET_DIR:-target}/release/city3d"
    fi
    say "a node of rclpy drives the roundabout from start to end"
    "$city3d" check roundabout-coordinated --json --routes >"$folder/routes.json"
    serve_ros2 driven roundabout "--ros2=$domain" --ros2-clock --ros2-control --duration 40
    "$python" tests/peers/ros2_mainframe.py "$folder/routes.json"
    end_ros2 driven drive 1 2 3 4 5 6
    say "the node of clients/ros2 drives round a block"
    "$city3d" check clients/ros2/block.toml --json --routes >"$folder/block.json"
    serve_ros2 block clients/ros2/block.toml "--ros2=$domain" --ros2-control
    timeout 90 "$python" clients/ros2/drive_block.py "$folder/block.json"
    kill -INT "${processes[-1]}"
    end_ros2 block drive 1
    say "poses in the form of ros2-vicon-receiver move a physical vehicle"
    serve_ros2 measured mixed "--ros2=$domain" --ros2-control --duration 6
    "$python" tests/peers/ros2_measure.py path1_b -0.9 1.793 0.2 8 path1_a
    end_ros2 measured measure 2
    say "Cyclone DDS leads a vehicle with trajectories in fragments"
    serve_ros2 fragments mixed "--ros2=$domain" --ros2-control --duration 6
    CYCLONEDDS_URI=$loopback "$python" tests/peers/ros2_fragments.py "$domain" path1_a 8
    end_ros2 fragments lead
    say "hostile participants take no memory, and others are heard"
    serve_ros2 attacked mixed "--ros2=$domain" --ros2-control --duration 6
    "$python" tests/peers/ros2_hostile.py "$domain" "${processes[-1]}" 192
    "$python" tests/peers/ros2_measure.py path1_b -0.9 1.793 0.2 8 path1_a
    end_ros2 attacked garbage 2
    say "compressed pictures are whole at default buffers"
    serve_ros2 seen straight "--ros2=$domain" --ros2-cameras
    "$city3d" mainframe straight --duration 60 --city "$address" >"$folder/mainframe.out" 2>&1 &
    processes+=($!)
    "$python" tests/peers/ros2_pictures.py leader windscreen 5 compressed
    end_all
    say "depth and classes, small enough for default buffers"
    serve_ros2 kinds straight "--ros2=$domain" --ros2-cameras --ros2-kinds depth,classes --ros2-camera-size 160x120
    "$city3d" mainframe straight --duration 60 --city "$address" >"$folder/mainframe.out" 2>&1 &
    processes+=($!)
    "$python" tests/peers/ros2_pictures.py leader windscreen 3 depth
    "$python" tests/peers/ros2_pictures.py leader windscreen 3 classes
    end_all
    say "Cyclone DDS lists what is published, and $seconds s of 60 vehicles are heard"
    sed 's/^vehicles = .*/vehicles = 60/' scenarios/city.toml >"$folder/crowd.toml"
    serve_ros2 many "$folder/crowd.toml" "--ros2=$domain" --ros2-tf
    "$city3d" mainframe "$folder/crowd.toml" --city "$address" >"$folder/mainframe.out" 2>&1 &
    processes+=($!)
    CYCLONEDDS_URI=$loopback "$python" tests/peers/ros2_topics.py "$domain" ros_discovery_info rt/tf rt/tf_static
    CYCLONEDDS_URI=$loopback COLUMNS=120 target/ros2-peer/bin/cyclonedds ls --id "$domain" --suppress-progress-bar >"$folder/listed"
    local listed
    for listed in rt/tf rt/tf_static "rt/vicon/" tf2_msgs::msg::dds_::TFMessage_ geometry_msgs::msg::dds_::PoseStamped_; do
        grep -q "$listed" "$folder/listed" || die "cyclonedds ls does not list $listed: $(cat "$folder/listed")"
    done
    echo "cyclonedds ls lists $(grep -c 'rt/vicon/' "$folder/listed") topics of vehicles"
    local names
    mapfile -t names < <("$city3d" check "$folder/crowd.toml" --json --routes |
        python3 -c 'import json, sys; print(*(v["name"] for v in json.load(sys.stdin)["routes"]["vehicles"][:60]), sep="\n")')
    local depth
    for depth in 1000 10; do
        "$python" tests/peers/ros2_listen.py "$seconds" "$depth" reliable "${names[@]}"
    done
    end_all
    python3 tests/peers/ros2_report.py "$folder/many" nothing
    if [[ $(id -u) == 0 ]]; then across_namespaces; else echo "SKIPPED: another network namespace needs root"; fi
}

zenoh() {
    local seconds=${1:-60} city3d=${CITY3D:-} domain=$((100 + RANDOM % 100)) address
    local peer=$PWD/target/zenoh-peer/bin
    make_venv target/zenoh-peer tests/peers/zenoh-requirements.txt
    # Not in scripts/test.sh: its crates take three minutes of a processor.
    say "lints of the feature zenoh"
    cargo clippy --locked --no-default-features --features zenoh -- -D warnings
    if [[ -z "$city3d" ]]; then
        cargo build --release --locked --features zenoh
        city3d="${CARGO_TARGET_DIR:-target}/release/city3d"
    fi
    say "poses over Zenoh move a physical vehicle, and garbage does not"
    serve_ros2 measured mixed "--ros2=$domain" --ros2-zenoh --ros2-control --duration 6
    "$peer/python" tests/peers/zenoh_measure.py "$domain" path1_b -0.9 1.793 0.2 8 path1_a
    end_ros2 measured garbage 2
    say "zenoh-ros2 lists what is published, and $seconds s of 60 vehicles are heard"
    sed 's/^vehicles = .*/vehicles = 60/' scenarios/city.toml >"$folder/crowd.toml"
    serve_ros2 many "$folder/crowd.toml" "--ros2=$domain" --ros2-zenoh --ros2-tf
    "$city3d" mainframe "$folder/crowd.toml" --city "$address" >"$folder/mainframe.out" 2>&1 &
    processes+=($!)
    local names topic
    mapfile -t names < <("$city3d" check "$folder/crowd.toml" --json --routes |
        python3 -c 'import json, sys; print(*(v["name"] for v in json.load(sys.stdin)["routes"]["vehicles"][:60]), sep="\n")')
    "$peer/zenoh-ros2" --no-daemon --timeout 2 --domain-id "$domain" topic list -t >"$folder/topics"
    for topic in "/tf [tf2_msgs/msg/TFMessage]" "/vicon/${names[0]}/${names[0]} [geometry_msgs/msg/PoseStamped]"; do
        grep -F "$topic" "$folder/topics" || die "zenoh-ros2 does not list $topic, but $(cat "$folder/topics")"
    done
    "$peer/python" tests/peers/zenoh_listen.py "$domain" "$seconds" "${names[@]}"
    end_all
    python3 tests/peers/ros2_report.py "$folder/many" nothing
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
    ros2)
        set_up
        shift
        ros2 "$@"
        ;;
    zenoh)
        set_up
        shift
        zenoh "$@"
        ;;
    *) die "usage: scripts/peers.sh rosbridge [SECONDS], ros2 [SECONDS], zenoh [SECONDS], web [FOLDER] or foxglove [FOLDER]" ;;
esac
