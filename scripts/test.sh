#!/usr/bin/env bash
# Everything a change has to pass: format, lints, the build without a GPU, documentation, all tests.
# With CI=true a test that cannot run for want of a graphics adapter or a peer fails.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh

# Data for incremental builds is as large as the build itself, and helps only a later build.
if [ "${CI:-}" = true ]; then
    export CARGO_INCREMENTAL=0
fi

step() {
    say "$*"
    local start=$SECONDS
    "$@"
    echo "-- $((SECONDS - start)) s"
}

set_up_tests

step cargo fmt --all --check
step cargo clippy --locked --workspace --all-targets -- -D warnings
# The feature sets that README.md, docs/ros.md and docs/ros2.md name.
step cargo clippy --locked --all-targets --no-default-features -- -D warnings
step cargo clippy --locked --no-default-features --features render -- -D warnings
step cargo clippy --locked --no-default-features --features ros -- -D warnings
step cargo clippy --locked --no-default-features --features ros2 -- -D warnings
step scripts/third_party.sh
step "$PEERS/bin/cargo-deny" --locked check bans licenses sources
step env RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps
if cargo nextest --version >/dev/null 2>&1; then
    step cargo nextest run --locked --workspace --no-fail-fast
    step cargo test --locked --workspace --doc
else
    step cargo test --locked --workspace --no-fail-fast
fi

# With the libraries of that build.
step scripts/python.sh

say "all passed in $((SECONDS / 60)) min $((SECONDS % 60)) s"
