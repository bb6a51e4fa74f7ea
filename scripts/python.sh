#!/usr/bin/env bash
# The Python package. Usage: scripts/python.sh            tests it as the development build makes it
#                            scripts/python.sh package    makes it so in target/python-package
#                            scripts/python.sh wheel      builds the wheel into target/wheels, and tests it in a fresh environment
#                            scripts/python.sh bench      measures that wheel, and its peers, as tables for BENCHMARKS.md
#                            scripts/python.sh learn      trains the example with that wheel
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh
find_rust

# The package of the development build, in target/python-package.
make_package() {
    cargo build --locked --workspace --lib
    package=$PWD/target/python-package
    rm -rf "$package"
    mkdir -p "$package"
    cp -r src/python/city3d "$package/"
    cp "${CARGO_TARGET_DIR:-target}/debug/libcity3d_python.so" "$package/city3d/_native.abi3.so"
}

if [[ "${1:-}" == package ]]; then
    make_package
    exit
fi

VENV=target/python
make_venv "$VENV" tests/python/requirements.txt
PYTHON=$PWD/$VENV/bin/python

# The environment that `wheel` has made.
WHEEL=$PWD/target/python-wheel
need_wheel() {
    [[ -x $WHEEL/bin/city3d ]] || die "there is no wheel yet; build it with scripts/python.sh wheel"
}

case "${1:-}" in
    "")
        make_package
        PATH=$PWD/$VENV/bin:$PATH CITY3D_PACKAGE=$package "$PYTHON" -m pytest -q tests/python
        ;;
    wheel)
        "$PYTHON" -m pip install -q --disable-pip-version-check "maturin==1.16.0"
        rm -f target/wheels/city3d-*.whl
        # For machines with libraries as new as those here: what the window opens at run time is theirs.
        "$VENV/bin/maturin" build --release --locked --compatibility linux --manifest-path src/python/Cargo.toml --out target/wheels
        rm -rf "$WHEEL"
        make_venv "$WHEEL" tests/python/requirements.txt
        "$WHEEL/bin/pip" install -q --disable-pip-version-check target/wheels/city3d-*.whl
        "$WHEEL/bin/city3d" --version
        PATH=$WHEEL/bin:$PATH "$WHEEL/bin/python" -m pytest -q tests/python
        ;;
    bench)
        need_wheel
        "$WHEEL/bin/python" benches/python.py
        make_venv target/python-peers benches/python_peers.txt
        xvfb-run -a -s "-screen 0 1280x720x24" target/python-peers/bin/python benches/python.py highway-env metadrive 2>/dev/null
        ;;
    learn)
        need_wheel
        "$WHEEL/bin/python" src/python/examples/learn_to_drive.py "${@:2}"
        ;;
    *) die "usage: scripts/python.sh [package | wheel | bench | learn]" ;;
esac
