#!/bin/sh
# Fifty cars under a laboratory's lag and noise: fifty seeds, the same with more delay, loss and noise, and the map of
# where it ends. Usage: scripts/robustness.sh [FOLDER] [SEEDS]; docs/robustness.md has what came out.
set -eu
cd "$(dirname "$0")/.."
out=${1:-out/robustness}
seeds=${2:-1..50}
# Another program than that of this folder: CITY3D=/usr/bin/city3d scripts/robustness.sh
city3d=${CITY3D:-}
if [ -z "$city3d" ]; then
    cargo build --release --locked
    city3d=${CARGO_TARGET_DIR:-target}/release/city3d
fi

# Means over the runs of a table, by the names of its columns.
figures() {
    awk -F, -v name="$1" '
        NR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }
        { crashed += $column["collisions"] > 0; speed += $column["mean_speed_mps"]; merges += $column["merges"]
          distance += $column["mean_distance_m"]; stand = $column["longest_stand_s"] + 0
          if (stand > longest) longest = stand; n++ }
        END { printf "%-32s runs %3d  with collisions %d  speed %.4f m/s  merges %.0f  distance %.1f m  longest stand %.1f s\n",
              name, n, crashed, speed / n, merges / n, distance / n, longest }' "$2/sweep.csv"
}

sweep() {
    name=$1
    shift
    "$city3d" sweep city --out "$out/$name" "$@" >/dev/null
    figures "$name" "$out/$name"
}

sweep ideal --environment ideal --seeds "$seeds"
sweep testbed --environment testbed --seeds "$seeds"
sweep command_delay_0.1 --environment testbed --seeds "$seeds" --set environment.command_delay_s=0.1
sweep loss_0.05 --environment testbed --seeds "$seeds" --set environment.loss=0.05
sweep position_noise_0.002 --environment testbed --seeds "$seeds" --set environment.position_noise_m=0.002
for scenario in roundabout mixed; do
    "$city3d" sweep "$scenario" --environment testbed --seeds 1..200 --out "$out/$scenario" >/dev/null
    figures "$scenario" "$out/$scenario"
done
"$city3d" sweep city --environment testbed --duration 100 --seeds 1..4 --out "$out/map" \
    --set environment.actuator_lag_s=0:0.5:0.1 --set environment.position_noise_m=0,0.001,0.002,0.004,0.008
