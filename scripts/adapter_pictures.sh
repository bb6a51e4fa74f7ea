#!/bin/bash
# Draws the same moments in every preset with one graphics adapter, to compare adapters:
#
#   scripts/adapter_pictures.sh CITY3D ADAPTER FOLDER
#
# ADAPTER is "software" or a part of the adapter's name. scripts/compare_pictures.py compares two such folders.
set -euo pipefail
city3d=$1
export CITY3D_ADAPTER=$2
folder=$3
mkdir -p "$folder"

# draw NAME OPTION...
draw() {
    "$city3d" frames "${@:2}" --size 640x480 --out "$folder/$1" --force >/dev/null
}

for quality in low medium high ultra; do
    draw "$quality-onboard" city --vehicle 3 --vehicle 17 --vehicle 41 --camera windscreen \
        --kind rgb,depth,semantic,instance --from 20 --duration 20.01 --quality "$quality"
    draw "$quality-chase" city --vehicle 3 --camera chase --from 20 --duration 20.01 --time low_sun --quality "$quality"
    draw "$quality-city" city --camera orbit --from 20 --duration 20.01 --quality "$quality"
    draw "$quality-night" roundabout --vehicle path1_b --camera chase --from 8 --duration 8.01 --time night \
        --weather rain --quality "$quality"
done
