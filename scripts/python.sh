#!/usr/bin/env bash
# The Python package. Usage: scripts/python.sh            tests it as the development build makes it
#                            scripts/python.sh package    makes it so in target/python-package
#                            scripts/python.sh wheel      builds the wheel into target/wheels, and tests it in a fresh environment
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

case "${1:-}" in
    "")
        make_package
        PATH=$PWD/$VENV/bin:$PATH CITY3D_PACKAGE=$package "$PYTHON" -m pytest -q tests/python
        ;;
    wheel)
        "$PYTHON" -m pip install -q --disable-pip-version-check "maturin==1.16.0"
        rm -f target/wheels/city3d-*.whl
        "$VENV/bin/maturin" build --release --locked --manifest-path src/python/Cargo.toml --out target/wheels
        fresh=$(mktemp -d)
        trap 'rm -rf "$fresh"' EXIT
        python3 -m venv "$fresh"
        "$fresh/bin/pip" install -q --disable-pip-version-check -r tests/python/requirements.txt target/wheels/city3d-*.whl
        "$fresh/bin/city3d" --version
        PATH=$fresh/bin:$PATH "$fresh/bin/python" -m pytest -q tests/python
        ;;
    *) die "usage: scripts/python.sh [package | wheel]" ;;
esac
