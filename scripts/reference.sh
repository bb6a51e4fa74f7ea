#!/usr/bin/env bash
# Compares the renderer with a path tracer: exports the city and draws it in all presets (cargo xtask reference), lets
# Mitsuba draw the same cameras, and compares the pictures by FLIP. docs/reference.md says what is compared.
#
#   scripts/reference.sh                  all cameras and times, 256 samples a pixel: about half an hour on two cores
#   scripts/reference.sh --spp 64 ...     options of scripts/reference/compare.py
#
# Files are left in target/reference/files: tables.md, results.json, and the pictures. Mitsuba's pictures are not drawn
# again unless --again is given; after a change of the renderer alone, its pictures are compared with those.
# Mitsuba compiles its kernels by LLVM; versions before 19 do not know all instructions of processors with AVX-512.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh

FOLDER=target/reference

find_rust
set_runtime_folder
find_llvm() { ldconfig -p | sed -n 's/.*libLLVM\.so\.19[^ ]* .*=> //p' | head -1; }
[[ -n "$(find_llvm)" ]] || install_packages libllvm19
DRJIT_LIBLLVM_PATH=${DRJIT_LIBLLVM_PATH:-$(find_llvm)}
[[ -n "$DRJIT_LIBLLVM_PATH" ]] || die "LLVM 19 is missing: set DRJIT_LIBLLVM_PATH to its libLLVM.so"
export DRJIT_LIBLLVM_PATH

install_packages python3-venv
make_venv "$FOLDER/venv" scripts/reference/requirements.txt

say "exporting the city, and drawing it in all presets"
cargo xtask reference --out "$FOLDER/files"
say "drawing it with Mitsuba, and comparing"
"$FOLDER/venv/bin/python" scripts/reference/compare.py "$FOLDER/files" "$@"
