#!/bin/sh
# Renders the pictures of docs/images again: scripts/gallery.sh [PROGRAM], from the project's folder.
set -eu

city3d=${1:-city3d}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# take NAME SCENARIO ARGUMENTS...: one picture into docs/images.
take() {
    name=$1
    scenario=$2
    shift 2
    "$city3d" frames "$scenario" --out "$folder" --force "$@" >/dev/null
    mv "$folder"/*.png "docs/images/$name.png"
}

# The west roundabout: path1_b and path1_c wait at the yield line while path2_a drives past.
take hero roundabout --size 1280x720 --quality high --from 13 --duration 13 \
    --camera orbit --at=-60.5,-39 --distance 20 --azimuth 332 --elevation 20 --fov 42

# What the camera of a waiting car sees.
take windscreen roundabout --size 960x600 --quality high --from 12 --duration 12 \
    --camera windscreen --vehicle path1_b --fov 55

# The same city at three times of day, and with many cameras in mind.
for time in noon low_sun night; do
    take "$time" city --size 960x540 --quality high --time "$time" --from 48.5 --duration 48.5 \
        --camera chase --vehicle 10
done
take low city --size 960x540 --quality low --from 20 --duration 20 --camera windscreen --vehicle 12

# One street in each preset.
for preset in low medium high ultra; do
    take "preset-$preset" city --size 640x360 --quality "$preset" --from 0 --duration 0.01 \
        --camera chase --vehicle 20
done

# A wet road, which "ultra" mirrors things in.
for preset in high ultra; do
    take "rain-$preset" city --size 640x360 --quality "$preset" --weather rain --from 20 --duration 20 \
        --camera chase --vehicle 20
done

# What the pictures say besides colour; depth from black nearby to white at 65 m.
take kind-depth city --size 640x360 --quality low --from 0 --duration 0.01 \
    --camera chase --vehicle 20 --kind depth
take kind-semantic city --size 640x360 --quality low --from 0 --duration 0.01 \
    --camera chase --vehicle 20 --kind semantic --palette

# The window, as it is after eight seconds.
"$city3d" view roundabout --fresh --picture docs/images/window.png --at 8 --size 1280x720 --quality high \
    --mode chase --select path1_b --preview path1_b --preview path2_a
"$city3d" run roundabout --out "$folder/replayed" >/dev/null
"$city3d" replay "$folder/replayed" --fresh --picture docs/images/replay.png --at 17.3 --size 1280x720 --quality high \
    --mode chase --select path1_a --preview path1_a --preview path2_c
