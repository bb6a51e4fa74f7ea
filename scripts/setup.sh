#!/usr/bin/env bash
# Installs what City3D needs beyond Rust on Debian or Ubuntu; what is there is left alone.
#
#   scripts/setup.sh         what building and drawing need
#   scripts/setup.sh tests   what the tests need besides
#
# demo.sh and test.sh source this file for its functions.
set -euo pipefail

# What draws without a GPU, what finds gamepads, and the C compiler and linker that Rust calls.
RUN_PACKAGES=(mesa-vulkan-drivers libvulkan1 libxkbcommon-x11-0 libxcursor1 libxi6 libxrandr2 libudev-dev pkg-config
    gcc libc6-dev)
TEST_PACKAGES=(xvfb xdotool python3 python3-venv ffmpeg g++
    python3-roslaunch python3-rostopic python3-rosnode python3-rosbag python3-geometry-msgs python3-sensor-msgs
    python3-tf2-msgs python3-autobahn python3-twisted python3-rospy)
PEERS=target/peers

say() { printf '\n== %s\n' "$*"; }
die() { printf 'error: %s\n' "$*" >&2; exit 1; }

is_installed() { [[ "$(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null)" == installed ]]; }

as_root() {
    if [[ $(id -u) == 0 ]]; then
        "$@"
    elif command -v sudo >/dev/null; then
        sudo "$@"
    else
        die "these packages are missing and neither root nor sudo is at hand: ${missing[*]}"
    fi
}

install_packages() {
    if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
        echo "Neither Debian nor Ubuntu: see to it that these are there: $*" >&2
        return
    fi
    local missing=() package
    for package in "$@"; do
        is_installed "$package" || missing+=("$package")
    done
    [[ ${#missing[@]} == 0 ]] && return
    say "installing ${missing[*]}"
    as_root apt-get update -q
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${missing[@]}"
}

find_rust() {
    if ! command -v cargo >/dev/null && [[ -f "$HOME/.cargo/env" ]]; then
        # shellcheck disable=SC1091
        source "$HOME/.cargo/env"
    fi
    command -v cargo >/dev/null || die "Rust is missing: https://rustup.rs"
}

# Drivers want a folder for their sockets; containers have none.
set_runtime_folder() {
    if [[ -z "${XDG_RUNTIME_DIR:-}" ]]; then
        export XDG_RUNTIME_DIR="${TMPDIR:-/tmp}/city3d-runtime-$(id -u)"
        mkdir -p -m 700 "$XDG_RUNTIME_DIR"
    fi
}

set_up() {
    find_rust
    install_packages "${RUN_PACKAGES[@]}"
    set_runtime_folder
}

set_up_tests() {
    set_up
    install_packages "${TEST_PACKAGES[@]}"
    local component
    for component in rustfmt clippy; do
        cargo "${component/rustfmt/fmt}" --version >/dev/null 2>&1 || rustup component add "$component"
    done
    set_up_peers
}

# make_venv FOLDER REQUIREMENTS: a Python of its own, made anew when the versions change.
make_venv() {
    local venv=$1 wanted=$2
    cmp -s "$wanted" "$venv/requirements.txt" && return
    say "installing $wanted into $venv"
    rm -rf "$venv"
    mkdir -p "$(dirname "$venv")"
    # Another python3 may come first in PATH and have no venv.
    python3 -m venv "$venv" || { rm -rf "$venv"; /usr/bin/python3 -m venv "$venv"; }
    "$venv/bin/pip" install -q --disable-pip-version-check -r "$wanted"
    cp "$wanted" "$venv/requirements.txt"
}

# A Python of its own for the peers of the tests.
set_up_peers() {
    make_venv "$PEERS" tests/peers/requirements.txt
    export CITY3D_PEERS_PYTHON="$PWD/$PEERS/bin/python"
}

if [[ "${BASH_SOURCE[0]}" == "$0" ]]; then
    cd "$(dirname "$0")/.."
    case "${1:-}" in
        "") set_up ;;
        tests) set_up_tests ;;
        *) die "usage: scripts/setup.sh [tests]" ;;
    esac
    echo "all there"
fi
