#!/bin/sh
# The roundabout experiment, twice, with its figures: the ideal run, the testbed emulator, the comparison, and the
# maps of where the outcome turns. Usage: scripts/roundabout.sh [FOLDER]; docs/roundabout.md tells what comes out. The
# second time it writes over the runs, and goes on with sweeps that were stopped.
set -eu
cd "$(dirname "$0")/.."
out=${1:-out/experiment}
# Another program than that of this folder: CITY3D=/usr/bin/city3d scripts/roundabout.sh
city3d=${CITY3D:-}
if [ -z "$city3d" ]; then
    cargo build --release --locked
    city3d=${CARGO_TARGET_DIR:-target}/release/city3d
fi
for environment in ideal testbed; do
    "$city3d" run roundabout --environment "$environment" --out "$out/$environment" --force
done
# Positions as in the paper: its yield line is at 3.3 m.
"$city3d" compare "$out/ideal/run.mcap" "$out/testbed/run.mcap" --origin 3.76 --out "$out/both" --force |
    tee "$out/comparison.txt"
"$city3d" sweep roundabout --environment testbed --seeds 1..50 --out "$out/seeds" --force
"$city3d" sweep roundabout --environment testbed --seeds 1..10 --out "$out/map" --force \
    --set environment.command_delay_s=0:0.3:0.05 --set environment.speed_disturbance=0:0.12:0.02
"$city3d" sweep roundabout --environment testbed --seeds 1..10 --out "$out/noise" --force \
    --set environment.command_delay_s=0:0.3:0.05 --set environment.position_noise_m=0:0.008:0.002
