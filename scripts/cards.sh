#!/bin/sh
# Renders the pictures of the scenarios' cards on the start page again: scripts/cards.sh [PROGRAM], from the project's
# folder. Needs ffmpeg, which scales them and gives them a palette: the program contains them.
set -eu

city3d=${1:-city3d}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir -p assets/cards

# take SCENARIO TIME ARGUMENTS...: one picture into assets/cards.
take() {
    name=$1
    at=$2
    shift 2
    "$city3d" frames "$name" --out "$folder" --force --size 800x448 --quality high --from "$at" --duration "$at" \
        "$@" >/dev/null
    ffmpeg -loglevel error -y -i "$folder"/*.png -filter_complex \
        "scale=200:112:flags=area,split[a][b];[a]palettegen=max_colors=128[p];[b][p]paletteuse=dither=none" \
        -frames:v 1 "assets/cards/$name.png"
    rm "$folder"/*
}

take roundabout 13 --camera orbit --at=-60.5,-39 --distance 22 --azimuth 332 --elevation 22 --fov 48
take roundabout-coordinated 9 --camera orbit --at=-64,-34 --distance 42 --azimuth 60 --elevation 40 --fov 48
take mixed 15 --camera chase --vehicle path1_a
take city 20 --camera orbit --at=0,-7 --distance 70 --azimuth 215 --elevation 32 --fov 50
take straight 5 --camera orbit --vehicle 1 --distance 16 --azimuth 60 --elevation 14
take student 1 --camera chase --vehicle student
take intersection 60 --camera orbit --at=0,0 --distance 70 --azimuth 235 --elevation 40 --fov 45
take intersection-signals 60 --camera orbit --at=0,0 --distance 34 --azimuth 215 --elevation 22 --fov 50
take corridor 60 --camera orbit --at=0,0 --distance 105 --azimuth 200 --elevation 16 --fov 45
take merge 45 --camera orbit --at=-12,0 --distance 42 --azimuth 300 --elevation 24 --fov 45
take platoon 30 --camera orbit --vehicle 4 --distance 38 --azimuth 60 --elevation 16 --fov 50
