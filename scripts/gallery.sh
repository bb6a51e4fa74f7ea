#!/bin/sh
# Renders the pictures of docs/images again: scripts/gallery.sh [PROGRAM], from the project's folder.
set -eu

city3d=${1:-city3d}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# The west roundabout: path1_b and path1_c wait at the yield line while path2_a drives past.
"$city3d" frames roundabout --out "$folder" --size 1280x720 --quality high --from 13 --duration 13 \
    --camera orbit --at=-60.5,-39 --distance 20 --azimuth 332 --elevation 20 --fov 42
mv "$folder"/orbit_city_*.png docs/images/hero.png

# The same city at night, and with many cameras in mind.
"$city3d" frames city --out "$folder" --size 960x540 --quality high --time night --from 20 --duration 20 \
    --camera chase --vehicle 20
mv "$folder"/chase_*.png docs/images/night.png
"$city3d" frames city --out "$folder" --size 960x540 --quality low --from 20 --duration 20 \
    --camera windscreen --vehicle 12
mv "$folder"/windscreen_*.png docs/images/low.png

# What the camera of a waiting car sees.
"$city3d" frames roundabout --out "$folder" --size 960x600 --quality high --from 12 --duration 12 \
    --camera windscreen --vehicle path1_b --fov 55
mv "$folder"/windscreen_path1_b_*.png docs/images/windscreen.png

# The window, as it is after eight seconds.
"$city3d" view roundabout --fresh --picture docs/images/window.png --at 8 --size 1280x720 --quality high \
    --mode chase --select path1_b --preview path1_b --preview path2_a
