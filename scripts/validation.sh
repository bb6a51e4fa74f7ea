#!/usr/bin/env bash
# Draws pictures of all presets and kinds, and the window, under the validation layer of Vulkan, and fails if the layer says
# anything. Usage: scripts/validation.sh; it installs Debian's vulkan-validationlayers.
set -euo pipefail
cd "$(dirname "$0")/.."
# shellcheck disable=SC1091
source scripts/setup.sh
install_packages "${RUN_PACKAGES[@]}" xvfb xdotool vulkan-validationlayers
find_rust
set_runtime_folder
# Another program than that of this folder: CITY3D=/usr/bin/city3d scripts/validation.sh
city3d=${CITY3D:-}
if [[ -z "$city3d" ]]; then
    cargo build --locked
    city3d=${CARGO_TARGET_DIR:-target}/debug/city3d
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

export VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation WGPU_VALIDATION=1

# quiet NAME COMMAND ...: fails if the layer complains.
quiet() {
    local name=$1
    shift
    "$@" >"$folder/said" 2>&1 || { cat "$folder/said"; die "$name failed"; }
    if grep -q -i validation "$folder/said"; then
        grep -i -A4 validation "$folder/said" | head -40
        die "$name: the validation layer has found something"
    fi
    echo "$name: nothing"
}

VK_LOADER_DEBUG=layer "$city3d" frames roundabout --camera overhead --size 16x16 --duration 0.01 --out "$folder/probe" 2>&1 \
    | grep -q VK_LAYER_KHRONOS_validation || die "the validation layer is not loaded"
for quality in low medium high ultra; do
    for light in "noon clear" "night rain"; do
        read -r time weather <<<"$light"
        quiet "$quality, $light" "$city3d" frames city --adapter software --quality "$quality" --time "$time" --weather "$weather" \
            --camera windscreen --camera chase --camera orbit --vehicle 1 --vehicle 2 --kind rgb,depth,semantic,instance --flow --size 160x120 \
            --from 1 --every 0.5 --duration 1.5 --out "$folder/$quality-$time"
    done
done
for quality in low medium; do
    quiet "pictures of the window, $quality" "$city3d" view roundabout-coordinated --adapter software --quality "$quality" \
        --picture "$folder/window-$quality.png" --at 3 --fresh
    # A window of its own ends with the time that it is given.
    quiet "window, $quality" xvfb-run -a -s "-screen 0 1280x720x24" bash -c '
        ended=0
        timeout -s INT 12 "$0" view roundabout --adapter software --quality "$1" --fresh --out "$2" || ended=$?
        [[ $ended == 124 || $ended == 0 ]]' "$city3d" "$quality" "$folder/run-$quality"
done
