#!/bin/sh
# Renders the pictures of docs/images again: scripts/gallery.sh [PROGRAM], from the project's folder.
set -eu

city3d=${1:-city3d}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# The west roundabout: path1_b and path1_c wait at the yield line while path2_a drives past.
"$city3d" frames roundabout --out "$folder" --size 1280x720 --quality high --from 13 --duration 13 \
    --camera orbit --at=-60.5,-39 --distance 27 --azimuth 250 --elevation 17 --fov 42
mv "$folder"/orbit_city_*.png docs/images/hero.png

# What the camera of a waiting car sees.
"$city3d" frames roundabout --out "$folder" --size 960x600 --quality high --from 12 --duration 12 \
    --camera windscreen --vehicle path1_b --fov 55
mv "$folder"/windscreen_path1_b_*.png docs/images/windscreen.png
